# SPDX-License-Identifier: GPL-3.0-or-later
"""Lightmap coordinates for a mesh: connected faces that look the same way become charts, laid flat and packed.

In: a mesh and how it is scaled in the world. Out: a UV map in the unit square, which stays with the mesh. A chart never
turns away from its plane by more than LARGEST_TURN, so a texel is stretched by 1/cos of that at most.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

import bpy
import numpy as np
import numpy.typing as npt
from mathutils import Matrix

from .errors import BakeError
from .packing import pack_square

MAP = "Lightmap"
# Mesh property: metres that the unit square spans, and the empty space between charts in metres.
SIDE, GAP = "lightkiln_side", "lightkiln_gap"
LARGEST_TURN = math.radians(50)
MOST_MAPS = 8

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]


@dataclass(frozen=True)
class Faces:
    """Polygons of a mesh, corner by corner, in metres."""

    corners: Floats
    # Vector from each corner to the next of its face.
    edges: Floats
    # Face of each corner; edge of each corner.
    face_of: Ints
    edge_of: Ints
    normals: Floats
    areas: Floats


def read_faces(mesh: bpy.types.Mesh, linear: Floats) -> Faces:
    """The mesh's polygons under a linear transform."""
    positions = np.empty(len(mesh.vertices) * 3, np.float32)
    mesh.vertices.foreach_get("co", positions)
    vertex_of, edge_of = np.empty(len(mesh.loops), np.int32), np.empty(len(mesh.loops), np.int32)
    mesh.loops.foreach_get("vertex_index", vertex_of)
    mesh.loops.foreach_get("edge_index", edge_of)
    totals = np.empty(len(mesh.polygons), np.int32)
    mesh.polygons.foreach_get("loop_total", totals)

    corners = positions.reshape(-1, 3).astype(np.float64)[vertex_of] @ linear.T
    starts = np.cumsum(totals) - totals
    following = np.arange(len(vertex_of)) + 1
    following[starts + totals - 1] = starts
    face_of = np.repeat(np.arange(len(totals)), totals)
    # Newell: the sum of the corners' cross products is twice the vector area.
    anchored = corners - corners[starts][face_of]
    crosses = np.cross(anchored, anchored[following])
    vectors = np.add.reduceat(crosses, starts) / 2
    areas = np.linalg.norm(vectors, axis=1)
    normals = np.where(areas[:, None] > 0, vectors / np.maximum(areas, 1e-300)[:, None], (0.0, 0.0, 1.0))
    return Faces(corners, corners[following] - corners, face_of, edge_of.astype(np.int64), normals, areas)


def charts(faces: Faces) -> Ints:
    """Chart of every face: grown over shared edges from the largest face that is left."""
    count = len(faces.areas)
    neighbours = _neighbours(faces, count)
    chart = np.full(count, -1, np.int64)
    limit = math.cos(LARGEST_TURN)
    normals = faces.normals.tolist()
    number = 0
    for seed in np.argsort(-faces.areas, kind="stable").tolist():
        if chart[seed] >= 0:
            continue
        x, y, z = normals[seed]
        chart[seed] = number
        queue = deque([seed])
        while queue:
            for other in neighbours[queue.popleft()]:
                n = normals[other]
                if chart[other] < 0 and x * n[0] + y * n[1] + z * n[2] >= limit:
                    chart[other] = number
                    queue.append(other)
        number += 1
    return chart


def _neighbours(faces: Faces, count: int) -> list[list[int]]:
    """Faces across the edges that exactly two faces share."""
    order = np.argsort(faces.edge_of, kind="stable")
    edges, owners = faces.edge_of[order], faces.face_of[order]
    _, starts, uses = np.unique(edges, return_index=True, return_counts=True)
    pairs = starts[uses == 2]
    result: list[list[int]] = [[] for _ in range(count)]
    for a, b in zip(owners[pairs].tolist(), owners[pairs + 1].tolist(), strict=True):
        result[a].append(b)
        result[b].append(a)
    return result


