# SPDX-License-Identifier: GPL-3.0-or-later
"""Blender's axes (Z up) and glTF's (Y up): x, y, z → x, z, −y."""

from __future__ import annotations

from mathutils import Matrix, Quaternion, Vector

# glTF coordinates from Blender's.
CHANGE = Matrix(((1, 0, 0, 0), (0, 0, 1, 0), (0, -1, 0, 0), (0, 0, 0, 1)))
_TURN = CHANGE.to_quaternion()
# Relative to its largest element a matrix may be off by this much and still count as made of move, turn and scale.
_SHEAR = 1e-5


def to_gltf(v: Vector) -> list[float]:
    """A point or direction in glTF's axes."""
    return [v.x, v.z, -v.y]


def node_rotation(rotation: Quaternion) -> list[float]:
    """glTF rotation (x, y, z, w) of something whose own axes stay as they are, such as a lamp."""
    q = (_TURN @ rotation).normalized()
    return [q.x, q.y, q.z, q.w]


def placement(matrix: Matrix) -> dict[str, list[float]] | None:
    """glTF move, turn and scale of a mesh node; none if the matrix has shear, which glTF nodes cannot have."""
    changed = CHANGE @ matrix @ CHANGE.inverted()
    location, rotation, scale = changed.decompose()
    again = Matrix.LocRotScale(location, rotation, scale)
    largest = max(abs(x) for row in changed for x in row)
    if any(
        abs(a - b) > _SHEAR * largest for r, s in zip(changed, again, strict=True) for a, b in zip(r, s, strict=True)
    ):
        return None
    if min(abs(s) for s in scale) == 0.0:
        return None
    q = rotation.normalized()
    return {"translation": list(location), "rotation": [q.x, q.y, q.z, q.w], "scale": list(scale)}
