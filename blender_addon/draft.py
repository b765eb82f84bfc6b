# SPDX-License-Identifier: GPL-3.0-or-later
"""Shows the states of a running bake in place of the lightmap, and brings back what was shown before.

States lie in an image of their own, so that the lightmap of an earlier bake is not touched until the new one is done.
"""

from __future__ import annotations

from pathlib import Path

import bpy

from .apply import Placed, apply, placed_now, remove, set_view
from .result_files import LINEAR, store_image

NAME = "Lightkiln State"


class Draft:
    """What a bake shows before it is done."""

    def __init__(self, scene: bpy.types.Scene) -> None:
        """Remembers what the scene shows."""
        image = scene.lightkiln.image
        self._before = image.session_uid if image else 0
        self._placed = placed_now(scene) if image else []
        self._view = scene.lightkiln.view
        self._uid = 0

    @property
    def is_shown(self) -> bool:
        """True if a state was shown."""
        return self._uid != 0

    @property
    def is_first(self) -> bool:
        """True if the scene had no lightmap before."""
        return self._before == 0

    def show(self, scene: bpy.types.Scene, exr: Path, placed: list[Placed]) -> None:
        """Shows a state."""
        image = _image(self._uid)
        if image is not None and scene.lightkiln.image == image:
            image.reload()
            return
        image = bpy.data.images.load(str(exr))
        image.name, image.alpha_mode = NAME, "NONE"
        image.colorspace_settings.name = LINEAR
        self._uid = image.session_uid
        apply(scene, image, placed)

    def end(self, scene: bpy.types.Scene) -> None:
        """Makes room for the result: the lightmap of before is the scene's again, though it is not shown."""
        if self.is_shown:
            scene.lightkiln.image = _image(self._before)

    def clear(self) -> None:
        """Removes the states' image, which nothing shows any more."""
        image = _image(self._uid)
        if image is not None:
            bpy.data.images.remove(image)
        self._uid = 0

    def keep(self, scene: bpy.types.Scene, exr: Path) -> None:
        """Makes the last state the lightmap."""
        placed = placed_now(scene)
        scene.lightkiln.image = None
        apply(scene, store_image(scene, exr), placed)
        self.clear()

    def hide(self, scene: bpy.types.Scene) -> None:
        """Shows nothing, so that what the bake changed can be taken back."""
        remove(scene, keep_maps=True, keep_image=True)

    def restore(self, scene: bpy.types.Scene) -> None:
        """Shows what was shown before."""
        image = _image(self._before)
        scene.lightkiln.image = image
        if image is not None:
            alive = [p for p in self._placed if _lives(p)]
            apply(scene, image, alive)
            set_view(scene, self._view)
        self.clear()


def _image(uid: int) -> bpy.types.Image | None:
    """An image, found anew: undo replaces Blender's data."""
    return next((image for image in bpy.data.images if image.session_uid == uid), None) if uid else None


def _lives(placed: Placed) -> bool:
    """True if object and carrier were not deleted meanwhile."""
    try:
        return bool(placed.ob.name and placed.carrier.name and placed.uv_map in placed.ob.data.uv_layers)
    except ReferenceError:
        return False
