"""An asset in parts, wherever each runs: solve once, gather tiles anywhere, merge to results.

The parts meet in a folder beside the results, which is named by the asset's key, so that parts of a changed scene never
mix. Each part skips what is there; the merge removes it all.
"""

from __future__ import annotations

import json
import os
import platform
import shutil
import time
from dataclasses import asdict, dataclass
from pathlib import Path

from .. import program
from ..errors import EnvironmentFault, Notes, PipelineError
from .manifest import Settings
from .stamp import Stamp, write_atomically
from .task import (
    Progress,
    Task,
    check_baker,
    finished,
    form_options,
    light_options,
    pairs,
    prepared,
    scratch,
    thread_options,
    tiled,
)

_SOURCE = "source.json"
_SOLUTION = "solution"
_TIMES = "times"


@dataclass(frozen=True)
class _Source:
    """What the baker reads of a scene."""

    glb: str
    """Relative to the folder of the parts."""
    options: list[str]
    """What its kind needs."""
    notes: list[list[str]]
    """Place and message."""


def solve_asset(task: Task, progress: Progress) -> None:
    """Makes what the baker reads, and its solution. Raises PipelineError with the reason if that is impossible."""
    check_baker(task)
    start = time.monotonic()
    settings, scene = Settings.model_validate(task.settings), Path(task.scene)
    work = tiled(Path(task.folder), task.key)
    try:
        work.mkdir(parents=True, exist_ok=True)
        if not (work / _SOURCE).is_file():
            _make_source(scene, work, settings, progress)
    except OSError as error:
        raise EnvironmentFault(f"{error}; free space or correct the folder's rights") from error
    source = _source(work)
    options = [*light_options(settings, scene), *source.options, *thread_options(settings)]
    program.solve(work / source.glb, work / _SOLUTION, options, progress)
    _note_time(work, "solve", start)


def gather_asset(task: Task, parts: range, of: int, progress: Progress) -> None:
    """Gathers some of `of` parts of the tiles, those that are missing."""
    check_baker(task)
    start, solution = time.monotonic(), _solution(task)
    count = program.tiles_of(solution)
    tiles = range(parts.start * count // of, parts.stop * count // of)
    if tiles:
        program.gather(solution, tiles, thread_options(Settings.model_validate(task.settings)), progress)
        _note_time(solution.parent, f"gather {tiles[0]}-{tiles[-1]}", start)


def merge_asset(task: Task, progress: Progress) -> Stamp:
    """Makes the results from all tiles and publishes them."""
    check_baker(task)
    settings, folder = Settings.model_validate(task.settings), Path(task.folder)
    solution = _solution(task)
    # What the parts took on all machines counts.
    start, notes = time.monotonic() - _times(solution.parent), Notes()
    for place, message in _source(solution.parent).notes:
        notes.add(place, message)
    options = [*form_options(settings), *thread_options(settings)]
    with scratch(folder) as work:
        result = program.merge(solution, work, options, progress)
        return finished(task, work, result, notes, start, progress)


def _note_time(work: Path, part: str, start: float) -> None:
    """Keeps how long a part took. One that found all there already leaves the time of the one that did the work."""
    path = work / _TIMES / part
    seconds = time.monotonic() - start
    path.parent.mkdir(exist_ok=True)
    if not path.is_file() or float(path.read_text(encoding="utf-8")) < seconds:
        write_atomically(path, str(seconds))


def _times(work: Path) -> float:
    """Seconds that all parts took together."""
    times = (path for path in (work / _TIMES).glob("*") if not path.name.startswith("."))
    return sum(float(path.read_text(encoding="utf-8")) for path in times)


def _make_source(scene: Path, work: Path, settings: Settings, progress: Progress) -> None:
    """Makes what the baker reads of the scene. Whoever is first gives it; what others make at the same time goes."""
    notes, made = Notes(), work / f"source.{platform.node()}.{os.getpid()}.partial"
    try:
        made.mkdir()
        read, options = prepared(scene, made, settings, notes, progress)
        glb = read.name if read.parent == made else str(read.absolute())
        for path in made.iterdir():
            path.replace(work / path.name)
        source = _Source(glb, options, pairs(notes.list()))
        write_atomically(work / _SOURCE, json.dumps(asdict(source), ensure_ascii=False))
    finally:
        shutil.rmtree(made, ignore_errors=True)


def _source(work: Path) -> _Source:
    """Raises PipelineError if it cannot be read."""
    path = work / _SOURCE
    try:
        return _Source(**json.loads(path.read_text(encoding="utf-8")))
    except (OSError, ValueError, TypeError) as error:
        raise PipelineError(f"{path} cannot be read: {error}; remove {work} and solve again") from error


def _solution(task: Task) -> Path:
    """The folder of the asset's solution. Raises PipelineError if it is not solved."""
    work = tiled(Path(task.folder), task.key)
    if not (work / _SOURCE).is_file():
        raise PipelineError(f"{task.name}: it is not solved as it is now; run its `solve` first")
    return work / _SOLUTION
