"""Bakes one asset, wherever that runs: task → results in their folder. Knows neither queues nor other assets.

python -m lightkiln_pipeline.batch.task      reads a task as JSON from the standard input, prints JSON lines
"""

from __future__ import annotations

import contextlib
import glob
import json
import os
import platform
import shutil
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

from .. import program
from ..errors import EnvironmentFault, Note, Notes, PipelineError
from .dependencies import USD_KINDS
from .manifest import Settings
from .stamp import Stamp, publish

Progress = Callable[[program.Event], None]


@dataclass(frozen=True)
class Task:
    """Everything that a worker needs to know."""

    name: str
    scene: str
    folder: str
    key: str
    baker: str
    """Version of the baker that the batch was planned with; a worker with another one refuses."""
    settings: dict[str, Any] = field(default_factory=dict)


def in_parts(task: Task, of: int) -> Task:
    """The same, its tiles gathered in so many parts where there are several machines."""
    return replace(task, settings={**task.settings, "tiles": of})


def run_task(task: Task, progress: Progress) -> Stamp:
    """Bakes and publishes. Raises PipelineError with the reason if that is impossible."""
    check_baker(task)
    settings, scene, folder = Settings.model_validate(task.settings), Path(task.scene), Path(task.folder)
    start, notes = time.monotonic(), Notes()
    with scratch(folder) as work:
        # What is only made for the baker is no result.
        made = work / "source"
        made.mkdir()
        glb, extra = prepared(scene, made, settings, notes, progress)
        options = [*light_options(settings, scene), *form_options(settings), *extra]
        result = program.bake(glb, work, [*options, *thread_options(settings)], progress)
        shutil.rmtree(made)
        return finished(task, work, result, notes, start, progress)


def check_baker(task: Task) -> None:
    """Raises EnvironmentFault if this machine has another baker than the batch."""
    found = program.version(program.program())
    if found != task.baker:
        raise EnvironmentFault(f"this worker has {found}, the batch {task.baker}; install the same baker everywhere")


@contextlib.contextmanager
def scratch(folder: Path) -> Iterator[Path]:
    """A folder beside the results, on the same disk, that goes away. What the disk refuses becomes EnvironmentFault."""
    mark = f".{folder.name}.{platform.node() or 'host'}."
    work = folder.parent / f"{mark}{os.getpid()}.partial"
    # What attempts that were killed on this machine have left.
    for left in folder.parent.glob(f"{glob.escape(mark)}*.partial"):
        number = left.name.split(".")[-2]
        if number.isdigit() and not Path(f"/proc/{number}").exists():
            shutil.rmtree(left, ignore_errors=True)
    try:
        work.mkdir(parents=True)
        yield work
    except OSError as error:
        raise EnvironmentFault(f"{error}; free space or correct the folder's rights") from error
    finally:
        shutil.rmtree(work, ignore_errors=True)


def finished(
    task: Task, work: Path, result: program.BakeResult, notes: Notes, start: float, progress: Progress
) -> Stamp:
    """Adds to the baker's results in `work` what is made from them, and publishes all."""
    settings, scene, folder = Settings.model_validate(task.settings), Path(task.scene), Path(task.folder)
    for note in result.notes:
        notes.add(note.place, note.message)
    _finish(scene, folder, work, settings, notes, progress)
    facts = _facts(result.report)
    stamp = Stamp(task.key, task.scene, task.baker, time.monotonic() - start, {}, pairs(notes.list()), facts)
    publish(work, folder, stamp)
    # Of this scene, and of what it was before.
    for left in folder.parent.glob(f".{glob.escape(folder.name)}.*.tiles"):
        shutil.rmtree(left, ignore_errors=True)
    return stamp


def tiled(folder: Path, key: str) -> Path:
    """Where the parts of an asset meet that is baked on several machines, beside its results."""
    return folder.parent / f".{folder.name}.{key[:16]}.tiles"


def light_options(settings: Settings, scene: Path) -> list[str]:
    """Settings that the light depends on, as arguments of the baker."""
    # The page of a .blend is laid out by the add-on, at the density that is asked for.
    laid_out = scene.suffix.lower() == ".blend"
    named = {
        "--error": settings.error,
        "--texels-per-metre": None if laid_out else settings.texels_per_metre,
        "--resolution": None if laid_out else settings.resolution,
        "--unwrapper": settings.unwrapper,
        "--padding": settings.padding,
        "--light": settings.light,
    }
    options = [word for key, value in named.items() if value is not None for word in (key, str(value))]
    return [*options, *(["--groups"] if settings.groups else [])]


