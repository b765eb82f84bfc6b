"""Runs the baker: arguments → its process, its JSON lines and its result.

The program is the one named in LIGHTKILN_BIN, else the one beside this Python (a wheel puts both there), else on PATH.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any

from .errors import EnvironmentFault, Note, PipelineError

Event = dict[str, Any]


@dataclass
class BakeResult:
    """What a finished bake says."""

    report: dict[str, Any]
    notes: list[Note] = field(default_factory=list)


def program() -> Path:
    """The baker's program. Raises EnvironmentFault if there is none."""
    named = os.environ.get("LIGHTKILN_BIN")
    name = "lightkiln.exe" if os.name == "nt" else "lightkiln"
    candidates = [Path(named)] if named else [Path(sys.executable).parent / name, Path(shutil.which(name) or name)]
    found = next((p for p in candidates if p.is_file()), None)
    if found is None:
        where = (
            f"LIGHTKILN_BIN names `{named}`, which is no file" if named else "it is neither beside Python nor on PATH"
        )
        raise EnvironmentFault(f"the baker `lightkiln` was not found: {where}; install it or set LIGHTKILN_BIN")
    return found.resolve()


@lru_cache
def version(path: Path) -> str:
    """What the program calls itself. Raises EnvironmentFault if it does not run."""
    try:
        done = subprocess.run([path, "--version"], capture_output=True, text=True, check=True, timeout=60)
    except (OSError, subprocess.SubprocessError) as error:
        raise EnvironmentFault(f"{path} does not run: {error}; install the baker again") from error
    return done.stdout.strip()


def bake(scene: Path, folder: Path, options: list[str], progress: Callable[[Event], None]) -> BakeResult:
    """Bakes a GLB into a folder. Raises the error that the baker's exit code stands for, with its message."""
    result, notes = _run("bake", [scene], ["--out", str(folder), *options], progress)
    return BakeResult(dict(result["report"]), notes)


def solve(scene: Path, folder: Path, options: list[str], progress: Callable[[Event], None]) -> None:
    """Writes the solution of a GLB into a folder, unless it is there. Raises as `bake` does."""
    _run("solve", [scene], ["--out", str(folder), *options], progress)


def gather(folder: Path, tiles: range, options: list[str], progress: Callable[[Event], None]) -> None:
    """Gathers those tiles of the folder's solution that are missing. Raises as `bake` does."""
    _run("gather", [folder], ["--tiles", f"{tiles[0]}-{tiles[-1]}", *options], progress)


def merge(solved: Path, folder: Path, options: list[str], progress: Callable[[Event], None]) -> BakeResult:
    """Merges the tiles of a solution into results. Raises as `bake` does."""
    result, notes = _run("merge", [solved], ["--out", str(folder), *options], progress)
    return BakeResult(dict(result["report"]), notes)


def tiles_of(folder: Path) -> int:
    """How many tiles the solution of a folder has. Raises as `bake` does."""
    result, _ = _run("info", [folder], [], lambda _: None)
    return int(result["solution"]["tiles"])


def _run(
    command: str, inputs: list[Path], options: list[str], progress: Callable[[Event], None]
) -> tuple[Event, list[Note]]:
    """Runs the baker; its result with what it warned of. Raises the error that its exit code stands for."""
    words = [str(program()), command, *map(str, inputs), "--json", *options]
    notes: list[Note] = []
    result: Event | None = None
    failure = ""
    with subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, encoding="utf-8") as job:
        try:
            assert job.stdout is not None and job.stderr is not None
            for line in job.stdout:
                event = _event(line)
                if event.get("event") == "warning":
                    notes.append(Note(str(event.get("place", inputs[0].name)), str(event.get("message", ""))))
                elif event.get("event") in ("result", "info"):
                    result = event
                elif event.get("event") == "error":
                    failure = str(event.get("message", ""))
                progress(event)
            said = job.stderr.read().strip()
        except BaseException:
            job.terminate()
            raise
    if job.returncode == 130:
        raise KeyboardInterrupt
    if job.returncode != 0 or result is None:
        kind = EnvironmentFault if job.returncode == 3 else PipelineError
        raise kind(failure or said or f"the baker ended with exit code {job.returncode}")
    return result, notes


def _event(line: str) -> Event:
    try:
        event = json.loads(line)
    except ValueError:
        return {}
    return event if isinstance(event, dict) else {}
