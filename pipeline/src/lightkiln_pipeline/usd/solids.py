"""USD's solids as polygon meshes: Cube, Sphere, Cylinder, Cone, Capsule, Plane → points, faces, normals per corner.

In metres of the prim's own space, closed, with normals that point outwards.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt
from pxr import UsdGeom

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]
Shape = tuple[Floats, Ints, Ints, Floats]
"""Points (n, 3), face counts, face indices, normals per corner."""

# Around the axis. The facets' radius is widened so that the area of the round surface is kept.
SIDES = 48
_AXES = {"X": [1, 2, 0], "Y": [2, 0, 1], "Z": [0, 1, 2]}


def solid(prim: Any, time: Any) -> Shape | None:
    """The shape of a solid prim, or none if it is no solid."""
    makers: dict[Any, Callable[[Any, Any], Shape]] = {
        UsdGeom.Cube: _cube,
        UsdGeom.Sphere: _sphere,
        UsdGeom.Cylinder: _cylinder,
        UsdGeom.Cone: _cone,
        UsdGeom.Capsule: _capsule,
        UsdGeom.Plane: _plane,
    }
    for schema, make in makers.items():
        if prim.IsA(schema):
            return make(schema(prim), time)
    return None


def tube(radius: float, length: float, axis: str) -> Shape:
    """The side of a cylinder without caps, along `axis`."""
    half = length / 2
    return _revolved([(radius, -half), (radius, half)], axis, smooth=True)


def _cube(cube: Any, time: Any) -> Shape:
    half = float(cube.GetSizeAttr().Get(time)) / 2
    points = np.array([[x, y, z] for z in (-1, 1) for y in (-1, 1) for x in (-1, 1)], dtype=np.float64) * half
    faces = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]]
    normals = [[0, 0, -1], [0, 0, 1], [0, -1, 0], [0, 1, 0], [-1, 0, 0], [1, 0, 0]]
    corners = np.repeat(np.array(normals, dtype=np.float64), 4, axis=0)
    return points, np.full(6, 4), np.array(faces).ravel(), corners


def _plane(plane: Any, time: Any) -> Shape:
    width, length = float(plane.GetWidthAttr().Get(time)) / 2, float(plane.GetLengthAttr().Get(time)) / 2
    order = _AXES[str(plane.GetAxisAttr().Get(time))]
    flat = np.array([[-width, -length, 0], [width, -length, 0], [width, length, 0], [-width, length, 0]])
    return flat[:, np.argsort(order)], np.array([4]), np.arange(4), np.tile(np.eye(3)[order[2]], (4, 1))


def _sphere(sphere: Any, time: Any) -> Shape:
    radius = float(sphere.GetRadiusAttr().Get(time))
    angles = np.linspace(-np.pi / 2, np.pi / 2, SIDES // 2 + 1)
    return _revolved([(radius * np.cos(a), radius * np.sin(a)) for a in angles], "Z", smooth=True)


def _cylinder(cylinder: Any, time: Any) -> Shape:
    radius, half = float(cylinder.GetRadiusAttr().Get(time)), float(cylinder.GetHeightAttr().Get(time)) / 2
    outline = [(0.0, -half), (radius, -half), (radius, half), (0.0, half)]
    return _revolved(outline, str(cylinder.GetAxisAttr().Get(time)), smooth=False)


def _cone(cone: Any, time: Any) -> Shape:
    radius, half = float(cone.GetRadiusAttr().Get(time)), float(cone.GetHeightAttr().Get(time)) / 2
    return _revolved([(0.0, -half), (radius, -half), (0.0, half)], str(cone.GetAxisAttr().Get(time)), smooth=False)


def _capsule(capsule: Any, time: Any) -> Shape:
    radius, half = float(capsule.GetRadiusAttr().Get(time)), float(capsule.GetHeightAttr().Get(time)) / 2
    angles = np.linspace(-np.pi / 2, np.pi / 2, SIDES // 2 + 2)
    shift = np.where(angles < 0, -half, half)
    outline = [(radius * np.cos(a), radius * np.sin(a) + s) for a, s in zip(angles, shift, strict=True)]
    return _revolved(outline, str(capsule.GetAxisAttr().Get(time)), smooth=True)


def _revolved(outline: list[tuple[float, float]], axis: str, *, smooth: bool) -> Shape:
    """Turns an outline of (radius, height), bottom to top, around an axis. `smooth` rounds along the outline too."""
    turn = 2 * np.pi * np.arange(SIDES) / SIDES
    # A regular polygon around a circle: the same perimeter, so that the side keeps its area.
    widened = (np.pi / SIDES) / np.sin(np.pi / SIDES)
    profile = np.array(outline, dtype=np.float64)
    profile[np.abs(profile[:, 0]) < 1e-12, 0] = 0.0
    rings = np.stack([np.cos(turn), np.sin(turn)], axis=1) * widened
    points = np.array([[r * x, r * y, h] for r, h in profile for x, y in rings])
    faces, normals = [], []
    slopes = np.diff(profile, axis=0)
    across = np.stack([slopes[:, 1], -slopes[:, 0]], axis=1)
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    at = np.concatenate([across[:1], across[:-1] + across[1:], across[-1:]])
    at /= np.linalg.norm(at, axis=1, keepdims=True)
    for ring in range(len(profile) - 1):
        low, high = (at[ring], at[ring + 1]) if smooth else (across[ring], across[ring])
        for side in range(SIDES):
            after = (side + 1) % SIDES
            a, b = ring * SIDES + side, ring * SIDES + after
            corners = [(a, low, side), (b, low, after), (b + SIDES, high, after), (a + SIDES, high, side)]
            if profile[ring, 0] == 0:
                del corners[1]
            elif profile[ring + 1, 0] == 0:
                del corners[2]
            faces.append([c for c, _, _ in corners])
            normals += [[n[0] * np.cos(turn[s]), n[0] * np.sin(turn[s]), n[1]] for _, n, s in corners]
    counts = np.array([len(f) for f in faces])
    order = np.argsort(_AXES[axis])
    indices = np.array([i for f in faces for i in f])
    return points[:, order], counts, indices, np.array(normals)[:, order]