def form_options(settings: Settings) -> list[str]:
    """What the pages look like, as arguments of the baker."""
    quantity = ["--quantity", settings.quantity] if settings.quantity else []
    audit = ["--audit", settings.audit] if settings.audit else []
    return [*quantity, *audit, "--force", *(["--float"] if settings.float_pages else [])]


def thread_options(settings: Settings) -> list[str]:
    """How many threads work, as arguments of the baker."""
    return ["--threads", str(settings.threads)] if settings.threads else []


def prepared(scene: Path, folder: Path, settings: Settings, notes: Notes, progress: Progress) -> tuple[Path, list[str]]:
    """The GLB to bake, made in `folder` if it must be, and the options that its kind needs."""
    if settings.textures.formats:
        from ..textures.export import check_formats

        # Before the long work that comes first.
        check_formats(settings.textures)
    kind = scene.suffix.lower()
    glb = folder / f"{scene.stem}.glb"
    if kind in USD_KINDS:
        from ..usd.convert import UsdSettings, convert

        progress({"event": "progress", "stage": "convert", "done": 0.0})
        usd = settings.usd
        units = settings.light_units or "auto"
        wanted = UsdSettings(usd.level, tuple(usd.purposes), usd.time, units, usd.variants, usd.sky_if_unlit)
        for note in convert(scene, glb, wanted).notes:
            notes.add(note.place, note.message)
        return glb, ["--uv", "pack"]
    if kind == ".blend":
        from ..blender import export_blend

        progress({"event": "progress", "stage": "convert", "done": 0.0})
        export = export_blend(scene, glb, settings.texels_per_metre)
        for note in export.notes:
            notes.add(note.place, note.message)
        return glb, ["--uv", "keep", "--resolution", str(export.side)]
    options = ["--light-units", settings.light_units] if settings.light_units else []
    return scene, [*options, *(["--uv", settings.uv] if settings.uv else [])]


def _finish(scene: Path, folder: Path, work: Path, settings: Settings, notes: Notes, progress: Progress) -> None:
    """The layer over a USD scene, and further kinds of texture."""
    if scene.suffix.lower() in USD_KINDS and settings.usd.layer != "none":
        from ..usd.layer import write_layer

        progress({"event": "progress", "stage": "layer", "done": 0.0})
        photometric = None if settings.light_units is None else settings.light_units == "photometric"
        target = work / f"{scene.stem}.lightmap.{settings.usd.layer}"
        lit = work / f"{scene.stem}.lit.glb"
        # The layer is written beside its pages but will lie in `folder`, so its paths start from there.
        write_layer(scene, lit, target, notes, time=settings.usd.time, photometric=photometric, home=folder)
    if settings.textures.formats:
        from ..textures.export import export_textures

        progress({"event": "progress", "stage": "textures", "done": 0.0})
        for page in sorted(work.glob("lightmap_*.exr")):
            export_textures(page, settings.textures)


def _facts(report: dict[str, Any]) -> dict[str, Any]:
    """Figures of the baker's report that a batch's report shows."""
    scene, atlas, audit = report.get("scene", {}), report.get("atlas", {}), report.get("audit") or {}
    return {
        "triangles": scene.get("triangles"),
        "texels": atlas.get("texels"),
        "baked_s": report.get("total", {}).get("wall_s"),
        "error_target": report.get("settings", {}).get("error"),
        "error": audit.get("error", {}).get("value"),
        "verdict": audit.get("verdict"),
        "memory_peak_bytes": report.get("memory_peak_bytes"),
    }


def pairs(notes: list[Note]) -> list[list[str]]:
    """Notes as JSON has them."""
    return [[note.place, note.message] for note in notes]


def main() -> int:
    """Runs the task on the standard input. The last line is a result or an error."""
    task = Task(**json.loads(sys.stdin.readline()))
    threading.Thread(target=_end_with_parent, daemon=True).start()

    def say(event: program.Event) -> None:
        print(json.dumps(event), flush=True)

    try:
        stamp = run_task(task, say)
    except PipelineError as error:
        say({"event": "failed", "message": str(error), "exit_code": error.exit_code})
        return error.exit_code
    say({"event": "finished", "stamp": asdict(stamp)})
    return 0


def _end_with_parent() -> None:
    """The batch holds the other end of the standard input: when it is killed, so is this."""
    with contextlib.suppress(OSError):
        while sys.stdin.readline():
            pass
    if hasattr(os, "killpg") and os.getpgrp() == os.getpid():
        # The baker is in the same group.
        os.killpg(0, signal.SIGTERM)
    os._exit(130)


if __name__ == "__main__":
    sys.exit(main())
