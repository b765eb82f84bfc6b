# SPDX-License-Identifier: GPL-3.0-or-later
"""Where every instance lies in the lightmap: its UV map's own layout is moved and scaled into a rectangle of the page.

In Blender's UV axes (v up): page coordinate = UV × scale + offset, both of which become a custom property of the
object that the material reads. So objects can share a mesh, and baking again does not change a UV map.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from mathutils import Matrix

from .errors import BakeError
from .export.snapshot import Instance, InstanceKey, MeshData
from .packing import pack

Floats = npt.NDArray[np.float32]
# Empty texels around each rectangle.
MARGIN = 2
# Pages are multiples of this, as textures like it.
STEP = 4
# Density is lowered by this factor until everything fits.
SHRINK = 0.95


@dataclass(frozen=True)
class Receiver:
    """An instance that wants a lightmap."""

    instance: Instance
    uv_map: str
    # Texels per metre.
    density: float


@dataclass(frozen=True)
class Place:
    """scale x, scale y, offset x, offset y."""

    values: tuple[float, float, float, float]

    def applied(self, uv: Floats) -> Floats:
        """Coordinates on the page."""
        sx, sy, ox, oy = self.values
        placed = uv.astype(np.float64) * (sx, sy) + (ox, oy)
        return placed.astype(np.float32)


@dataclass(frozen=True)
class Page:
    """The lightmap's side in texels, who lies where, and by how much the density had to be lowered."""

    side: int
    places: dict[InstanceKey, Place]
    lowered: float


@dataclass(frozen=True)
class _Extent:
    """UV bounds of a receiver, and texels per UV unit at full density."""

    low: tuple[float, float]
    size: tuple[float, float]
    texels: float


def arrange(receivers: list[Receiver], meshes: list[MeshData], limit: int) -> Page:
    """Lays all receivers side by side on the smallest page that holds them, at most `limit` texels wide."""
    extents = [_extent(r, meshes[r.instance.mesh]) for r in receivers]
    lowered = 1.0
    while True:
        sizes = [_rectangle(e, lowered) for e in extents]
        area = math.sqrt(sum(w * h for w, h in sizes))
        side = _rounded(max(area, *(max(s) for s in sizes)))
        while side <= limit:
            corners = pack(sizes, side)
            if corners is not None:
                places = [_place(e, c, lowered, side) for e, c in zip(extents, corners, strict=True)]
                keys = [r.instance.key for r in receivers]
                return Page(side, dict(zip(keys, places, strict=True)), lowered)
            side = _rounded(side * 1.02 + 1)
        lowered *= SHRINK if side / limit < 1.5 else limit / side * 1.1
        if lowered < 1e-4:
            raise BakeError(
                f"{len(receivers)} objects do not fit a lightmap of {limit} texels: raise the resolution limit"
            )


def world_area(mesh: MeshData, matrix: Matrix) -> float:
    """Area of the mesh in its place, m²."""
    linear = np.array(matrix.to_3x3(), np.float64)
    corners = mesh.positions.astype(np.float64)[mesh.triangles] @ linear.T
    crosses = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return float(np.linalg.norm(crosses, axis=1).sum() / 2)


def uv_area(mesh: MeshData, uv_map: str) -> float:
    """Area of the mesh in a UV map, all triangles counted positive."""
    uv = mesh.uv_maps[uv_map].astype(np.float64)[mesh.triangles]
    a, b = uv[:, 1] - uv[:, 0], uv[:, 2] - uv[:, 0]
    return float(np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum() / 2)


def _extent(receiver: Receiver, mesh: MeshData) -> _Extent:
    uv = mesh.uv_maps[receiver.uv_map][mesh.triangles.ravel()].astype(np.float64)
    low, high = uv.min(axis=0), uv.max(axis=0)
    metres = math.sqrt(world_area(mesh, receiver.instance.matrix) / uv_area(mesh, receiver.uv_map))
    size = high - low
    return _Extent((low[0], low[1]), (size[0], size[1]), metres * receiver.density)


def _rectangle(extent: _Extent, lowered: float) -> tuple[int, int]:
    texels = extent.texels * lowered
    # A hair less than a whole texel more is rounding, not size.
    width, height = (max(math.ceil(s * texels - 1e-3), 1) + 2 * MARGIN for s in extent.size)
    return width, height


def _place(extent: _Extent, corner: tuple[float, float], lowered: float, side: int) -> Place:
    scale = extent.texels * lowered / side
    x, y = ((c + MARGIN) / side - low * scale for c, low in zip(corner, extent.low, strict=True))
    return Place((scale, scale, x, y))


def _rounded(side: float) -> int:
    return max(math.ceil(side / STEP) * STEP, STEP)
