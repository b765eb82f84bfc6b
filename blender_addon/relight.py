# SPDX-License-Identifier: GPL-3.0-or-later
"""One relighting from beginning to end: changed lights → the same lightmap in their light, without a bake.

Like a bake it is a generator: run through headless, moved on by a timer in the window.
"""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Generator
from pathlib import Path

import bpy

from . import light_state, program
from .errors import BakeError, Cancelled
from .job import Job
from .relight_plan import Plan
from .relit import planned, solution
from .result_files import PAGE, store_image

# How many sentences on what needs a bake are kept.
MOST_STALE = 20


class Relight:
    """A relighting of one scene."""

    def __init__(self, scene: bpy.types.Scene, view_layer: bpy.types.ViewLayer, *, anyway: bool) -> None:
        """Prepares to relight, if the lightmap does not show the lights as they are, or anyway.

        Raises BakeError if the scene cannot be relit.
        """
        folder = solution(scene)
        if folder is None:
            raise BakeError(
                f"The lightmap of `{scene.name}` has no light groups: switch on Light Groups and bake again"
            )
        # True once the baker works on it.
        self.is_working = False
        self.stale: list[str] = []
        self._folder: Path = folder
        self._anyway = anyway
        self._scene_uid = scene.session_uid
        self._layer = view_layer.name
        self._job: Job | None = None

    @property
    def scene(self) -> bpy.types.Scene:
        """The scene, found anew: undo replaces Blender's data. Raises Cancelled if it or its lightmap are gone."""
        found = next((scene for scene in bpy.data.scenes if scene.session_uid == self._scene_uid), None)
        if found is None or found.lightkiln.image is None or not found.lightkiln.solution:
            raise Cancelled
        return found

    def steps(self) -> Generator[None, None, None]:
        """Relights. Raises BakeError or Cancelled; the lightmap then shows what it did before."""
        plan = yield from self._plan()
        # What the scene remembers of it; nothing for the light of the bake.
        shows = "\n".join(plan.settings()) if plan.changes_light else ""
        if not plan.settings():
            if self._anyway:
                raise BakeError("No light of the bake can be changed: bake again")
            return
        if self._anyway or self.scene.lightkiln.relit != shows:
            self.is_working = True
            yield from self._run(plan.settings(), shows)

    def _plan(self) -> Generator[None, None, Plan]:
        """Compares the scene with what was baked, and tells the panel what needs a bake."""
        scene = self.scene
        layer = scene.view_layers.get(self._layer) or scene.view_layers[0]
        try:
            now = yield from light_state.reading(scene, layer)
        except ReferenceError as error:
            # Something was removed meanwhile; that is a change of its own, which is looked at next.
            raise Cancelled from error
        plan = planned(self.scene, now)
        self.stale = plan.stale
        more = len(plan.stale) - MOST_STALE
        lines = [*plan.stale[:MOST_STALE], f"and {more} more"] if more > 0 else plan.stale
        if self.scene.lightkiln.stale != "\n".join(lines):
            self.scene.lightkiln.stale = "\n".join(lines)
        return plan

    def _run(self, settings: list[str], shows: str) -> Generator[None, None, None]:
        """Lets the baker work, and shows what it made."""
        folder = Path(tempfile.mkdtemp(prefix="lightkiln-", dir=bpy.app.tempdir or None))
        try:
            options = [part for change in settings for part in ("--set", change)]
            self._job = job = Job(program.find(), "relight", self._folder, folder / "out", options)
            while not job.poll():
                yield
            job.result()
            scene = self.scene
            store_image(scene, folder / "out" / PAGE)
            scene.lightkiln.relit = shows
        except OSError as error:
            raise BakeError(
                f"Cannot write `{error.filename or folder}` ({error.strerror}): check that it can be written"
            ) from error
        finally:
            if self._job and not self._job.poll():
                self._job.cancel()
                self._job.wait()
            shutil.rmtree(folder, ignore_errors=True)
