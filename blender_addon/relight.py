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
from .relit import planned, solution
from .result_files import PAGE, store_image

# How many sentences on what needs a bake are kept.
MOST_STALE = 20


class Relight:
    """A relighting of one scene. What is to change is read when it is made."""

    def __init__(self, scene: bpy.types.Scene, view_layer: bpy.types.ViewLayer) -> None:
        """Compares the scene with what was baked. Raises BakeError if it cannot be relit."""
        folder = solution(scene)
        if folder is None:
            raise BakeError(
                f"The lightmap of `{scene.name}` has no light groups: switch on Light Groups and bake again"
            )
        self._folder: Path = folder
        plan = planned(scene, light_state.read(scene, view_layer))
        self.settings = plan.settings()
        self.stale = plan.stale
        # What the scene remembers of it; nothing for the light of the bake.
        self._shows = "\n".join(self.settings) if plan.changes_light else ""
        self._scene_uid = scene.session_uid
        self._job: Job | None = None

    @property
    def is_needed(self) -> bool:
        """True if the lightmap does not show these lights yet."""
        scene = self.scene
        return bool(self.settings) and scene is not None and scene.lightkiln.relit != self._shows

    @property
    def scene(self) -> bpy.types.Scene | None:
        """The scene, found anew: undo replaces Blender's data."""
        return next((scene for scene in bpy.data.scenes if scene.session_uid == self._scene_uid), None)

    def note_stale(self) -> None:
        """Tells the panel what needs a bake."""
        scene = self.scene
        if scene is not None:
            more = len(self.stale) - MOST_STALE
            lines = [*self.stale[:MOST_STALE], f"and {more} more"] if more > 0 else self.stale
            if scene.lightkiln.stale != "\n".join(lines):
                scene.lightkiln.stale = "\n".join(lines)

    def steps(self) -> Generator[None, None, None]:
        """Relights. Raises BakeError or Cancelled; the lightmap then shows what it did before."""
        if not self.settings:
            raise BakeError("No light of the bake can be changed: bake again")
        folder = Path(tempfile.mkdtemp(prefix="lightkiln-", dir=bpy.app.tempdir or None))
        try:
            options = [part for change in self.settings for part in ("--set", change)]
            self._job = job = Job(program.find(), "relight", self._folder, folder / "out", options)
            while not job.poll():
                yield
            job.result()
            self._show(folder / "out" / PAGE)
        except OSError as error:
            raise BakeError(
                f"Cannot write `{error.filename or folder}` ({error.strerror}): check that it can be written"
            ) from error
        finally:
            if self._job and not self._job.poll():
                self._job.cancel()
                self._job.wait()
            shutil.rmtree(folder, ignore_errors=True)

    def _show(self, exr: Path) -> None:
        scene = self.scene
        # The lightmap may have been removed meanwhile.
        if scene is None or scene.lightkiln.image is None or not scene.lightkiln.solution:
            raise Cancelled
        store_image(scene, exr)
        scene.lightkiln.relit = self._shows
