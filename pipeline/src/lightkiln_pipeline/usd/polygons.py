"""Polygons → triangles, by corner: convex ones as fans, others by clipping ears.

A corner is a face-vertex of the mesh; triangles refer to corners, so that values of every interpolation follow.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Ints = npt.NDArray[np.int64]
Floats = npt.NDArray[np.float64]


def face_starts(counts: Ints) -> Ints:
    """First corner of every face."""
    return np.concatenate(([0], np.cumsum(counts)[:-1])).astype(np.int64) if len(counts) else np.zeros(0, np.int64)


def face_normals(points: Floats, counts: Ints, indices: Ints) -> Floats:
    """Newell's vector of every face: its normal, twice as long as the face's area."""
    starts = face_starts(counts)
    corners = points[indices]
    successor: Ints = np.arange(len(indices)) + 1
    successor[starts + counts - 1] = starts
    # Relative to the first corner, so that large coordinates cancel early.
    origin = np.repeat(corners[starts], counts, axis=0)
    return np.asarray(np.add.reduceat(np.cross(corners - origin, corners[successor] - origin), starts, axis=0))


def triangulate(points: Floats, counts: Ints, indices: Ints) -> tuple[Ints, Ints]:
    """Triangles as corners (n, 3), in order of faces, and the face of each. Faces need three corners or more."""
    if len(counts) == 0:
        return np.zeros((0, 3), np.int64), np.zeros(0, np.int64)
    starts = face_starts(counts)
    concave = _concave_faces(points, counts, indices, starts)
    triangles, faces = [], []
    for k in range(1, int(counts.max()) - 1):
        having = np.flatnonzero((counts > k + 1) & ~concave)
        first = starts[having]
        triangles.append(np.stack([first, first + k, first + k + 1], axis=1))
        faces.append(having)
    normals = face_normals(points, counts, indices)
    for face in np.flatnonzero(concave):
        start, count = int(starts[face]), int(counts[face])
        ears = clip_ears(points[indices[start : start + count]], normals[face])
        triangles.append(ears + start)
        faces.append(np.full(len(ears), face))
    owners: Ints = np.concatenate(faces).astype(np.int64)
    order = np.argsort(owners, kind="stable")
    return np.concatenate(triangles).astype(np.int64)[order], owners[order]


def _concave_faces(points: Floats, counts: Ints, indices: Ints, starts: Ints) -> npt.NDArray[np.bool_]:
    """Faces with a corner that turns against the face's normal."""
    ends = starts + counts - 1
    successor: Ints = np.arange(len(indices)) + 1
    predecessor: Ints = np.arange(len(indices)) - 1
    successor[ends], predecessor[starts] = starts, ends
    corners = points[indices]
    turn = np.cross(corners - corners[predecessor], corners[successor] - corners)
    normal = np.repeat(face_normals(points, counts, indices), counts, axis=0)
    against = (turn * normal).sum(axis=1) < -1e-9 * (normal * normal).sum(axis=1)
    return np.asarray(np.logical_or.reduceat(against, starts) & (counts > 3), bool)


def clip_ears(polygon: Floats, normal: Floats) -> Ints:
    """Triangles of a simple polygon as indices of its corners, by the ears of its projection along `normal`."""
    drop = int(np.argmax(np.abs(normal)))
    flat = np.delete(polygon, drop, axis=1) * ([1, -1] if drop == 1 else [1, 1])
    sign = 1.0 if normal[drop] > 0 else -1.0

    def area(a: int, b: int, c: int) -> float:
        (ax, ay), (bx, by), (cx, cy) = flat[a], flat[b], flat[c]
        return float(sign * ((bx - ax) * (cy - ay) - (by - ay) * (cx - ax)))

    ring, triangles = list(range(len(polygon))), []
    while len(ring) > 3:
        size = len(ring)
        # A polygon that crosses itself may have no ear: then any corner will do.
        ear = 0
        for i in range(size):
            a, b, c = ring[i - 1], ring[i], ring[(i + 1) % size]
            if area(a, b, c) <= 0:
                continue
            inside = any(
                area(a, b, p) >= 0 and area(b, c, p) >= 0 and area(c, a, p) >= 0
                for p in ring
                if p not in (a, b, c) and not (flat[p] == flat[[a, b, c]]).all(axis=1).any()
            )
            if not inside:
                ear = i
                break
        triangles.append((ring[ear - 1], ring[ear], ring[(ear + 1) % size]))
        del ring[ear]
    triangles.append((ring[0], ring[1], ring[2]))
    return np.array(triangles, np.int64)
