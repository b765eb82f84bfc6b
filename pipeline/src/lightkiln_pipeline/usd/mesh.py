"""Reads meshes: a UsdGeomMesh or solid → triangles with values per corner, refined to a chosen level.

In: a prim at a time. Out: arrays in the prim's own space. Faces and values that are malformed are left out and noted.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt
from pxr import UsdGeom

from ..errors import Notes
from .layout import Charts
from .polygons import face_normals, face_starts, triangulate
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
    source_corner_count: int
    double_sided: bool
    uv_sets: dict[str, Floats] = field(default_factory=dict)
    """Values per corner, v upwards."""
    colors: dict[str, Floats] = field(default_factory=dict)
    """Colour primvars per corner, (n, 3), linear."""
    opacities: Floats | None = None
    """displayOpacity per corner."""
    lightmap_uv: Floats | None = None
    """Charts on the source's faces, per corner; islands may lie upon each other."""


def read_mesh(prim: Any, time: Any, level: int, notes: Notes, charts: Charts | None) -> MeshData | None:
    """The mesh of a prim, or none if it has no faces. `charts`: what lays it out, none for no lightmap."""
    made = solid(prim, time)
    if made is not None:
        points, counts, indices, normals = made
        return _assemble(prim, time, _Source(points, counts, indices, normals), 0, notes, charts)
    source = _read_faces(UsdGeom.Mesh(prim), time, notes)
    return None if source is None else _assemble(prim, time, source, level, notes, charts)


@dataclass
class _Source:
    """Faces as authored, without the malformed ones."""

    points: Floats
    counts: Ints
    indices: Ints
    normals: Floats | None = None
    """Per corner."""
    kept_faces: Ints | None = None
    """Authored number of every face, where some were left out."""
    authored_counts: Ints | None = None

    @property
    def face_numbers(self) -> Ints:
        """Authored number of every face."""
        return np.arange(len(self.counts)) if self.kept_faces is None else self.kept_faces

    @property
    def corner_numbers(self) -> Ints:
        """Authored number of every corner."""
        if self.authored_counts is None or self.kept_faces is None:
            return np.arange(len(self.indices))
        starts = face_starts(self.authored_counts)[self.kept_faces]
        inner = np.arange(len(self.indices)) - np.repeat(face_starts(self.counts), self.counts)
        return np.asarray(np.repeat(starts, self.counts) + inner)


def _read_faces(mesh: Any, time: Any, notes: Notes) -> _Source | None:
    path = mesh.GetPath()
    points = np.array(mesh.GetPointsAttr().Get(time) or np.zeros((0, 3)), dtype=np.float64).reshape(-1, 3)
    counts = np.array(mesh.GetFaceVertexCountsAttr().Get(time) or [], dtype=np.int64)
    indices = np.array(mesh.GetFaceVertexIndicesAttr().Get(time) or [], dtype=np.int64)
    if len(points) == 0 or len(counts) == 0:
        notes.add(path, "the mesh has no faces; it is skipped")
        return None
    if (counts < 0).any() or counts.sum() != len(indices):
        notes.add(path, "faceVertexCounts and faceVertexIndices do not match; the mesh is skipped, export it again")
        return None
    finite: npt.NDArray[np.bool_] = np.asarray(np.isfinite(points).all(axis=1))
    there = (indices >= 0) & (indices < len(points))
    usable = np.where(there, finite[np.where(there, indices, 0)], False)
    sound = counts >= 3
    filled = np.flatnonzero(counts > 0)
    sound[filled] &= np.logical_and.reduceat(usable, face_starts(counts)[filled])
    if sound.all():
        return _Source(points, counts, indices)
    notes.add(path, f"{int((~sound).sum())} faces with fewer than 3 corners or points that do not exist are skipped")
    if not sound.any():
        return None
    points[~finite] = 0.0
    return _Source(points, counts[sound], indices[np.repeat(sound, counts)], None, np.flatnonzero(sound), counts)


def _assemble(prim: Any, time: Any, source: _Source, level: int, notes: Notes, charts: Charts | None) -> MeshData:
    is_mesh = prim.IsA(UsdGeom.Mesh)
    scheme = str(UsdGeom.Mesh(prim).GetSubdivisionSchemeAttr().Get(time)) if is_mesh else "none"
    if scheme == "loop" and (source.counts != 3).any():
        notes.add(prim.GetPath(), "Loop subdivision needs triangles; it is refined as catmullClark")
        scheme = "catmullClark"
    smooth = scheme in SCHEMES and level > 0
    values = _PrimValues(prim, time, source, notes)
    layout = charts.lay_out(source.points, source.counts, source.indices) if charts else None

    points, counts, indices = source.points, source.counts, source.indices
    authored = values.normals() if is_mesh and scheme == "none" else source.normals
    chains = _Chains(values.uv_sets(), values.colors(), values.opacities(), layout)
    faces, corners = source.face_numbers, source.corner_numbers
    if smooth:
        topology = _topology(UsdGeom.Mesh(prim), time, source, notes)
        boundary = str(UsdGeom.Mesh(prim).GetInterpolateBoundaryAttr().Get(time))
        for _ in range(level):
            step = Refinement(topology, scheme, boundary)
            points, topology = step.smooth(points), step.topology
            chains.refine(step)
            fine = np.full(len(topology.indices), -1)
            # The first corner of a quad, and of the first three triangles of four, is the coarse corner.
            fine[_inherited(len(corners), scheme)] = corners
            faces, corners = faces[step.parents], fine
        counts, indices = topology.counts, topology.indices

    triangles, owners = triangulate(points, counts, indices)
    holes = np.array(UsdGeom.Mesh(prim).GetHoleIndicesAttr().Get(time) or [] if is_mesh else [], dtype=np.int64)
    shown = ~np.isin(faces[owners], holes)
    triangles, owners = triangles[shown], owners[shown]
    normals = _normals(points, counts, indices, authored, smooth=scheme in SCHEMES)
    if is_mesh and UsdGeom.Mesh(prim).GetOrientationAttr().Get(time) == UsdGeom.Tokens.leftHanded:
        triangles = triangles[:, ::-1]
        normals = normals if authored is not None else -normals
    data = MeshData(
        points,
        indices,
        normals,
        triangles,
        faces[owners],
        corners,
        int(source.authored_counts.sum()) if source.authored_counts is not None else len(source.indices),
        bool(UsdGeom.Gprim(prim).GetDoubleSidedAttr().Get(time)),
    )
    chains.store(data)
    return data


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


