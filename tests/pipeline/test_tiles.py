"""Assets in parts: solve, gather, merge by hand, by Dask and by Open Job Description, and what is refused."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import time
from pathlib import Path
from typing import Any

import pytest

from batches import ALL, MANIFEST, batch, command, openjd, states
from lightkiln_pipeline.batch.task import Task, in_parts
from lightkiln_pipeline.batch.tiles import gather_asset, merge_asset, solve_asset
from lightkiln_pipeline.errors import EnvironmentFault, PipelineError

OPTIONS = 'texels_per_metre = 60\ngroups = true\naudit = "off"'
FINE = MANIFEST.replace("texels_per_metre = 20", OPTIONS)


@pytest.fixture
def fine(show: Path) -> Path:
    """The show at a density at which its scenes have several tiles."""
    show.write_text(FINE)
    return show


def pages(show: Path) -> dict[str, bytes]:
    """The pages and layers of all assets."""
    out = show.parent / "baked"
    return {p.relative_to(out).as_posix(): p.read_bytes() for p in out.rglob("lightmap_*.exr")}


def single(show: Path) -> dict[str, bytes]:
    """The pages of a batch in one piece, which is then forgotten."""
    batch("run", show)
    found = pages(show)
    assert {Path(name).parent.as_posix() for name in found} == ALL
    assert len(found) > len(ALL), "light groups have pages, too"
    forget(show)
    return found


def forget(show: Path) -> None:
    """Makes all assets stale."""
    for stamp in (show.parent / "baked").rglob("batch.json"):
        stamp.unlink()
    for page in (show.parent / "baked").rglob("lightmap_*.exr"):
        page.unlink()


def parts_left(show: Path) -> list[Path]:
    """What is left of the work on parts."""
    return [*show.parent.rglob(".*.tiles"), *show.parent.rglob("*.partial*")]


def test_parts_by_hand_give_the_same_bits(fine: Path) -> None:
    expected = single(fine)
    for name, split in {"three": ["0-1", "2", "3-6"], "kit/box": ["5-6", "0-4"]}.items():
        batch("solve", fine, name)
        work = next((fine.parent / "baked" / name).parent.glob(".*.tiles"))
        batch("merge", fine, name, expect=1)
        for part in split:
            batch("gather", fine, name, "--part", part, "--of", "7")
        files = {p.name: p.stat().st_mtime_ns for p in (work / "solution").iterdir()}
        # All of it is there: nothing is done again.
        batch("solve", fine, name)
        batch("gather", fine, name, "--part", split[0], "--of", "7")
        assert {p.name: p.stat().st_mtime_ns for p in (work / "solution").iterdir()} == files
        batch("merge", fine, name)
    assert {n: p for n, p in expected.items() if not n.startswith(("one", "two"))} == pages(fine)
    assert (fine.parent / "baked/three/three.lightmap.usdc").is_file()
    assert not parts_left(fine)
    # Current assets are left alone, by every part.
    batch("solve", fine, "three")
    batch("gather", fine, "three", "--part", "0", "--of", "2")
    batch("merge", fine, "three")
    assert not parts_left(fine)
    for wrong in ("7", "3-1", "x", "0-7"):
        batch("gather", fine, "three", "--part", wrong, "--of", "7", expect=2)


def test_dask_spreads_tiles_with_the_same_bits(fine: Path) -> None:
    pytest.importorskip("distributed")
    expected = single(fine)
    events = batch("run", fine, "--json", "--executor", "dask", "--tiles", "3")
    assert states(events) == dict.fromkeys(ALL, "baked")
    done = [e["done"] for e in events if e["event"] == "progress" and e["asset"] == "one"]
    assert len(done) == 4 and done[-1] == 1.0
    assert pages(fine) == expected
    assert not parts_left(fine)
    report = json.loads((fine.parent / "baked" / "one" / "batch.json").read_text())
    assert report["seconds"] > report["facts"]["baked_s"], "the time of all parts counts"
    # The split is no part of the result: nothing is stale by it.
    fine.write_text(FINE.replace("jobs = 2", "jobs = 1") + "tiles = 2\n")
    assert states(batch("run", fine, "--json")) == dict.fromkeys(ALL, "current")
    batch("run", fine, "--tiles", "3", expect=2)


def test_faults_of_parts_are_named(fine: Path) -> None:
    pytest.importorskip("distributed")
    (fine.parent / "broken.usda").write_text("#usda 1.0\ndef {")
    (fine.parent / "kit" / "torn.glb").write_bytes(b"glTF\x02\0\0\0")
    events = batch("run", fine, "--json", "--keep-going", "--executor", "dask", "--tiles", "2", expect=1)
    assert states(events) == {**dict.fromkeys(ALL, "baked"), "broken": "failed", "kit/torn": "failed"}
    messages = {e["name"]: e["message"] for e in events if e["event"] == "asset" and e["state"] == "failed"}
    assert "broken.usda" in messages["broken"] and "torn.glb" in messages["kit/torn"]


@pytest.mark.skipif(os.name == "nt", reason="signals of POSIX")
def test_a_batch_that_is_killed_gathers_only_what_is_missing(fine: Path) -> None:
    pytest.importorskip("distributed")
    expected = single(fine)
    words = command("run", fine, "--json", "--executor", "dask", "--tiles", "4", "--jobs", "1")
    running = subprocess.Popen(words, stdout=subprocess.PIPE, text=True, start_new_session=True)
    assert running.stdout is not None
    tiles: list[Path] = []
    for line in running.stdout:
        tiles = list((fine.parent / "baked").rglob("tiles_*.lk"))
        if json.loads(line)["event"] == "progress" and tiles:
            break
    os.killpg(running.pid, signal.SIGKILL)
    running.wait()
    time.sleep(0.5)
    kept = {path: path.stat().st_mtime_ns for path in (fine.parent / "baked").rglob("tiles_*.lk")}
    assert kept
    name = next(iter(kept)).parents[1].name.split(".")[1]
    name = name if name in ALL else f"kit/{name}"
    for part in range(4):
        batch("gather", fine, name, "--part", str(part), "--of", "4")
    assert {path: path.stat().st_mtime_ns for path in kept if path.is_file()} == kept
    batch("merge", fine, name)
    assert states(batch("run", fine, "--json", "--executor", "dask", "--tiles", "4"))[name] == "current"
    assert pages(fine) == expected


@pytest.mark.skipif(os.name == "nt", reason="starts a script of POSIX")
def test_bundle_with_tiles_is_accepted_and_runs(fine: Path, tmp_path: Path) -> None:
    pytest.importorskip("openjd.cli")
    expected = single(fine)
    fine.write_text(FINE.replace('scenes = ["*.usda", "kit/*.glb"]', 'scenes = ["*.usda"]\ntiles = 4'))
    fine.write_text(fine.read_text() + '[[assets]]\nscenes = ["kit/*.glb"]\nerror = "10%"\n' + OPTIONS + "\n")
    batch("bundle", fine, tmp_path / "job")
    template = tmp_path / "job" / "template.json"
    steps = {step["name"]: step for step in json.loads(template.read_text())["steps"]}
    assert list(steps) == ["Bake", "Solve4x", "Gather4x", "Merge4x", "Report"]
    assert steps["Gather4x"]["dependencies"] == [{"dependsOn": "Solve4x"}]
    openjd(tmp_path, "check", template)
    said = openjd(tmp_path, "run", template, "-p", f"Manifest={fine}", "-p", "PartsPerTask=3")
    assert "one: parts 0-1 of 4 gathered" in said and "one: parts 2-3 of 4 gathered" in said
    assert pages(fine) == expected
    assert states(batch("run", fine, "--json")) == dict.fromkeys(ALL, "current")
    assert not parts_left(fine)


def task(show: Path, **changes: Any) -> Task:
    """The asset `three` in a batch of another baker, or of this one."""
    from lightkiln_pipeline import program

    facts = {"baker": program.version(program.program()), "key": "0123456789abcdef0123", **changes}
    folder = show.parent / "baked" / "three"
    settings = {"error": "20%", "texels_per_metre": 10.0}
    return Task("three", str(show.parent / "three.usda"), str(folder), settings=settings, **facts)


def test_other_bakers_and_other_scenes_are_refused(show: Path) -> None:
    def ignore(_: dict[str, Any]) -> None: ...

    other = task(show, baker="lightkiln 0.0.0")
    for part in (
        lambda: solve_asset(other, ignore),
        lambda: gather_asset(other, range(1), 1, ignore),
        lambda: merge_asset(other, ignore),
    ):
        with pytest.raises(EnvironmentFault, match=r"the batch lightkiln 0\.0\.0"):
            part()
    own = in_parts(task(show), 2)
    with pytest.raises(PipelineError, match="run its `solve` first"):
        gather_asset(own, range(1), 2, ignore)
    solve_asset(own, ignore)
    glb = next(show.parent.rglob(".three.*.tiles/three.glb"))
    glb.write_bytes((show.parent / "kit/box.glb").read_bytes())
    with pytest.raises(PipelineError, match="is not the scene that was solved"):
        gather_asset(own, range(2), 2, ignore)