def flatten(faces: Faces, chart: Ints) -> tuple[Floats, Floats]:
    """Corners in the planes of their charts, each chart's lower left at the origin, and the charts' sizes."""
    count = int(chart.max()) + 1
    normal = np.zeros((count, 3))
    np.add.at(normal, chart, faces.normals * faces.areas[:, None])
    length = np.linalg.norm(normal, axis=1)
    normal = np.where(length[:, None] > 0, normal / np.maximum(length, 1e-300)[:, None], (0.0, 0.0, 1.0))
    helper = np.where(np.abs(normal[:, 2:]) < 0.9, (0.0, 0.0, 1.0), (1.0, 0.0, 0.0))
    across = np.cross(helper, normal)
    across /= np.linalg.norm(across, axis=1)[:, None]
    up = np.cross(normal, across)

    of = chart[faces.face_of]
    dx = np.einsum("ij,ij->i", faces.edges, across[of])
    dy = np.einsum("ij,ij->i", faces.edges, up[of])
    # Most edges shall be level or upright: the mean of four times their angles, weighted by length.
    weight, angle = np.hypot(dx, dy), 4 * np.arctan2(dy, dx)
    sine = np.bincount(of, weight * np.sin(angle), count)
    turn = np.arctan2(sine, np.bincount(of, weight * np.cos(angle), count)) / 4
    cos, sin = np.cos(turn)[:, None], np.sin(turn)[:, None]
    across, up = cos * across + sin * up, cos * up - sin * across

    flat = np.stack([np.einsum("ij,ij->i", faces.corners, axis[of]) for axis in (across, up)], axis=1)
    flat, size = _at_origin(flat, of, count)
    tall = size[:, 1] > size[:, 0]
    turned = np.stack([flat[:, 1], size[of, 0] - flat[:, 0]], axis=1)
    flat = np.where(tall[of][:, None], turned, flat)
    return flat, np.where(tall[:, None], size[:, ::-1], size)


def _at_origin(flat: Floats, of: Ints, count: int) -> tuple[Floats, Floats]:
    low, high = np.full((count, 2), np.inf), np.full((count, 2), -np.inf)
    np.minimum.at(low, of, flat)
    np.maximum.at(high, of, flat)
    return flat - low[of], high - low


def unwrap(mesh: bpy.types.Mesh, matrix: Matrix, gap: float) -> None:
    """Makes or renews the mesh's own map, `gap` metres between charts. Raises BakeError if there is no room for one."""
    layer = mesh.uv_layers.get(MAP)
    if layer is None and len(mesh.uv_layers) >= MOST_MAPS:
        raise BakeError(f"The mesh `{mesh.name}` has {MOST_MAPS} UV maps already: remove one to make room for `{MAP}`")
    faces = read_faces(mesh, np.array(matrix.to_3x3(), np.float64))
    chart = charts(faces)
    flat, size = flatten(faces, chart)
    places, side = pack_square([(w + gap, h + gap) for w, h in size.tolist()])
    side = max(side, 1e-9)
    of = chart[faces.face_of]
    uv = (flat + np.array(places)[of] + gap / 2) / side
    if layer is None:
        active = mesh.uv_layers.active_index
        layer = mesh.uv_layers.new(name=MAP, do_init=False)
        # Adding a map must not change which one the others are edited in and rendered with.
        if active >= 0:
            mesh.uv_layers.active_index = active
    layer.uv.foreach_set("vector", np.ascontiguousarray(uv, np.float32).ravel())
    mesh[SIDE], mesh[GAP] = side, gap
    mesh.update()


def is_current(mesh: bpy.types.Mesh, gap: float) -> bool:
    """True if the mesh has a map of its own whose charts are about `gap` apart; always for a map made by hand."""
    if mesh.uv_layers.get(MAP) is None:
        return False
    return GAP not in mesh or 0.6 * gap <= mesh[GAP] <= 4 * gap


def remove_map(mesh: bpy.types.Mesh) -> None:
    """Removes a map that the add-on made."""
    if mesh.library or GAP not in mesh:
        return
    layer = mesh.uv_layers.get(MAP)
    if layer is not None:
        mesh.uv_layers.remove(layer)
    del mesh[GAP], mesh[SIDE]
