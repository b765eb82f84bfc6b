"""Charts for lightmaps on the faces of a source mesh, so that the result can be written back to it.

In: polygons of any size. Out: a coordinate per corner; islands may lie upon each other and differ in scale, because
the baker packs them anew (`--uv pack`). Charts come from xatlas, which cuts between triangles; a polygon that it cuts
in two becomes a chart of its own, so that every corner of the source has one coordinate.
"""

from __future__ import annotations

import hashlib

import numpy as np
import numpy.typing as npt
import xatlas

from .polygons import face_normals, face_starts, triangulate

Ints = npt.NDArray[np.int64]
Floats = npt.NDArray[np.float64]


class Charts:
    """Lays meshes out, and equal ones only once: a scene that was put together by reference has many copies."""

    def __init__(self) -> None:
        """Nothing is laid out yet."""
        self._known: dict[bytes, Floats] = {}

    def lay_out(self, points: Floats, counts: Ints, indices: Ints) -> Floats:
        """Coordinates per corner, (n, 2), in the charts of polygons of three corners or more."""
        digest = hashlib.sha256(b"".join(np.ascontiguousarray(a).tobytes() for a in (points, counts, indices))).digest()
        if digest not in self._known:
            self._known[digest] = _laid_out(points, counts, indices)
        return self._known[digest]


def _laid_out(points: Floats, counts: Ints, indices: Ints) -> Floats:
    triangles, faces = triangulate(points, counts, indices)
    sound = _sound(points, indices, triangles)
    uv = np.full((len(indices), 2), np.nan)
    whole = np.zeros(len(counts), bool)
    if sound.any():
        uv, whole = _by_xatlas(points, counts, indices, triangles, faces, sound)
    _lay_flat(uv, points, counts, indices, ~whole)
    return uv


def _sound(points: Floats, indices: Ints, triangles: Ints) -> npt.NDArray[np.bool_]:
    """Triangles with an area."""
    a, b, c = (points[indices[triangles[:, i]]] for i in range(3))
    longest = np.maximum(((b - a) ** 2).sum(1), np.maximum(((c - b) ** 2).sum(1), ((a - c) ** 2).sum(1)))
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    return np.asarray(area > 1e-7 * longest)


def _by_xatlas(
    points: Floats, counts: Ints, indices: Ints, triangles: Ints, faces: Ints, sound: npt.NDArray[np.bool_]
) -> tuple[Floats, npt.NDArray[np.bool_]]:
    """Coordinates per corner, and which faces are in one piece."""
    # xatlas has tolerances for a mesh of about unit size.
    low = points[indices].min(axis=0)
    size = float((points[indices].max(axis=0) - low).max()) or 1.0
    placed = np.ascontiguousarray((points - low) / size, dtype=np.float32)
    corner_points = indices[triangles[sound]]
    _, out, out_uv = xatlas.parametrize(placed, np.ascontiguousarray(corner_points, dtype=np.uint32))
    corner, vertex = triangles[sound].ravel(), out.astype(np.int64).ravel()

    # A corner that got two vertices of the atlas lies on a cut.
    low_vertex = np.full(len(indices), np.iinfo(np.int64).max)
    high_vertex = np.full(len(indices), -1)
    np.minimum.at(low_vertex, corner, vertex)
    np.maximum.at(high_vertex, corner, vertex)
    whole = np.logical_and.reduceat(low_vertex == high_vertex, face_starts(counts))
    uv = np.full((len(indices), 2), np.nan)
    known = high_vertex >= 0
    uv[known] = np.asarray(out_uv, np.float64)[high_vertex[known]]
    # A face of which some triangles have no area may still be folded.
    whole &= np.bincount(faces[~sound], minlength=len(counts)) == 0
    return uv, whole


def _lay_flat(uv: Floats, points: Floats, counts: Ints, indices: Ints, single: npt.NDArray[np.bool_]) -> None:
    """Gives each of the faces `single` a chart of its own: its projection along its normal, right of all others."""
    chosen = np.flatnonzero(single)
    if len(chosen) == 0:
        return
    starts, normals = face_starts(counts), face_normals(points, counts, indices)
    corners = points[indices]
    origin = corners[starts]
    normal = normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
    # Any tangent: across the axis that the normal is farthest from.
    axis = np.eye(3)[np.argmin(np.abs(normal), axis=1)]
    tangent = axis - normal * (axis * normal).sum(axis=1, keepdims=True)
    tangent /= np.maximum(np.linalg.norm(tangent, axis=1, keepdims=True), 1e-300)
    bitangent = np.cross(normal, tangent)
    face = np.repeat(np.arange(len(counts)), counts)
    own = single[face]
    offset = corners[own] - origin[face[own]]
    flat = np.stack([(offset * d[face[own]]).sum(axis=1) for d in (tangent, bitangent)], axis=1)
    largest = np.abs(flat).max() or 1.0
    number = np.cumsum(single)[face[own]]
    # Columns four wide keep charts apart in numbers of any size.
    uv[own] = flat / largest + np.stack([4.0 * number, np.zeros(len(number))], axis=1)
