"""Every refusal names the object and the remedy, and leaves the file as it was."""

from __future__ import annotations

import os
import stat
from collections.abc import Callable
from pathlib import Path

import bpy
import pytest

from blender_addon import session
from tests.blender.scenes_in_blender import bake, lamp, material, place, quad
from tests.blender.test_lifecycle import state_of_file


def refusal() -> str:
    """The message of a bake that must fail; the file must be as before."""
    before = state_of_file()
    with pytest.raises(RuntimeError) as caught:
        bpy.ops.lightkiln.bake()
    assert session.running is None
    assert state_of_file() == before
    return str(caught.value)


def notes() -> dict[str, str]:
    """What the last bake noted, by object."""
    return {note.place: note.message for note in bpy.context.scene.lightkiln.notes}


def lit_quad() -> bpy.types.Object:
    """The smallest scene that bakes."""
    lamp("POINT", energy=100)
    return quad("Floor", 1)


def test_unsaved_file() -> None:
    lit_quad()
    settings = bpy.context.scene.lightkiln
    settings.storage, settings.folder = "FILE", "//lightmaps"
    message = refusal()
    assert "//lightmaps" in message and "save the file" in message


def test_folder_that_cannot_be_written(tmp_path: Path) -> None:
    lit_quad()
    settings = bpy.context.scene.lightkiln
    settings.storage, settings.folder = "FILE", str(tmp_path / "file" / "below")
    (tmp_path / "file").write_text("in the way")
    message = refusal()
    assert "file" in message and "choose another" in message


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="the superuser may write everywhere")
def test_read_only_folder(tmp_path: Path) -> None:
    lit_quad()
    tmp_path.chmod(stat.S_IRUSR | stat.S_IXUSR)
    settings = bpy.context.scene.lightkiln
    settings.storage, settings.folder = "FILE", str(tmp_path / "lightmaps")
    try:
        assert "cannot be written" in refusal()
    finally:
        tmp_path.chmod(stat.S_IRWXU)


def test_missing_baker(monkeypatch: pytest.MonkeyPatch) -> None:
    lit_quad()
    monkeypatch.setenv("LIGHTKILN_BIN", "/nowhere/lightkiln")
    message = refusal()
    assert "/nowhere/lightkiln" in message and "preferences" in message


