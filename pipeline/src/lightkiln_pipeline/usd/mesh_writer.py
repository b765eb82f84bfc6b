"""Writes meshes: a mesh with its surfaces → primitives of a glTF document, and cylinder lights as emissive meshes.

Vertices carry the source corner that they are, so that the lightmap's coordinates find their way back (see layer.py).
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from pxr import UsdGeom, UsdLux

from ..errors import Notes
from ..glb.writer import EXTENSION, GlbWriter, Json
from .lights import Tube
from .materials import Materials, WrittenMaterial
from .mesh import MeshData
from .solids import tube
from .stage import Scene
from .surfaces import Channel, Color, Surface

CORNER = "_CORNER"
"""Vertex attribute: number of a source corner, plus one, as two floats (high, low 16 bits)."""


class MeshWriter:
    """Writes the meshes of one scene."""

    def __init__(self, glb: GlbWriter, materials: Materials, scene: Scene, notes: Notes) -> None:
        """Writes into `glb`."""
        self._glb, self._materials, self._scene, self._notes = glb, materials, scene, notes

    def mesh(
        self,
        prim: Any,
        data: MeshData,
        parts: list[tuple[Surface, npt.NDArray[np.int64]]],
        light: Color | None,
        fixed: npt.NDArray[np.float64] | None,
    ) -> int:
        """A mesh whose `parts` are surfaces with their triangles; returns its index.

        `light`: radiance of a mesh light, W/(m²·sr). `fixed`: a matrix that the vertices take.
        """
        mode = str(UsdLux.LightAPI(prim).GetMaterialSyncModeAttr().Get()) if light is not None else ""
        # Faces without material have two sides in Blender, which does not say so.
        said = UsdGeom.Gprim(prim).GetDoubleSidedAttr().HasAuthoredValue()
        double_sided = data.double_sided or (self._scene.blender and not said)
        primitives = []
        for surface, triangles in parts:
            shown, added = _lit_surface(surface, light, mode)
            material = self._materials.write(shown, double_sided=double_sided, light=added)
            primitives.append(self._primitive(prim, data, material, triangles, fixed))
        return self._glb.push("meshes", {"name": prim.GetName(), "primitives": primitives})

    def _primitive(
        self,
        prim: Any,
        data: MeshData,
        material: WrittenMaterial,
        triangles: npt.NDArray[np.int64],
        fixed: npt.NDArray[np.float64] | None,
    ) -> Json:
        corners, local = np.unique(triangles, return_inverse=True)
        positions, normals = data.points[data.corner_points[corners]], data.normals[corners]
        turned = local.reshape(-1, 3)
        if fixed is not None:
            linear = fixed[:3, :3]
            positions = positions @ linear.T + fixed[:3, 3]
            # Normals follow the cofactors, which exist even where the matrix flattens.
            cofactors = np.stack([np.cross(linear[i - 2], linear[i - 1]) for i in range(3)])
            normals = normals @ (cofactors.T * np.sign(np.linalg.det(linear) or 1.0))
            normals = normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30)
            turned = turned[:, ::-1] if np.linalg.det(linear) < 0 else turned
        columns: dict[str, npt.NDArray[np.float64]] = {"POSITION": positions, "NORMAL": normals}
        for number, name in enumerate(material.uv_sets):
            values = data.uv_sets.get(name)
            if values is None:
                self._notes.add(prim.GetPath(), f"it has no primvars:{name}, which its textures need; zeros are used")
                values = np.zeros((len(data.corner_points), 2))
            columns[f"TEXCOORD_{number if number == 0 else number + 1}"] = _upright(values[corners])
        if material.color_primvar is not None:
            colors = data.colors.get(material.color_primvar)
            if colors is None:
                message = f"it has no primvars:{material.color_primvar}, which its material needs; white is used"
                self._notes.add(prim.GetPath(), message)
            else:
                columns["COLOR_0"] = np.clip(colors[corners], 0.0, 1.0)
        if data.lightmap_uv is not None:
            columns["TEXCOORD_1"] = data.lightmap_uv[corners]
            columns.setdefault("TEXCOORD_0", columns["TEXCOORD_1"])
            columns[CORNER] = _corner_names(data, corners)
        attributes = {k: self._glb.attribute(v, bounds=k == "POSITION") for k, v in columns.items()}
        return {"attributes": attributes, "indices": self._glb.indices(turned), "material": material.index}

    def tube(self, cylinder: Tube) -> None:
        """A cylinder light as a mesh that emits, reflects nothing and has no lightmap."""
        points, counts, indices, normals = tube(cylinder.radius, cylinder.length, "X")
        world = cylinder.world
        placed = points[indices] @ world[:3, :3].T + world[:3, 3]
        turned = normals @ np.linalg.inv(world[:3, :3])
        quads = np.arange(len(indices)).reshape(len(counts), 4)
        triangles = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
        if np.linalg.det(world[:3, :3]) < 0:
            triangles = triangles[:, ::-1]
        black = Surface(cylinder.name, Channel((0.0, 0.0, 0.0)))
        color: Color = (float(cylinder.radiance[0]), float(cylinder.radiance[1]), float(cylinder.radiance[2]))
        material = self._materials.write(black, double_sided=False, light=color)
        attributes = {
            "POSITION": self._glb.attribute(placed, bounds=True),
            "NORMAL": self._glb.attribute(turned / np.linalg.norm(turned, axis=1, keepdims=True)),
        }
        primitive = {"attributes": attributes, "indices": self._glb.indices(triangles), "material": material.index}
        mesh = self._glb.push("meshes", {"name": cylinder.name, "primitives": [primitive]})
        unseen = {"lightmap": False}
        self._glb.root({"name": cylinder.name, "mesh": mesh, "extensions": {EXTENSION: unseen}})


def _corner_names(data: MeshData, corners: npt.NDArray[np.int64]) -> npt.NDArray[np.float64]:
    """Numbers of source corners, plus one; zero for corners that refinement made."""
    numbers = data.source_corners[corners] + 1
    return np.stack([numbers // 65536, numbers % 65536], axis=1).astype(np.float64)


def _lit_surface(surface: Surface, light: Color | None, mode: str) -> tuple[Surface, Color | None]:
    """The surface of a mesh light, and its own emission."""
    if light is None:
        return surface, None
    if mode == "noMaterialResponse":
        return Surface(surface.name, Channel((0.0, 0.0, 0.0))), light
    dark = Surface(surface.name, surface.base, opacity=surface.opacity, metallic=surface.metallic)
    dark.opacity_threshold = surface.opacity_threshold
    if mode == "materialGlowTintsLight" and max(surface.emission.value) > 0:
        glow = surface.emission.value
        return dark, (glow[0] * light[0], glow[1] * light[1], glow[2] * light[2])
    return dark, light


def _upright(uv: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """USD's v runs up, glTF's down."""
    return np.stack([uv[:, 0], 1.0 - uv[:, 1]], axis=1)
