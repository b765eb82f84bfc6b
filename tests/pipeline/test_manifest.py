"""Manifests: settings and presets, and faults with their line and remedy."""

from __future__ import annotations

from pathlib import Path

import pytest

from lightkiln_pipeline.batch.cli import manifest_schema
from lightkiln_pipeline.batch.manifest import load_manifest
from lightkiln_pipeline.batch.plan import cache_key, forget_files, make_plan
from lightkiln_pipeline.errors import UsageError

GOOD = """
out = "baked"
[presets.rough]
error = "10%"
texels_per_metre = 4
usd = {level = 0}

[[assets]]
scenes = ["*.glb"]
preset = "rough"
texels_per_metre = 8
usd = {purposes = ["default"]}
"""


def write(tmp_path: Path, text: str) -> Path:
    """A manifest."""
    path = tmp_path / "batch.toml"
    path.write_text(text, encoding="utf-8")
    return path


def test_settings_of_an_asset_lie_over_its_preset(tmp_path: Path) -> None:
    manifest = load_manifest(write(tmp_path, GOOD))
    settings = manifest.settings(manifest.assets[0])
    assert (settings.error, settings.texels_per_metre) == ("10%", 8)
    assert (settings.usd.level, settings.usd.purposes) == (0, ["default"])


FAULTS = {
    "unknown_key": ('[[assets]]\nscenes = ["a.glb"]\n\ntexel = 3\n', 4, "unknown key `texel`", "texels_per_metre"),
    "unknown_nested": ('[[assets]]\nscenes = ["a.glb"]\n[assets.usd]\nlevle = 3\n', 4, "unknown key `levle`", "level"),
    "unknown_inline": ('[[assets]]\nscenes = ["a.glb"]\nusd = {levle = 3}\n', 3, "unknown key `levle`", "level"),
    "unknown_top": ('outt = "x"\n[[assets]]\nscenes = ["a.glb"]\n', 1, "unknown key `outt`", "out"),
    "wrong_type": (
        '[[assets]]\nscenes = ["a.glb"]\n[[assets]]\nscenes = ["b"]\nresolution = "big"\n',
        5,
        "assets.1.resolution",
        "integer",
    ),
    "out_of_range": ('jobs = 0\n[[assets]]\nscenes = ["a.glb"]\n', 1, "jobs", "greater than or equal to 1"),
    "missing": ('[[assets]]\npreset = "x"\n', 1, "`assets.0.scenes` is missing", "add it"),
    "no_preset": ('[[assets]]\nscenes = ["a"]\npreset = "x"\n', 1, "preset `x` does not exist", "none"),
    "parts": ('[[assets]]\nscenes = ["a"]\ngroups = true\nlight = "direct"\n', 1, "groups", "leave out light"),
    "choice": ('[presets.a]\nquantity = "heat"\n[[assets]]\nscenes = ["a"]\n', 2, "presets.a.quantity", "irradiance"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_faults_have_their_line_and_remedy(tmp_path: Path, fault: str) -> None:
    text, line, *words = FAULTS[fault]
    with pytest.raises(UsageError) as caught:
        load_manifest(write(tmp_path, text))
    assert f"batch.toml:{line}:" in str(caught.value)
    assert all(word in str(caught.value) for word in words), str(caught.value)


def test_several_faults_are_named_at_once(tmp_path: Path) -> None:
    with pytest.raises(UsageError) as caught:
        load_manifest(write(tmp_path, 'a = 1\nb = 2\n[[assets]]\nscenes = ["x"]\n'))
    assert str(caught.value).count("unknown key") == 2


@pytest.mark.parametrize("text", ["[[assets]\n", "a = \n", "\x00"])
def test_broken_toml_is_named(tmp_path: Path, text: str) -> None:
    with pytest.raises(UsageError, match="not valid TOML"):
        load_manifest(write(tmp_path, text))


def test_the_published_schema_is_that_of_the_models() -> None:
    published = Path(__file__).parents[2] / "pipeline/src/lightkiln_pipeline/batch/manifest.schema.json"
    assert published.read_text(encoding="utf-8") == manifest_schema() + "\n", "run: lightkiln-batch schema"


def plan_of(tmp_path: Path, *files: str, text: str = '[[assets]]\nscenes = ["**/*.glb", "**/*.gltf"]\n'):  # type: ignore[no-untyped-def]
    """The plan of a folder with empty scenes."""
    for name in files:
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(b"{}")
    path = write(tmp_path, text)
    return make_plan(load_manifest(path), path)


def test_names_come_from_paths(tmp_path: Path) -> None:
    plan = plan_of(tmp_path, "a/one.glb", "b/one.glb", "ünï cöde/a b.glb", "kit.gltf.glb", "lightmaps/a/one.lit.glb")
    assert [a.name for a in plan.assets] == ["a/one", "b/one", "kit", "ünï cöde/a b"]


def test_results_of_two_scenes_never_share_a_folder(tmp_path: Path) -> None:
    plan = plan_of(tmp_path, "Room.glb", "room.gltf", "other.glb")
    faults = {a.scene.name: a.fault for a in plan.assets}
    assert "same folder" in faults["Room.glb"] and "same folder" in faults["room.gltf"]
    assert faults["other.glb"] == ""


def test_a_glob_without_scenes_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="match no scene"):
        plan_of(tmp_path, text='[[assets]]\nscenes = ["*.usd"]\n')


def test_the_cache_key_follows_content_not_times(tmp_path: Path) -> None:
    plan = plan_of(tmp_path, "a.gltf")
    scene = tmp_path / "a.gltf"
    scene.write_text(
        '{"images": [{"uri": "t%20x.png"}], "extensions": {"LIGHTKILN_scene": {"environment": {"image": "sky.exr"}}}}'
    )
    (tmp_path / "t x.png").write_bytes(b"1")

    def key(baker: str = "lightkiln 1") -> str:
        forget_files()
        return cache_key(plan.assets[0], baker)

    first = key()
    scene.touch()
    assert key() == first
    assert key("lightkiln 2") != first
    (tmp_path / "t x.png").write_bytes(b"2")
    second = key()
    assert second != first
    (tmp_path / "sky.exr").write_bytes(b"sky")
    assert key() != second
