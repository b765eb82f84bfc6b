"""Faces of a mesh prim: as authored, checked, without the malformed ones."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from ..errors import Notes
from .polygons import face_starts

Ints = npt.NDArray[np.int64]
Floats = npt.NDArray[np.float64]


@dataclass
class Faces:
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


def read_faces(mesh: Any, time: Any, notes: Notes) -> Faces | None:
    """The faces of a UsdGeomMesh, none if there are none that are sound."""
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
        return Faces(points, counts, indices)
    notes.add(path, f"{int((~sound).sum())} faces with fewer than 3 corners or points that do not exist are skipped")
    if not sound.any():
        return None
    points[~finite] = 0.0
    return Faces(points, counts[sound], indices[np.repeat(sound, counts)], None, np.flatnonzero(sound), counts)
