"""Reads meshes: a UsdGeomMesh or solid → triangles with values per corner, refined to a chosen level.

In: a prim at a time. Out: arrays in the prim's own space. Faces and values that are malformed are left out and noted.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from pxr import UsdGeom

from ..errors import Notes
from .faces import Faces, read_faces
from .layout import Charts
from .polygons import face_normals, triangulate
from .primvars import PrimValues
from .solids import solid
from .subdivision import SCHEMES, Refinement, Topology

Ints = npt.NDArray[np.int64]
Floats = npt.NDArray[np.float64]

# Two faces of a smooth surface whose normals differ by more than this from their mean meet at a crease.
_CREASE_COSINE = np.cos(np.radians(35.0))


@dataclass
class MeshData:
    """A mesh in its own space. Corners are numbered after refinement; sources are those of the USD prim."""

    points: Floats
    corner_points: Ints
    """Point of every corner."""
    normals: Floats
    """Unit normal of every corner."""
    triangles: Ints
    """Corners, (n, 3), counter-clockwise seen from the front."""
    faces: Ints
    """Source face of every triangle."""
    source_corners: Ints
    """Source corner that every corner is, or −1 for corners that refinement made."""
    double_sided: bool
    uv_sets: dict[str, Floats]
    """Values per corner, v upwards."""
    colors: dict[str, Floats]
    """Colour primvars per corner, (n, 3), linear."""
    lightmap_uv: Floats | None
    """Charts on the source's faces, per corner; islands may lie upon each other."""


def read_mesh(prim: Any, time: Any, level: int, notes: Notes, charts: Charts | None) -> MeshData | None:
    """The mesh of a prim, or none if it has no faces. `charts`: what lays it out, none for no lightmap."""
    made = solid(prim, time)
    if made is not None:
        points, counts, indices, normals = made
        return _assemble(prim, time, Faces(points, counts, indices, normals), 0, notes, charts)
    source = read_faces(UsdGeom.Mesh(prim), time, notes)
    return None if source is None else _assemble(prim, time, source, level, notes, charts)


def _assemble(prim: Any, time: Any, source: Faces, level: int, notes: Notes, charts: Charts | None) -> MeshData:
    is_mesh = prim.IsA(UsdGeom.Mesh)
    scheme = _scheme(prim, time, source, notes) if is_mesh else "none"
    primvars = PrimValues(prim, time, source, notes)
    values = {("uv", name): uv for name, uv in primvars.uv_sets().items()}
    values |= {("color", name): color for name, color in primvars.colors().items()}
    if charts is not None:
        values["lightmap", ""] = charts.lay_out(source.points, source.counts, source.indices)
    authored = primvars.normals() if is_mesh and scheme == "none" else source.normals

    fine = _Refined(source.points, source.counts, source.indices, source.face_numbers, source.corner_numbers, values)
    if scheme in SCHEMES and level > 0:
        boundary = str(UsdGeom.Mesh(prim).GetInterpolateBoundaryAttr().Get(time))
        fine.refine(_topology(UsdGeom.Mesh(prim), time, source, notes), scheme, boundary, level)

    triangles, owners = triangulate(fine.points, fine.counts, fine.indices)
    holes = np.array(UsdGeom.Mesh(prim).GetHoleIndicesAttr().Get(time) or [] if is_mesh else [], dtype=np.int64)
    shown = ~np.isin(fine.faces[owners], holes)
    triangles, owners = triangles[shown], owners[shown]
    normals = _normals(fine.points, fine.counts, fine.indices, authored, smooth=scheme in SCHEMES)
    if is_mesh and UsdGeom.Mesh(prim).GetOrientationAttr().Get(time) == UsdGeom.Tokens.leftHanded:
        triangles = triangles[:, ::-1]
        normals = normals if authored is not None else -normals
    return MeshData(
        fine.points,
        fine.indices,
        normals,
        triangles,
        fine.faces[owners],
        fine.corners,
        bool(UsdGeom.Gprim(prim).GetDoubleSidedAttr().Get(time)),
        {name: uv for (kind, name), uv in fine.values.items() if kind == "uv"},
        {name: color for (kind, name), color in fine.values.items() if kind == "color"},
        fine.values.get(("lightmap", "")),
    )


def _scheme(prim: Any, time: Any, source: Faces, notes: Notes) -> str:
    """The subdivision scheme that the faces allow."""
    scheme = str(UsdGeom.Mesh(prim).GetSubdivisionSchemeAttr().Get(time))
    if scheme == "loop" and (source.counts != 3).any():
        notes.add(prim.GetPath(), "Loop subdivision needs triangles; it is refined as catmullClark")
        return "catmullClark"
    return scheme


