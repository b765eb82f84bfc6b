"""Points on the surfaces of a lit GLB where a lightmap can be compared: unit normal, reflectance, irradiance."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from glb import Glb, Json
from lightmap import Page, bilinear

Array = npt.NDArray[np.float64]
_CORNER_WEIGHTS = ((1 / 3, 1 / 3, 1 / 3), (0.6, 0.25, 0.15), (0.15, 0.6, 0.25), (0.25, 0.15, 0.6))


@dataclass(frozen=True)
class Point:
    """A point on a surface, in the world."""

    position: Array
    normal: Array
    reflectance: Array
    irradiance: Array


def node_matrix(node: Json) -> Array:
    """The node's own transform, 4 by 4, for column vectors."""
    if "matrix" in node:
        return np.array(node["matrix"], dtype=np.float64).reshape(4, 4).T
    x, y, z, w = node.get("rotation", (0.0, 0.0, 0.0, 1.0))
    rotation = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
    matrix = np.eye(4)
    matrix[:3, :3] = rotation * np.array(node.get("scale", (1.0, 1.0, 1.0)))
    matrix[:3, 3] = node.get("translation", (0.0, 0.0, 0.0))
    return matrix


def placed_meshes(glb: Glb) -> Iterator[tuple[Json, Array]]:
    """Every mesh of the scene with its world transform."""
    nodes = glb.json["nodes"]

    def visit(index: int, parent: Array) -> Iterator[tuple[Json, Array]]:
        node = nodes[index]
        world = parent @ node_matrix(node)
        if "mesh" in node:
            yield glb.json["meshes"][node["mesh"]], world
        for child in node.get("children", []):
            yield from visit(child, world)

    for root in glb.json["scenes"][glb.json.get("scene", 0)]["nodes"]:
        yield from visit(root, np.eye(4))


def comparable_points(glb: Glb, page: Page, at_least: float) -> list[Point]:
    """Points of untextured, lightmapped materials where the page is smooth and its brightest channel is bright enough.

    Smooth: a shift by half a texel changes the value by less than 2 %, so that filtering does not matter.
    """
    found: list[Point] = []
    for mesh, world in placed_meshes(glb):
        for primitive in mesh["primitives"]:
            material = glb.json["materials"][primitive["material"]]
            if "MOZ_lightmap" not in material.get("extensions", {}):
                continue
            surface = material.get("pbrMetallicRoughness", {})
            if "baseColorTexture" in surface:
                continue
            reflectance = np.array(surface.get("baseColorFactor", (1, 1, 1, 1))[:3], dtype=np.float64)
            found += _points_of(glb, primitive, world, reflectance, page, at_least)
    return found


def _points_of(
    glb: Glb, primitive: Json, world: Array, reflectance: Array, page: Page, at_least: float
) -> Iterator[Point]:
    attributes = primitive["attributes"]
    positions = np.array(glb.values(attributes["POSITION"])) @ world[:3, :3].T + world[:3, 3]
    texcoords = np.array(glb.values(attributes["TEXCOORD_1"]))
    corners = np.array(glb.values(primitive["indices"]), dtype=np.int64).reshape(-1, 3)
    half_u, half_v = 0.5 / page.shape[1], 0.5 / page.shape[0]
    for triangle in corners:
        a, b, c = positions[triangle]
        normal = np.cross(b - a, c - a)
        for weights in _CORNER_WEIGHTS:
            u, v = np.array(weights) @ texcoords[triangle]
            here = bilinear(page, u, v)
            around = [bilinear(page, u + s * half_u, v + t * half_v) for s in (-1, 1) for t in (-1, 1)]
            smooth = all(np.abs(other / here - 1).max() < 0.02 for other in around) if here.min() > 0 else False
            if smooth and here.max() >= at_least:
                yield Point(np.array(weights) @ positions[triangle], normal / np.linalg.norm(normal), reflectance, here)
