# SPDX-License-Identifier: GPL-3.0-or-later
"""What a bake changed in the file before it was finished, so that a bake that fails leaves the file as it was."""

from __future__ import annotations

import bpy
import numpy as np
import numpy.typing as npt
from mathutils import Matrix

from .unwrap import GAP, MAP, SIDE, remove_map, unwrap


class Changes:
    """Makes changes and can take them back."""

    def __init__(self) -> None:
        """Nothing is changed yet."""
        # Mesh → its map and marks before, if it had any.
        self._maps: dict[int, tuple[npt.NDArray[np.float32], float, float] | None] = {}
        # Object → the mesh that it had.
        self._meshes: dict[int, int] = {}

    def unwrap(self, mesh: bpy.types.Mesh, matrix: Matrix, gap: float) -> None:
        """Makes or renews the mesh's own map."""
        layer = mesh.uv_layers.get(MAP)
        before = None
        if layer is not None:
            uv = np.empty(2 * len(mesh.loops), np.float32)
            layer.uv.foreach_get("vector", uv)
            before = (uv, mesh[SIDE], mesh[GAP])
        self._maps.setdefault(mesh.session_uid, before)
        unwrap(mesh, matrix, gap)

    def make_single_user(self, ob: bpy.types.Object) -> None:
        """Gives the object a mesh of its own."""
        self._meshes[ob.session_uid] = ob.data.session_uid
        ob.data = ob.data.copy()

    def revert(self) -> None:
        """Takes back what can still be found: the user may have gone on working."""
        meshes = {mesh.session_uid: mesh for mesh in bpy.data.meshes}
        for ob in bpy.data.objects:
            shared = meshes.get(self._meshes.get(ob.session_uid, -1))
            if shared is not None:
                own, ob.data = ob.data, shared
                self._maps.pop(own.session_uid, None)
                bpy.data.meshes.remove(own)
        for uid, before in self._maps.items():
            mesh = meshes.get(uid)
            if mesh is None:
                continue
            layer = mesh.uv_layers.get(MAP)
            if before is None:
                remove_map(mesh)
            elif layer is not None and 2 * len(mesh.loops) == len(before[0]):
                layer.uv.foreach_set("vector", before[0])
                mesh[SIDE], mesh[GAP] = before[1], before[2]
                mesh.update()
