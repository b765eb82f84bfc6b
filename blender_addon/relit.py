# SPDX-License-Identifier: GPL-3.0-or-later
"""What a scene remembers of the bake that its lightmap comes from, so that it can be relit."""

from __future__ import annotations

import json
import zlib
from functools import lru_cache
from pathlib import Path

import bpy

from .errors import Note
from .light_state import LightState
from .relight_plan import Plan, plan
from .result_files import empty_groups, store_groups

SOLUTION = "solution.lk"
# Bytes at either end of a solution that are compared.
_SAMPLE = 65536


def remember(scene: bpy.types.Scene, results: Path, baked: LightState) -> Note | None:
    """Keeps the light groups of a bake and the state of the scene that was baked, or says why that failed."""
    before = _folder(scene)
    forget(scene)
    try:
        if not (results / SOLUTION).is_file():
            # What an earlier bake left would pass for groups of this one.
            if before is not None:
                empty_groups(before)
            return None
        folder = store_groups(scene, results)
    except OSError as error:
        reason = f"its light groups cannot be kept ({error.strerror}), so it cannot be relit: free some space"
        return Note(scene.name, reason)
    report = json.loads((results / "report.json").read_text(encoding="utf-8"))
    scene.lightkiln.solution, scene.lightkiln.solution_stamp = folder, _stamp(results / SOLUTION)
    scene.lightkiln.baked = baked.grouped_as([group["name"] for group in report["groups"]]).to_text()
    return None


def forget(scene: bpy.types.Scene) -> None:
    """The lightmap cannot be relit any more."""
    settings = scene.lightkiln
    settings.solution = settings.solution_stamp = settings.baked = settings.relit = settings.stale = ""


def solution(scene: bpy.types.Scene) -> Path | None:
    """The folder of the light groups, if they are still there and not those of another bake."""
    folder = _folder(scene)
    if folder is None or not (folder / SOLUTION).is_file():
        return None
    return folder if _stamp(folder / SOLUTION) == scene.lightkiln.solution_stamp else None


def _folder(scene: bpy.types.Scene) -> Path | None:
    settings = scene.lightkiln
    if not settings.solution or settings.image is None:
        return None
    # The lightmap's path is the one that Blender keeps right when the file is saved elsewhere.
    return Path(bpy.path.abspath(settings.image.filepath)).parent / settings.solution


def _stamp(path: Path) -> str:
    state = path.stat()
    return _read_stamp(path, state.st_mtime_ns, state.st_size)


@lru_cache(maxsize=16)
def _read_stamp(path: Path, _changed: int, size: int) -> str:
    """What tells one bake's solution from another's: its size and how it begins and ends."""
    with path.open("rb") as file:
        begin = file.read(_SAMPLE)
        file.seek(max(size - _SAMPLE, 0))
        return f"{size}-{zlib.crc32(begin):08x}-{zlib.crc32(file.read()):08x}"


def planned(scene: bpy.types.Scene, now: LightState) -> Plan:
    """What relighting would do for the scene as it is now."""
    return plan(LightState.from_text(scene.lightkiln.baked), now)
