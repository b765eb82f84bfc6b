# SPDX-License-Identifier: GPL-3.0-or-later
"""What a scene remembers of the bake that its lightmap comes from, so that it can be relit."""

from __future__ import annotations

import json
from pathlib import Path

import bpy

from .light_state import LightState
from .relight_plan import Plan, plan
from .result_files import store_groups

SOLUTION = "solution.lk"


def remember(scene: bpy.types.Scene, results: Path, baked: LightState) -> None:
    """Keeps the light groups of a bake and the state of the scene that was baked."""
    forget(scene)
    if not (results / SOLUTION).is_file():
        return
    report = json.loads((results / "report.json").read_text(encoding="utf-8"))
    scene.lightkiln.solution = store_groups(scene, results)
    scene.lightkiln.baked = baked.grouped_as([group["name"] for group in report["groups"]]).to_text()


def forget(scene: bpy.types.Scene) -> None:
    """The lightmap cannot be relit any more."""
    settings = scene.lightkiln
    settings.solution = settings.baked = settings.relit = settings.stale = ""


def solution(scene: bpy.types.Scene) -> Path | None:
    """The folder of the light groups, if it is still there."""
    settings = scene.lightkiln
    if not settings.solution or settings.image is None:
        return None
    folder = Path(bpy.path.abspath(settings.solution))
    return folder if (folder / SOLUTION).is_file() else None


def planned(scene: bpy.types.Scene, now: LightState) -> Plan:
    """What relighting would do for the scene as it is now."""
    return plan(LightState.from_text(scene.lightkiln.baked), now)
