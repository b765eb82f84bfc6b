"""Subdivision surfaces: one refinement of a polygon mesh at a time, Catmull–Clark, Loop or bilinear.

In: faces, creases, corners. Out: the refined topology, and how values of every interpolation follow it. Semi-sharp
creases lose one of their sharpness per level (DeRose, Kass, Truong, "Subdivision Surfaces in Character Animation",
1998). Values per corner are interpolated linearly within faces, whatever `faceVaryingLinearInterpolation` says.
OpenSubdiv, which USD itself uses, has no binding on PyPI.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from .polygons import face_starts

Ints = npt.NDArray[np.int64]
Floats = npt.NDArray[np.float64]

SCHEMES = ("catmullClark", "loop", "bilinear")


@dataclass(frozen=True)
class Topology:
    """Faces of a mesh with their sharp edges and corners."""

    vertices: int
    counts: Ints
    indices: Ints
    crease_edges: Ints
    """Pairs of vertices, (n, 2)."""
    crease_sharpness: Floats
    corner_vertices: Ints
    corner_sharpness: Floats


class Refinement:
    """One level: the refined topology, and the way of values from the coarse mesh to the fine one.

    Fine vertices: the coarse vertices, then one per edge, then one per face (not for Loop).
    """

    def __init__(self, coarse: Topology, scheme: str, boundary: str) -> None:
        """Builds the level. `boundary` is USD's interpolateBoundary: none, edgeOnly or edgeAndCorner."""
        self._coarse = coarse
        self._scheme = scheme
        self._loop = scheme == "loop"
        counts, indices = coarse.counts, coarse.indices
        starts = face_starts(counts)
        self._starts = starts
        self._next = np.arange(len(indices)) + 1
        self._next[starts + counts - 1] = starts
        self._previous = np.empty_like(self._next)
        self._previous[self._next] = np.arange(len(indices))
        self._face = np.repeat(np.arange(len(counts)), counts)

        ends = np.sort(np.stack([indices, indices[self._next]], axis=1), axis=1)
        keys = ends[:, 0] * coarse.vertices + ends[:, 1]
        unique, first, self._edge = np.unique(keys, return_index=True, return_inverse=True)
        self._edges = ends[first]
        self._edge_faces = np.bincount(self._edge, minlength=len(unique))
        self._edge_sharpness = self._sharpness_of_edges(unique)
        self._vertex_sharpness = self._sharpness_of_vertices(boundary)
        self.topology = self._fine_topology()
        self.parents = self._parents()

    def _sharpness_of_edges(self, keys: Ints) -> Floats:
        """Boundaries and edges with more than two faces are infinitely sharp."""
        coarse = self._coarse
        sharpness = np.where(self._edge_faces == 2, 0.0, np.inf)
        if len(coarse.crease_edges):
            pairs = np.sort(coarse.crease_edges, axis=1)
            wanted = pairs[:, 0] * coarse.vertices + pairs[:, 1]
            at = np.minimum(np.searchsorted(keys, wanted), len(keys) - 1)
            there = keys[at] == wanted
            np.maximum.at(sharpness, at[there], coarse.crease_sharpness[there])
        return sharpness

    def _sharpness_of_vertices(self, boundary: str) -> Floats:
        sharpness = np.zeros(self._coarse.vertices)
        np.maximum.at(sharpness, self._coarse.corner_vertices, self._coarse.corner_sharpness)
        if boundary == "edgeAndCorner":
            sharpness[np.bincount(self._coarse.indices, minlength=len(sharpness)) == 1] = np.inf
        return sharpness

    def _fine_topology(self) -> Topology:
        coarse = self._coarse
        corner = coarse.indices
        edge = coarse.vertices + self._edge
        centre = coarse.vertices + len(self._edges) + self._face
        if self._loop:
            cut = np.stack([corner, edge, edge[self._previous]], axis=1)
            inner = edge.reshape(-1, 3)
            faces = np.concatenate([cut.reshape(-1, 3, 3), inner[:, None, :]], axis=1)
            counts, indices = np.full(4 * len(coarse.counts), 3), faces.ravel()
        else:
            indices = np.stack([corner, edge, centre, edge[self._previous]], axis=1).ravel()
            counts = np.full(len(corner), 4)
        kept = self._edge_sharpness - 1 > 0
        halves = [np.stack([self._edges[kept, i], coarse.vertices + np.flatnonzero(kept)], axis=1) for i in (0, 1)]
        corners = np.flatnonzero(self._vertex_sharpness - 1 > 0)
        return Topology(
            coarse.vertices + len(self._edges) + (0 if self._loop else len(coarse.counts)),
            counts,
            indices,
            np.concatenate(halves),
            np.tile(self._edge_sharpness[kept] - 1, 2),
            corners,
            self._vertex_sharpness[corners] - 1,
        )

    def _parents(self) -> Ints:
        """Coarse face of every fine face."""
        return np.repeat(np.arange(len(self._coarse.counts)), 4) if self._loop else self._face

    def smooth(self, values: Floats) -> Floats:
        """Values per vertex (n, k), by the scheme's rules."""
        if self._scheme == "bilinear":
            return self.linear(values)
        centres = self._means(values)
        middles = values[self._edges].mean(axis=1)
        sums = np.zeros((len(self._edges), values.shape[1]))
        if self._loop:
            # The vertices opposite of an edge, one in each of its triangles.
            np.add.at(sums, self._edge, values[self._coarse.indices[self._previous]])
            soft = 0.75 * middles + 0.125 * sums
        else:
            np.add.at(sums, self._edge, centres[self._face])
            soft = 0.5 * middles + 0.25 * sums
        sharp = np.clip(self._edge_sharpness, 0.0, 1.0)[:, None]
        edges = np.where(sharp >= 1.0, middles, soft * (1.0 - np.minimum(sharp, 1.0)) + middles * sharp)
        parts = [self._smooth_vertices(values, centres), edges]
        return np.concatenate(parts if self._loop else [*parts, centres])

    def _smooth_vertices(self, values: Floats, centres: Floats) -> Floats:
        count, width = len(values), values.shape[1]
        ends = self._edges.ravel()
        valence = np.bincount(ends, minlength=count)[:, None]
        across = np.zeros((count, width))
        np.add.at(across, ends, values[self._edges[:, ::-1]].reshape(-1, width))
        n = np.maximum(valence, 1)
        if self._loop:
            beta = np.where(n == 3, 3 / 16, 3 / (8 * n))
            soft = (1 - n * beta) * values + beta * across
        else:
            around = np.zeros((count, width))
            np.add.at(around, self._coarse.indices, centres[self._face])
            faces = np.maximum(np.bincount(self._coarse.indices, minlength=count)[:, None], 1)
            soft = (around / faces + (values + across / n) + (n - 3) * values) / n

        # Two sharp edges make a crease, three or more a corner; a single one ends as a dart, which is smooth.
        is_sharp = self._edge_sharpness > 0
        sharp_ends = self._edges[is_sharp]
        sharp_count = np.bincount(sharp_ends.ravel(), minlength=count)
        beyond = np.zeros((count, width))
        np.add.at(beyond, sharp_ends.ravel(), values[sharp_ends[:, ::-1]].reshape(-1, width))
        crease = 0.75 * values + 0.125 * beyond
        total = np.bincount(sharp_ends.ravel(), np.repeat(np.minimum(self._edge_sharpness[is_sharp], 1.0), 2), count)
        creased = np.where(sharp_count >= 2, total / np.maximum(sharp_count, 1), 0.0)
        pinned = np.clip(self._vertex_sharpness, 0.0, 1.0)
        ruled = np.where((sharp_count == 2)[:, None], crease, values)
        out = soft + (ruled - soft) * creased[:, None]
        out = out + (values - out) * pinned[:, None]
        return np.where(valence == 0, values, out)

    def linear(self, values: Floats) -> Floats:
        """Values per vertex (n, k), linear within faces."""
        parts = [values, values[self._edges].mean(axis=1)]
        return np.concatenate(parts if self._loop else [*parts, self._means(values)])

    def corners(self, values: Floats) -> Floats:
        """Values per corner (n, k), linear within faces."""
        middle = 0.5 * (values + values[self._next])
        if self._loop:
            cut = np.stack([values, middle, middle[self._previous]], axis=1).reshape(-1, 3, 3, values.shape[1])
            inner = middle.reshape(-1, 1, 3, values.shape[1])
            return np.concatenate([cut, inner], axis=1).reshape(-1, values.shape[1])
        centre = np.add.reduceat(values, self._starts, axis=0) / self._coarse.counts[:, None]
        quads = np.stack([values, middle, centre[self._face], middle[self._previous]], axis=1)
        return quads.reshape(-1, values.shape[1])

    def _means(self, values: Floats) -> Floats:
        sums = np.add.reduceat(values[self._coarse.indices], self._starts, axis=0)
        return np.asarray(sums / self._coarse.counts[:, None])