@dataclass
class _Refined:
    """Faces on their way through refinement, with where they come from and their values per corner."""

    points: Floats
    counts: Ints
    indices: Ints
    faces: Ints
    """Source face of every face."""
    corners: Ints
    """Source corner of every corner, or −1."""
    values: dict[tuple[str, str], Floats]

    def refine(self, topology: Topology, scheme: str, boundary: str, level: int) -> None:
        """Refines `level` times."""
        for _ in range(level):
            step = Refinement(topology, scheme, boundary)
            self.points, topology = step.smooth(self.points), step.topology
            self.values = {key: step.corners(values) for key, values in self.values.items()}
            fine = np.full(len(topology.indices), -1)
            # The first corner of a quad, and of the first three triangles of four, is the coarse corner.
            fine[_inherited(len(self.corners), scheme)] = self.corners
            self.faces, self.corners = self.faces[step.parents], fine
        self.counts, self.indices = topology.counts, topology.indices


def _inherited(coarse_corners: int, scheme: str) -> Ints:
    """Fine corners that are the coarse corners, in their order."""
    if scheme == "loop":
        corner = np.arange(coarse_corners)
        return np.asarray(corner // 3 * 12 + corner % 3 * 3)
    return np.arange(coarse_corners) * 4


def _normals(points: Floats, counts: Ints, indices: Ints, authored: Floats | None, *, smooth: bool) -> Floats:
    """Unit normals per corner: as authored, else of the faces, averaged around points where the surface is smooth."""
    areas = face_normals(points, counts, indices)
    flat = np.repeat(_unit(areas), counts, axis=0)
    if authored is not None:
        given = _unit(authored)
        return np.where((given != 0).any(axis=1, keepdims=True), given, flat)
    if not smooth:
        return flat
    sums = np.zeros_like(points)
    np.add.at(sums, indices, np.repeat(areas, counts, axis=0))
    mean = _unit(sums)[indices]
    near = (mean * flat).sum(axis=1, keepdims=True) >= _CREASE_COSINE
    return np.where(near, mean, flat)


def _unit(vectors: Floats) -> Floats:
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.asarray(np.divide(vectors, length, out=np.zeros_like(vectors), where=length > 0))


def _topology(mesh: Any, time: Any, source: Faces, notes: Notes) -> Topology:
    """Faces with the creases and corners that the prim has."""
    lengths = np.array(mesh.GetCreaseLengthsAttr().Get(time) or [], dtype=np.int64)
    chain = np.array(mesh.GetCreaseIndicesAttr().Get(time) or [], dtype=np.int64)
    sharp = np.array(mesh.GetCreaseSharpnessesAttr().Get(time) or [], dtype=np.float64)
    edges, sharpness = np.zeros((0, 2), np.int64), np.zeros(0)
    segments = int((lengths - 1).sum()) if len(lengths) else 0
    if len(lengths) and lengths.sum() == len(chain) and len(sharp) in (len(lengths), segments):
        inner = np.ones(len(chain), bool)
        inner[np.cumsum(lengths) - 1] = False
        at = np.flatnonzero(inner)
        edges = np.stack([chain[at], chain[at + 1]], axis=1)
        sharpness = np.repeat(sharp, lengths - 1) if len(sharp) == len(lengths) else sharp
    elif len(lengths) or len(chain):
        notes.add(mesh.GetPath(), "crease lengths, indices and sharpnesses do not match; creases are left out")
    corners = np.array(mesh.GetCornerIndicesAttr().Get(time) or [], dtype=np.int64)
    pinned = np.array(mesh.GetCornerSharpnessesAttr().Get(time) or [], dtype=np.float64)
    inside = (corners >= 0) & (corners < len(source.points)) if len(corners) == len(pinned) else None
    if inside is None or not inside.all():
        notes.add(mesh.GetPath(), "corner indices and sharpnesses do not match; corners are left out")
        corners, pinned = np.zeros(0, np.int64), np.zeros(0)
    # USD's largest sharpness means a corner for ever.
    sharpness = np.where(sharpness >= 10.0, np.inf, sharpness)
    pinned = np.where(pinned >= 10.0, np.inf, pinned)
    return Topology(len(source.points), source.counts, source.indices, edges, sharpness, corners, pinned)
