"""Batches as users run them: only what changed, failures, kills, Dask and Open Job Description."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import time
from pathlib import Path

import pytest

from batches import ALL, LAMP, MANIFEST, batch, command, openjd, states
from stages import FLOOR, write_stage


def test_only_what_changed_is_baked(show: Path) -> None:
    folder = show.parent
    events = batch("run", show, "--json")
    assert states(events) == dict.fromkeys(ALL, "baked")
    assert any(e["event"] == "progress" and e["stage"] == "gather" and e["asset"] == "one" for e in events)
    assert states(batch("run", show, "--json")) == dict.fromkeys(ALL, "current")

    (folder / "three.usda").touch()
    assert states(batch("run", show, "--json")) == dict.fromkeys(ALL, "current")

    shared = folder / "shared" / "floor.usda"
    shared.write_text(shared.read_text().replace("(0, 0, 0)]", "(0.5, 0, 0)]"))
    assert states(batch("run", show, "--json", "--dry-run"))["one"] == "would bake"
    after = states(batch("run", show, "--json"))
    assert after == {"one": "baked", "two": "baked", "three": "current", "kit/box": "current"}

    (folder / "baked" / "three" / "lightmap_0.exr").unlink()
    assert states(batch("run", show, "--json"))["three"] == "baked"

    show.write_text(MANIFEST.replace("20", "21"))
    assert states(batch("run", show, "--json")) == dict.fromkeys(ALL, "baked")


def test_results_and_reports_are_there(show: Path) -> None:
    batch("run", show)
    out = show.parent / "baked"
    assert {"lightmap_0.exr", "one.lit.glb", "one.lightmap.usdc", "report.json", "batch.html", "batch.json"} <= {
        p.name for p in (out / "one").iterdir()
    }
    page = (out / "report.html").read_text()
    assert "kit/box" in page and "data:image/png;base64," in page
    data = json.loads((out / "report.json").read_text())
    assert {a["name"]: a["state"] for a in data["assets"]} == dict.fromkeys(ALL, "baked")
    # Scenes as small as these may have too few texels for an audit.
    assert all(a["facts"]["verdict"] in ("met", "uncertain", "missed", None) for a in data["assets"])
    assert any(a["facts"]["verdict"] == "met" and a["facts"]["error"] < 0.1 for a in data["assets"])
    assert "% met" in page
    assert not list(out.rglob(".*partial*")), "nothing half-done stays behind"


def test_direct_and_indirect_light_add_up(show: Path) -> None:
    floor = FLOOR.replace("(0, 0, 0)]", "(0.8, 0.8, 0.8)]")
    upright = "(-.025, 0, -.025), (.025, 0, -.025), (.025, .05, -.025), (-.025, .05, -.025)"
    points = "(-.025, 0, .025), (.025, 0, .025), (.025, 0, -.025), (-.025, 0, -.025)"
    wall = floor.replace(points, upright).replace('"Floor"', '"Wall"')
    write_stage(show.parent / "corner.usda", floor + wall + LAMP)
    mean = {}
    for light in ("combined", "direct", "indirect"):
        rule = f'scenes = ["corner.usda"]\nlight = "{light}"'
        show.write_text(MANIFEST.replace('scenes = ["*.usda", "kit/*.glb"]', rule))
        assert states(batch("run", show, "--json")) == {"corner": "baked"}
        report = json.loads((show.parent / "baked" / "corner" / "report.json").read_text())
        mean[light] = sum(report["atlas"]["pages"][0]["mean"])
    assert 0 < mean["indirect"] < mean["direct"]
    assert mean["direct"] + mean["indirect"] == pytest.approx(mean["combined"], rel=0.01)


def test_a_failure_is_named_and_the_batch_goes_on(show: Path) -> None:
    (show.parent / "broken.usda").write_text("#usda 1.0\ndef {")
    (show.parent / "kit" / "torn.glb").write_bytes(b"glTF\x02\0\0\0")
    events = batch("run", show, "--json", "--keep-going", expect=1)
    assert states(events) == {**dict.fromkeys(ALL, "baked"), "broken": "failed", "kit/torn": "failed"}
    message = next(
        e["message"] for e in events if e["event"] == "asset" and e.get("name") == "broken" and e["state"] == "failed"
    )
    assert "broken.usda" in message
    assert "broken" in (show.parent / "baked" / "report.html").read_text()


def test_without_keep_going_nothing_new_starts_after_a_failure(show: Path) -> None:
    (show.parent / "a_broken.usda").write_text("#usda 1.0\ndef {")
    events = batch("run", show, "--json", "--jobs", "1", expect=1)
    assert states(events)["a_broken"] == "failed"
    assert "baked" not in states(events).values()


def test_exit_codes(show: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    batch("run", tmp_path / "none.toml", expect=2)
    batch("run", show, "--no-such-option", expect=2)
    monkeypatch.setenv("LIGHTKILN_BIN", str(tmp_path / "no-baker"))
    batch("run", show, expect=3)


def slow(show: Path) -> None:
    """Makes one asset take many seconds."""
    text = (show.parent / "three.usda").read_text()
    (show.parent / "zlong.usda").write_text(text.replace("SphereLight", "DiskLight"))
    big = MANIFEST + '[[assets]]\nscenes = ["zlong.usda"]\nerror = "0.1%"\ntexels_per_metre = 40000\n'
    show.write_text(big)


def wait_for(path: Path, seconds: float = 60) -> None:
    """Waits until a file is there."""
    end = time.monotonic() + seconds
    while not path.is_file():
        assert time.monotonic() < end, f"{path} did not appear"
        time.sleep(0.05)


@pytest.mark.skipif(os.name == "nt", reason="signals of POSIX")
@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGINT])
def test_what_was_finished_survives_the_end_of_the_batch(show: Path, how: signal.Signals) -> None:
    slow(show)
    running = subprocess.Popen(command("run", show), stderr=subprocess.DEVNULL, start_new_session=True)
    for name in ALL:
        wait_for(show.parent / "baked" / name / "batch.json")
    running.send_signal(how)
    assert running.wait(60) == (130 if how == signal.SIGINT else -signal.SIGKILL)
    before = states(batch("run", show, "--json", "--dry-run"))
    assert before == {**dict.fromkeys(ALL, "current"), "zlong": "would bake"}


@pytest.mark.skipif(os.name == "nt", reason="signals of POSIX")
def test_watch_bakes_again_what_changes(show: Path) -> None:
    out = show.parent / "baked"
    running = subprocess.Popen(command("run", show, "--watch"), stderr=subprocess.PIPE, text=True)
    assert running.stderr is not None
    for line in running.stderr:
        if line.startswith("watching"):
            break
    first = (out / "three" / "batch.json").read_text()
    scene = show.parent / "three.usda"
    scene.write_text(scene.read_text().replace("= 100", "= 200"))
    for line in running.stderr:
        if line.startswith("watching"):
            break
    running.send_signal(signal.SIGINT)
    assert running.wait(60) == 130
    assert (out / "three" / "batch.json").read_text() != first
    assert states(batch("run", show, "--json")) == dict.fromkeys(ALL, "current")


def test_an_output_folder_that_cannot_be_is_an_error(show: Path) -> None:
    (show.parent / "baked").write_text("a file")
    batch("run", show, expect=3)


@pytest.mark.skipif(not Path("/proc").is_dir(), reason="finds processes in /proc")
def test_a_killed_worker_is_tried_again(show: Path) -> None:
    # Bakes that take a while, so that the worker has not finished when it is killed.
    slow = MANIFEST.replace('error = "10%"', 'error = "2%"').replace("texels_per_metre = 20", "texels_per_metre = 100")
    show.write_text(slow.replace("jobs = 2", "jobs = 1"))
    running = subprocess.Popen(command("run", show, "--json"), stdout=subprocess.PIPE, text=True)
    assert running.stdout is not None
    killed = False
    lines = []
    for line in running.stdout:
        lines.append(json.loads(line))
        if not killed and lines[-1]["event"] == "progress":
            killed = kill_workers(running.pid)
    assert running.wait(120) == 0
    assert killed
    assert states(lines) == dict.fromkeys(ALL, "baked")
    report = json.loads((show.parent / "baked" / "report.json").read_text())
    assert max(a["attempts"] for a in report["assets"]) == 2


def kill_workers(parent: int) -> bool:
    """SIGKILL to the batch's own children."""
    children = []
    for task in Path(f"/proc/{parent}/task").iterdir():
        children += (task / "children").read_text().split()
    for child in children:
        os.kill(int(child), signal.SIGKILL)
    return bool(children)