@pytest.mark.parametrize("script", ["#!/bin/sh\necho lightkiln 7.0.0", "no program"])
def test_wrong_baker(script: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    lit_quad()
    fake = tmp_path / "lightkiln"
    fake.write_text(script)
    fake.chmod(0o755)
    monkeypatch.setenv("LIGHTKILN_BIN", str(fake))
    message = refusal()
    assert str(fake) in message and "preferences" in message


@pytest.mark.parametrize(
    ("script", "expected"),
    [
        ("kill -9 $$", "ended from outside"),
        ("""echo '{"event":"error","code":"disk","message":"no space left: free some"}'; exit 1""", "free some"),
        ("echo broken >&2; exit 3", "broken"),
    ],
)
def test_baker_that_fails(script: str, expected: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    lit_quad()
    fake = tmp_path / "lightkiln"
    fake.write_text(f'#!/bin/sh\nif [ "$1" = --version ]; then echo lightkiln 0.1.0; exit; fi\n{script}\n')
    fake.chmod(0o755)
    monkeypatch.setenv("LIGHTKILN_BIN", str(fake))
    assert expected in refusal()


def test_no_light() -> None:
    quad("Floor", 1)
    message = refusal()
    assert "`Scene`" in message and "add a lamp" in message


def test_nothing_to_bake() -> None:
    lamp("POINT", energy=100)
    place("Empty mesh", bpy.data.meshes.new("Empty mesh"))
    message = refusal()
    assert "Empty mesh" in message and "add faces" in message


def test_no_collection_chosen() -> None:
    lit_quad()
    bpy.context.scene.lightkiln.scope = "COLLECTION"
    assert "choose one" in refusal()


def test_edit_mode() -> None:
    ob = lit_quad()
    bpy.context.view_layer.objects.active = ob
    bpy.ops.object.mode_set(mode="EDIT")
    try:
        message = refusal()
    finally:
        bpy.ops.object.mode_set(mode="OBJECT")
    assert "`Floor`" in message and "leave it" in message


def test_map_that_is_gone() -> None:
    lit_quad().lightkiln.uv_map = "Gone"
    message = refusal()
    assert "`Floor`" in message and "`Gone`" in message and "choose another" in message


def test_too_many_maps() -> None:
    ob = lit_quad()
    for i in range(8):
        ob.data.uv_layers.new(name=f"Map {i}")
    message = refusal()
    assert "Floor" in message and "remove one" in message


def test_mesh_without_faces_and_missing_uv_area() -> None:
    lit_quad()
    place("Bare", bpy.data.meshes.new("Bare"))
    flat = quad("Flat", 1, (3, 0, 0))
    flat.data.uv_layers.new(name="Flat", do_init=False)
    flat.lightkiln.uv_map = "Flat"
    for corner in flat.data.uv_layers["Flat"].uv:
        corner.vector = (0.5, 0.5)
    bake(density=8, error=10)
    assert "add faces" in notes()["Bare"]
    assert "unwrap it" in notes()["Flat"]


def test_overlapping_map_is_named() -> None:
    ob = lit_quad()
    bpy.ops.mesh.primitive_cube_add(size=1, location=(3, 0, 0))
    cube = bpy.context.object
    for layer in list(cube.data.uv_layers):
        cube.data.uv_layers.remove(layer)
    layer = cube.data.uv_layers.new(name="Upon each other")
    for i, corner in enumerate(layer.uv):
        corner.vector = [(0, 0), (1, 0), (1, 1), (0, 1)][i % 4]
    cube.lightkiln.uv_map = "Upon each other"
    bake(density=8, error=10)
    assert any("Cube" in text and "lies upon itself" in text for text in [f"{p} {m}" for p, m in notes().items()])
    assert "lightkiln_place" in ob


def test_linked_objects_are_named(tmp_path: Path) -> None:
    quad("Linked", 1)
    library = tmp_path / "library.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(library))
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.context.scene.lightkiln.storage = "PACKED"
    with bpy.data.libraries.load(str(library), link=True) as (_, wanted):
        wanted.objects = ["Linked"]
    bpy.context.scene.collection.objects.link(wanted.objects[0])
    lit_quad().location.x = 2
    bake(density=8, error=10)
    assert "make it local" in notes()["Linked"]


def during_bake(change: Callable[[], None]) -> None:
    """Bakes, and changes the scene while the baker works."""
    settings = bpy.context.scene.lightkiln
    settings.density, settings.error = 8, 10
    running = session.start(bpy.context.scene, bpy.context.view_layer)
    changed = False
    for _ in running.steps:
        if not changed and running.bake.progress.stage not in {"prepare", "export"}:
            change()
            changed = True
    session._end(running, "")
    assert changed


def test_object_deleted_during_the_bake() -> None:
    lit_quad()
    quad("Doomed", 1, (3, 0, 0))
    during_bake(lambda: bpy.data.objects.remove(bpy.data.objects["Doomed"]))
    assert "deleted" in notes()["Doomed"]
    assert "lightkiln_place" in bpy.data.objects["Floor"]


def test_object_renamed_or_edited_during_the_bake() -> None:
    ob = lit_quad()
    bpy.context.view_layer.objects.active = ob

    def change() -> None:
        ob.name = "Renamed"
        bpy.ops.object.mode_set(mode="EDIT")

    during_bake(change)
    bpy.ops.object.mode_set(mode="OBJECT")
    assert "lightkiln_place" in bpy.data.objects["Renamed"]


def test_approximated_materials_are_listed() -> None:
    ob = lit_quad()
    glass = material("Odd glass", "ShaderNodeBsdfGlass")
    ob.data.materials.append(glass)
    bake(density=8, error=10)
    assert "straight" in notes()["Odd glass"]


def test_a_second_bake_must_wait() -> None:
    lit_quad()
    session.start(bpy.context.scene, bpy.context.view_layer)
    assert not bpy.ops.lightkiln.bake.poll()
    session.stop()
    assert bpy.ops.lightkiln.bake.poll()