def _topology(mesh: Any, time: Any, source: _Source, notes: Notes) -> Topology:
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


class _Chains:
    """Values per corner on their way through refinement."""

    def __init__(
        self, uv_sets: dict[str, Floats], colors: dict[str, Floats], opacities: Floats | None, layout: Floats | None
    ) -> None:
        self._values: dict[tuple[str, str], Floats] = {("uv", k): v for k, v in uv_sets.items()}
        self._values |= {("color", k): v for k, v in colors.items()}
        if opacities is not None:
            self._values["opacity", ""] = opacities
        if layout is not None:
            self._values["lightmap", ""] = layout

    def refine(self, step: Refinement) -> None:
        """One level."""
        self._values = {key: step.corners(values) for key, values in self._values.items()}

    def store(self, data: MeshData) -> None:
        """Hands the values over."""
        for (kind, name), values in self._values.items():
            if kind == "uv":
                data.uv_sets[name] = values
            elif kind == "color":
                data.colors[name] = values
            elif kind == "opacity":
                data.opacities = values[:, 0]
            else:
                data.lightmap_uv = values


class _PrimValues:
    """The primvars of a prim, its own and inherited, per corner of the sound faces."""

    def __init__(self, prim: Any, time: Any, source: _Source, notes: Notes) -> None:
        self._prim, self._time, self._source, self._notes = prim, time, source, notes
        self._primvars = UsdGeom.PrimvarsAPI(prim).FindPrimvarsWithInheritance()

    def uv_sets(self) -> dict[str, Floats]:
        """Texture coordinates by name: primvars with two floats."""
        found = {}
        for primvar in self._primvars:
            kind = str(primvar.GetTypeName())
            if kind.rstrip("[]") in ("texCoord2f", "texCoord2d", "texCoord2h", "float2", "double2", "half2"):
                values = self._per_corner(primvar, 2)
                if values is not None:
                    found[str(primvar.GetPrimvarName())] = values
        return found

    def colors(self) -> dict[str, Floats]:
        """Colour primvars by name."""
        found = {}
        for primvar in self._primvars:
            if str(primvar.GetTypeName()).startswith("color3"):
                values = self._per_corner(primvar, 3)
                if values is not None:
                    found[str(primvar.GetPrimvarName())] = values
        return found

    def opacities(self) -> Floats | None:
        """displayOpacity."""
        for primvar in self._primvars:
            if str(primvar.GetPrimvarName()) == "displayOpacity":
                return self._per_corner(primvar, 1)
        return None

    def normals(self) -> Floats | None:
        """Authored normals: the primvar, else the attribute."""
        for primvar in self._primvars:
            if str(primvar.GetPrimvarName()) == "normals":
                return self._per_corner(primvar, 3)
        mesh = UsdGeom.Mesh(self._prim)
        values = mesh.GetNormalsAttr().Get(self._time)
        if not values:
            return None
        return self._spread(np.array(values, np.float64), str(mesh.GetNormalsInterpolation()), "normals")

    def _per_corner(self, primvar: Any, width: int) -> Floats | None:
        name = str(primvar.GetPrimvarName())
        value = primvar.ComputeFlattened(self._time)
        if value is None:
            if primvar.HasValue():
                self._notes.add(self._prim.GetPath(), f"primvars:{name} has indices beyond its values; it is left out")
            return None
        values = np.array(value, np.float64)
        return self._spread(values.reshape(-1, width), str(primvar.GetInterpolation()), f"primvars:{name}")

    def _spread(self, values: Floats, interpolation: str, name: str) -> Floats | None:
        """Values of any interpolation, per corner."""
        source = self._source
        counts = source.authored_counts if source.authored_counts is not None else source.counts
        expected = {
            "constant": 1,
            "uniform": len(counts),
            "varying": len(source.points),
            "vertex": len(source.points),
            "faceVarying": int(counts.sum()),
        }[interpolation]
        if len(values) < expected or not np.isfinite(values).all():
            fault = f"{len(values)} values where {interpolation} needs {expected}, or some that are not finite"
            self._notes.add(self._prim.GetPath(), f"{name} has {fault}; it is left out")
            return None
        if interpolation == "constant":
            return np.repeat(values[:1], len(source.indices), axis=0)
        if interpolation == "uniform":
            return np.repeat(values[source.face_numbers], source.counts, axis=0)
        if interpolation == "faceVarying":
            return values[source.corner_numbers]
        return values[source.indices]