def test_another_baker_is_refused(show: Path) -> None:
    from lightkiln_pipeline.batch.task import Task, run_task
    from lightkiln_pipeline.errors import EnvironmentFault

    task = Task("one", str(show.parent / "one.usda"), str(show.parent / "baked/one"), "key", "lightkiln 0.0.0", {})
    with pytest.raises(EnvironmentFault, match=r"the batch lightkiln 0\.0\.0"):
        run_task(task, lambda _: None)


def test_dask_gives_the_same_bits(show: Path) -> None:
    pytest.importorskip("distributed")
    batch("run", show)
    pages = {p.relative_to(show.parent): p.read_bytes() for p in (show.parent / "baked").rglob("lightmap_*.exr")}
    assert pages
    for name in ALL:
        (show.parent / "baked" / name / "batch.json").unlink()
    assert states(batch("run", show, "--json", "--executor", "dask")) == dict.fromkeys(ALL, "baked")
    assert {p: (show.parent / p).read_bytes() for p in pages} == pages


@pytest.mark.skipif(os.name == "nt", reason="starts a script of POSIX")
def test_bundle_is_accepted_and_runs(show: Path, tmp_path: Path) -> None:
    pytest.importorskip("openjd.cli")
    batch("bundle", show, tmp_path / "job")
    template = tmp_path / "job" / "template.json"
    openjd(tmp_path, "check", template)
    openjd(tmp_path, "run", template, "-p", f"Manifest={show}")
    report = json.loads((show.parent / "baked" / "report.json").read_text())
    assert {a["name"]: a["state"] for a in report["assets"]} == dict.fromkeys(ALL, "current")
