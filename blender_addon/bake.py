# SPDX-License-Identifier: GPL-3.0-or-later
"""One bake from beginning to end, in steps between which Blender may draw: unwrap, copy the scene, run the baker, show.

`steps` is a generator. Headless it is run through; in the window a timer takes a step whenever Blender has time. The
scene's data is touched in the main thread only, and only until the baker starts and after it has ended.
"""

from __future__ import annotations

import errno
import shutil
import tempfile
import threading
import time
from collections.abc import Callable, Generator, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import bpy

from . import apply, light_state, program, receivers
from .changes import Changes
from .draft import Draft
from .errors import BakeError, Cancelled, Note
from .export.color_bake import baked_colors, wishes
from .export.snapshot import take
from .export.write import Writer
from .job import Job
from .light_state import LightState
from .places import Page, Receiver, arrange
from .relit import forget, remember
from .result_files import PAGE, check_folder, store_glb, store_image

# Seconds between two looks at the baker.
POLL = 0.05
# States are worth their time where the bake aims for less than this error, percent.
COARSE = 15.0


@dataclass
class Progress:
    """What the panel shows while it bakes."""

    stage: str = "prepare"
    done: float = 0.0
    eta: float | None = None
    started: float = field(default_factory=time.monotonic)


class Bake:
    """A bake of one scene."""

    def __init__(self, scene: bpy.types.Scene, view_layer: bpy.types.ViewLayer, *, progressive: bool) -> None:
        """Prepares to bake the scene as the view layer shows it, and to show its states if that is wanted."""
        settings = scene.lightkiln
        # What the lightmap that is shown has reached; empty while none of this bake is.
        self.shown = ""
        self._progressive = progressive and settings.progressive and settings.error < COARSE
        self._draft: Draft | None = None
        self._baked = LightState()
        self.progress = Progress()
        self.notes: list[Note] = []
        self._scene_uid = scene.session_uid
        self._layer = view_layer.name
        self._job: Job | None = None
        self._cancelled = False
        self._folder: Path | None = None
        self._changes = Changes()

    @property
    def scene(self) -> bpy.types.Scene:
        """The scene, found anew: undo replaces Blender's data."""
        for scene in bpy.data.scenes:
            if scene.session_uid == self._scene_uid:
                return scene
        raise BakeError("The scene was removed during the bake: nothing was changed")

    def cancel(self) -> None:
        """Asks the bake to end; it does within a second or so."""
        self._cancelled = True
        if self._job:
            self._job.cancel()

    def export(self, path: Path) -> int:
        """Writes what would be baked, for a bake elsewhere. Returns the side of the page in texels.

        A picture of the world goes beside it. Raises BakeError if there is nothing to bake.
        """
        apply.set_view(self.scene, "ORIGINAL")
        page, _, writer = self._read(self.scene, path.parent)
        writer.finish(path)
        return page.side

    def steps(self) -> Generator[None, None, None]:
        """Bakes. Raises BakeError or Cancelled; the scene then shows what it did before."""
        self._folder = Path(tempfile.mkdtemp(prefix="lightkiln-", dir=bpy.app.tempdir or None))
        try:
            yield from self._bake(self._folder)
        except BaseException as error:
            self._take_back()
            if not isinstance(error, OSError):
                raise
            full = error.errno in {errno.ENOSPC, errno.EDQUOT}
            remedy = "free some space" if full else "check that it can be written"
            raise BakeError(f"Cannot write `{error.filename or self._folder}` ({error.strerror}): {remedy}") from error
        finally:
            if self._job and not self._job.poll():
                self._job.cancel()
                self._job.wait()
            shutil.rmtree(self._folder, ignore_errors=True)

    def _bake(self, folder: Path) -> Iterator[None]:
        baker = program.find()
        scene = self.scene
        check_folder(scene)
        # The bake reads the scene's own materials, not the lit ones of the last bake.
        shown = scene.lightkiln.view
        apply.set_view(scene, "ORIGINAL")
        try:
            page, chosen, writer = self._read(scene, folder)
        finally:
            if shown != "ORIGINAL":
                apply.set_view(scene, shown)
        yield

        self.progress.stage = "export"
        path = folder / "scene.glb"
        yield from self._in_thread(lambda: writer.finish(path))
        self._draft = Draft(scene)
        self._job = job = Job(baker, "bake", path, folder / "out", self._options(page))
        yield from self._watch(job, folder / "out", page, chosen)
        job.result()
        self.notes += job.notes
        settings = self.scene.lightkiln
        if settings.groups and settings.light != "combined":
            message = "there are no light groups of direct or indirect light alone: bake combined light to relight it"
            self.notes.append(Note(self.scene.name, message))
        self.progress.stage, self.progress.done, self.progress.eta = "apply", 1.0, None
        yield
        self._finish(folder / "out", page, chosen)

    def _options(self, page: Page) -> list[str]:
        """What the baker is told."""
        settings = self.scene.lightkiln
        options = ["--uv", "keep", "--resolution", str(page.side), "--quantity", "radiance"]
        options += ["--error", f"{settings.error:.4g}%"]
        if self._progressive:
            options.append("--progressive")
        # Groups and a part of the light exclude each other; the panel says so.
        if settings.light != "combined":
            options += ["--light", settings.light]
        elif settings.groups:
            options.append("--groups")
        return options

    def _read(self, scene: bpy.types.Scene, folder: Path) -> tuple[Page, list[Receiver], Writer]:
        """Everything that needs the scene, in one go."""
        layer = scene.view_layers[self._layer]
        objects = receivers.candidates(scene, layer)
        maps, notes = receivers.prepare(scene, objects, self._changes)
        self.notes += notes
        layer.update()
        self._baked = light_state.read(scene, layer)
        snapshot = take(scene, layer)
        chosen, notes = receivers.chosen(scene, layer, snapshot, maps)
        self.notes += notes
        if not chosen:
            left_out = self.notes + snapshot.notes
            why = f" (`{left_out[0].place}`: {left_out[0].message})" if left_out else ""
            raise BakeError(f"No object can get a lightmap{why}: select or show a mesh with faces")
        page = arrange(chosen, snapshot.meshes, scene.lightkiln.resolution_limit)
        if page.lowered < 0.95:
            message = f"the resolution limit lowers the texel density to {100 * page.lowered:.0f} %: raise it"
            self.notes.append(Note(scene.name, message))
        writer = Writer(snapshot, page, chosen)
        with baked_colors(wishes(page, chosen, writer)) as baked:
            writer.collect(scene.world, folder, baked.colors)
        self.notes += baked.notes
        self.notes += writer.notes
        if writer.is_dark():
            raise BakeError(
                f"The scene `{scene.name}` has no light: add a lamp, a world colour or an emissive material"
            )
        return page, chosen, writer

    def _in_thread(self, work: Callable[[], None]) -> Iterator[None]:
        """Runs work that needs no Blender data while the window lives on."""
        failure: list[Exception] = []

        def run() -> None:
            try:
                work()
            except Exception as error:  # Raised again in the main thread.
                failure.append(error)

        thread = threading.Thread(target=run)
        thread.start()
        while thread.is_alive():
            yield
            thread.join(POLL if bpy.app.background else 0)
        if failure:
            raise failure[0]

    def _watch(self, job: Job, results: Path, page: Page, chosen: list[Receiver]) -> Iterator[None]:
        """Follows the baker to its end and shows its states."""
        seen = 0
        while not job.poll():
            if self._cancelled:
                job.cancel()
            elif job.states > seen and job.reached != "final":
                seen = job.states
                self._show(results / PAGE, page, chosen, job.reached)
            self.progress.stage, self.progress.done, self.progress.eta = job.stage, job.done, job.eta
            yield
            if bpy.app.background:
                time.sleep(POLL)

    def _show(self, exr: Path, page: Page, chosen: list[Receiver], reached: str) -> None:
        """Shows a state of the bake."""
        assert self._draft
        self._draft.show(self.scene, exr, self._placed(page, chosen, []))
        self.shown = reached

    def _take_back(self) -> None:
        """Brings back what the scene showed before. The first lightmap that a scene gets is kept, though unfinished."""
        draft = self._draft
        try:
            scene = self.scene
        except BakeError:
            draft = None
        if draft is None or not draft.is_shown:
            self._changes.revert()
        elif draft.is_first and self._folder and (self._folder / "out" / PAGE).is_file():
            draft.keep(scene, self._folder / "out" / PAGE)
            forget(scene)
        else:
            draft.hide(scene)
            self._changes.revert()
            draft.restore(scene)
            self.shown = ""

    def _finish(self, results: Path, page: Page, chosen: list[Receiver]) -> None:
        """Puts the results in their place and shows them."""
        if self._cancelled:
            raise Cancelled
        assert self._draft
        scene = self.scene
        placed = self._placed(page, chosen, self.notes)
        # Files first: if one cannot be written, the scene still shows what it did.
        if scene.lightkiln.write_glb:
            store_glb(scene, results / "scene.lit.glb")
        self._draft.end(scene)
        image = store_image(scene, results / PAGE)
        apply.apply(scene, image, placed)
        self._draft.clear()
        self.shown = ""
        note = remember(scene, results, self._baked)
        self.notes += [note] if note else []
        seconds = time.monotonic() - self.progress.started
        scene.lightkiln.summary = f"{len(placed)} objects on {page.side} × {page.side} texels in {seconds:.1f} s"

    def _placed(self, page: Page, chosen: list[Receiver], notes: list[Note]) -> list[apply.Placed]:
        """Who shows which part of the page; notes on those that cannot any more."""
        by_uid = {ob.session_uid: ob for ob in bpy.data.objects}
        instanced = {r.instance.key[0] for r in chosen if r.instance.key[1]}
        placed: list[apply.Placed] = []
        for receiver in chosen:
            uid, parent, _ = receiver.instance.key
            ob, carrier = by_uid.get(uid), by_uid.get(parent or uid)
            if ob is None or carrier is None:
                message = "it was deleted during the bake; its part of the lightmap is left unused"
                notes.append(Note(receiver.instance.name, message))
                continue
            if receiver.uv_map not in ob.data.uv_layers:
                message = f"it lost its UV map `{receiver.uv_map}` during the bake: bake again"
                notes.append(Note(receiver.instance.name, message))
                continue
            attribute = apply.attribute_name(ob, instanced=uid in instanced)
            values = page.places[receiver.instance.key].values
            placed.append(apply.Placed(ob, carrier, attribute, receiver.uv_map, values))
        return placed
