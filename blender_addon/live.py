# SPDX-License-Identifier: GPL-3.0-or-later
"""Keeps lightmaps up to date: watches the scene, waits until the user rests for a moment, and relights.

One relighting runs at a time, and none beside a bake. The timer and the handlers are the only users of this state.
"""

from __future__ import annotations

import time
from collections.abc import Generator

import bpy

from . import material_sync, session
from .errors import BakeError, Cancelled
from .relight import Relight
from .relit import solution

# Seconds between two looks at what runs; of rest before a relighting begins; and the longest that a drag puts it off.
TICK, REST, PATIENCE = 0.05, 0.15, 0.5
_KINDS = (bpy.types.Light, bpy.types.Material, bpy.types.World, bpy.types.Object, bpy.types.ShaderNodeTree)

# The relighting that runs, if any.
running: Relight | None = None
# The message of the last one that failed, for the panel.
failure = ""
_steps: Generator[None, None, None] | None = None
# When the scene changed first and last since it was relit; zero if it did not.
_first = _last = 0.0
# True: what the lightmap shows is not known, as after an undo.
_doubtful = False


def relight_blocking(scene: bpy.types.Scene, view_layer: bpy.types.ViewLayer) -> Relight:
    """Relights to the end. Raises BakeError."""
    global failure
    stop()
    view_layer.update()
    work = Relight(scene, view_layer, anyway=True)
    for _ in work.steps():
        if work.is_working:
            time.sleep(TICK)
    failure = ""
    return work


def begin(scene: bpy.types.Scene, view_layer: bpy.types.ViewLayer, *, anyway: bool) -> None:
    """Begins a relighting that a timer runs; only if the lights have changed, or anyway. Raises BakeError."""
    global running, _steps, failure, _doubtful
    work = Relight(scene, view_layer, anyway=anyway or _doubtful)
    failure, _doubtful = "", False
    running, _steps = work, work.steps()
    _wake()


def stop() -> None:
    """Ends the running relighting."""
    global running, _steps, _first, _last
    if _steps is not None:
        _steps.close()
    running, _steps = None, None
    _first = _last = 0.0


def _wake() -> None:
    if not bpy.app.background and not bpy.app.timers.is_registered(_tick):
        bpy.app.timers.register(_tick, first_interval=TICK)


def _tick() -> float | None:
    """Moves the running relighting on, or begins the next one."""
    global running, _steps, failure
    if _steps is not None:
        try:
            next(_steps)
            return TICK
        except StopIteration:
            pass
        except Cancelled:
            pass
        except BakeError as error:
            failure = str(error)
        running, _steps = None, None
        _redraw()
    return _next()


def _next() -> float | None:
    global _first, _last, failure
    if not _last:
        return None
    if session.running is not None or _renders():
        # The bake that runs may bring all that is missing, and what renders must not change meanwhile.
        return 10 * TICK
    now = time.monotonic()
    if now - _last < REST and now - _first < PATIENCE:
        return TICK
    _first = _last = 0.0
    context = bpy.context
    scene = context.scene
    if scene is None or not scene.lightkiln.live or solution(scene) is None:
        return None
    try:
        begin(scene, context.view_layer, anyway=False)
    except BakeError as error:
        failure = str(error)
    _redraw()
    return TICK if _steps is not None else None


def _renders() -> bool:
    """True while Blender renders or bakes, in a thread of its own that calls handlers, too."""
    return any(bpy.app.is_job_running(job) for job in ("RENDER", "OBJECT_BAKE"))


def _redraw() -> None:
    for window in bpy.context.window_manager.windows:
        for area in window.screen.areas:
            if area.type in {"PROPERTIES", "VIEW_3D"}:
                area.tag_redraw()


@bpy.app.handlers.persistent
def _changed(scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> None:
    if scene.lightkiln.image is None and session.running is None:
        return
    touched = [update.id.original for update in depsgraph.updates if isinstance(update.id, _KINDS)]
    if not touched:
        return
    if not _renders():
        material_sync.follow(scene, [i for i in touched if isinstance(i, bpy.types.Material)])
    # What is changed during a bake is seen to when it ends.
    look(scene)


def look(scene: bpy.types.Scene) -> None:
    """Looks for changes of a scene's lights soon, if it is to be kept up to date."""
    global _first, _last
    if scene.lightkiln.live and (scene.lightkiln.solution or session.running) and not bpy.app.background:
        _last = time.monotonic()
        _first = _first or _last
        _wake()


@bpy.app.handlers.persistent
def _stepped(scene: bpy.types.Scene, _depsgraph: object = None) -> None:
    """After an undo the image may show other light than the scene remembers."""
    global _doubtful
    if scene is not None:
        _doubtful = True
        look(scene)


@bpy.app.handlers.persistent
def _before_load(_path: object) -> None:
    global failure
    failure = ""
    stop()


_HANDLERS = (("depsgraph_update_post", _changed), ("undo_post", _stepped), ("redo_post", _stepped))


def register() -> None:
    """Begins to watch."""
    for name, handler in _HANDLERS:
        getattr(bpy.app.handlers, name).append(handler)
    bpy.app.handlers.load_pre.append(_before_load)


def unregister() -> None:
    """Ends it."""
    stop()
    if bpy.app.timers.is_registered(_tick):
        bpy.app.timers.unregister(_tick)
    bpy.app.handlers.load_pre.remove(_before_load)
    for name, handler in _HANDLERS:
        getattr(bpy.app.handlers, name).remove(handler)
