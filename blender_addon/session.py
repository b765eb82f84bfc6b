# SPDX-License-Identifier: GPL-3.0-or-later
"""The bake that runs now, if any, and what moves it on: a timer in the window, a loop without one."""

from __future__ import annotations

import time
from collections.abc import Generator

import bpy

from .bake import Bake
from .errors import BakeError, Cancelled, Note

# Seconds between two ticks, and seconds of work per tick: the window must stay responsive.
TICK, BUDGET = 0.1, 0.05


class Session:
    """A bake and its generator. There is at most one per Blender."""

    def __init__(self, bake: Bake) -> None:
        """Takes over a bake that has not begun."""
        self.bake = bake
        self.steps: Generator[None, None, None] = bake.steps()
        self.scene_name = bake.scene.name


running: Session | None = None
# The message of the last bake that failed, for the panel.
failure = ""


def start(scene: bpy.types.Scene, view_layer: bpy.types.ViewLayer, *, progressive: bool = False) -> Session:
    """Makes a bake the running one, which shows its states or not. Raises BakeError if another one runs."""
    global running, failure
    if running is not None:
        raise BakeError(f"`{running.scene_name}` is being baked: wait for it or cancel it")
    failure = ""
    scene.lightkiln.notes.clear()
    running = Session(Bake(scene, view_layer, progressive=progressive))
    return running


def run_blocking(scene: bpy.types.Scene, view_layer: bpy.types.ViewLayer) -> str:
    """Bakes to the end. Returns a summary; raises BakeError."""
    session = start(scene, view_layer)
    try:
        for _ in session.steps:
            pass
    except BakeError as error:
        _end(session, str(error))
        raise
    except BaseException:
        _end(session, "The bake was interrupted")
        raise
    _end(session, "")
    summary: str = scene.lightkiln.summary
    return summary


def run_in_window() -> None:
    """Lets a timer run the bake while the user works on."""
    bpy.app.timers.register(_tick, first_interval=0.01)


def cancel() -> None:
    """Asks the running bake to end."""
    if running is not None:
        running.bake.cancel()


def stop() -> None:
    """Ends the running bake now: Blender quits, loads a file, or the add-on is disabled."""
    session = running
    if session is not None:
        session.bake.cancel()
        session.steps.close()
        _end(session, "")
    if bpy.app.timers.is_registered(_tick):
        bpy.app.timers.unregister(_tick)


def _tick() -> float | None:
    session = running
    if session is None:
        return None
    until = time.monotonic() + BUDGET
    try:
        while time.monotonic() < until:
            next(session.steps)
            if session.bake.progress.stage != "prepare":
                break
    except StopIteration:
        _end(session, "")
        _redraw("")
        bpy.ops.ed.undo_push(message="Lightkiln Bake")
        return None
    except Cancelled:
        kept = "what it had reached is kept" if session.bake.shown else "nothing was changed"
        _end(session, f"Cancelled: {kept}")
    except BakeError as error:
        _end(session, str(error))
    except Exception as error:
        _end(session, f"The bake failed unexpectedly ({error}): please report it")
        _redraw("")
        raise
    else:
        _redraw(status(session.bake))
        return TICK
    _redraw("")
    if failure:
        _popup(failure)
    return None


def _end(session: Session, message: str) -> None:
    """Forgets the session and leaves its notes in the scene."""
    global running, failure
    running, failure = None, message
    try:
        stored = session.bake.scene.lightkiln.notes
    except BakeError:
        return
    stored.clear()
    for note in merged(session.bake.notes):
        item = stored.add()
        item.place, item.message, item.kind = note.place, note.message, note.kind


def merged(notes: list[Note]) -> list[Note]:
    """The notes without repetitions."""
    return list(dict.fromkeys(notes))


def status(bake: Bake) -> str:
    """One line on how far the bake is."""
    progress = bake.progress
    eta = f", {_duration(progress.eta)} left" if progress.eta is not None else ""
    what = f"{bake.shown} shown, {progress.stage}" if bake.shown else progress.stage
    return f"Lightkiln: {what} {100 * progress.done:.0f} %{eta}"


def _duration(seconds: float) -> str:
    return f"{seconds:.0f} s" if seconds < 90 else f"{seconds / 60:.0f} min"


def _popup(message: str) -> None:
    """Reports in Blender's own way: an operator's report reaches the status bar and the info editor."""
    windows = bpy.context.window_manager.windows
    if windows:
        with bpy.context.temp_override(window=windows[0]):
            bpy.ops.lightkiln.report("EXEC_DEFAULT", message=message)


def _redraw(text: str) -> None:
    """Shows the line in the status bar and redraws the panels."""
    for window in bpy.context.window_manager.windows:
        window.workspace.status_text_set(text or None)
        for area in window.screen.areas:
            if area.type in {"PROPERTIES", "VIEW_3D"}:
                area.tag_redraw()


@bpy.app.handlers.persistent
def _before_load(_path: object) -> None:
    stop()


def register() -> None:
    """Ends bakes before another file is loaded."""
    bpy.app.handlers.load_pre.append(_before_load)


def unregister() -> None:
    """Ends the running bake."""
    stop()
    bpy.app.handlers.load_pre.remove(_before_load)
