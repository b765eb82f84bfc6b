"""Transforms as glTF nodes have them: a matrix → rotation and scale, or word that it is sheared."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..glb.writer import Json

Matrix = npt.NDArray[np.float64]


def rotation_and_scale(world: Matrix) -> tuple[list[float], npt.NDArray[np.float64]]:
    """A quaternion x, y, z, w and the lengths of the axes. Z is kept exactly; mirroring is taken out along X."""
    linear = world[:3, :3]
    lengths = np.linalg.norm(linear, axis=0)
    z = linear[:, 2] / lengths[2] if lengths[2] > 0 else np.array([0.0, 0.0, 1.0])
    y = linear[:, 1] - z * (z @ linear[:, 1])
    if np.linalg.norm(y) < 1e-12:
        y = np.cross(z, np.eye(3)[np.argmin(np.abs(z))])
    y = y / np.linalg.norm(y)
    return quaternion(np.stack([np.cross(y, z), y, z], axis=1)), lengths


def node_transform(world: Matrix) -> Json | None:
    """Translation, rotation and scale of a node; none if the matrix is sheared or not finite."""
    if not np.isfinite(world).all():
        return None
    linear = world[:3, :3]
    lengths = np.linalg.norm(linear, axis=0)
    if (lengths <= 0).any():
        return None
    axes = linear / lengths
    if np.abs(axes.T @ axes - np.eye(3)).max() > 1e-5:
        return None
    if np.linalg.det(axes) < 0:
        lengths = lengths * [-1, 1, 1]
        axes = axes * [-1, 1, 1]
    node: Json = {"rotation": quaternion(axes)}
    node["translation"] = [float(x) for x in world[:3, 3]]
    node["scale"] = [float(x) for x in lengths]
    return node


def quaternion(rotation: Matrix) -> list[float]:
    """A rotation matrix as a unit quaternion x, y, z, w."""
    m = rotation
    # The largest of the four components is found first, so that nothing small is divided by.
    candidates = np.array([1 + m[0, 0] - m[1, 1] - m[2, 2], 1 - m[0, 0] + m[1, 1] - m[2, 2], 0, 0])
    candidates[2] = 1 - m[0, 0] - m[1, 1] + m[2, 2]
    candidates[3] = 1 + m[0, 0] + m[1, 1] + m[2, 2]
    x_y, x_z, y_z = m[1, 0] + m[0, 1], m[0, 2] + m[2, 0], m[2, 1] + m[1, 2]
    w_x, w_y, w_z = m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]
    rows = np.array(
        [
            [candidates[0], x_y, x_z, w_x],
            [x_y, candidates[1], y_z, w_y],
            [x_z, y_z, candidates[2], w_z],
            [w_x, w_y, w_z, candidates[3]],
        ]
    )
    best = rows[int(np.argmax(candidates))]
    return [float(c) for c in best / np.linalg.norm(best)]
