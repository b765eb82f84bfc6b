"""Subdivision and triangulation against closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from lightkiln_pipeline.usd.polygons import face_normals, triangulate
from lightkiln_pipeline.usd.solids import tube
from lightkiln_pipeline.usd.subdivision import Refinement, Topology

CUBE = np.array([[x, y, z] for z in (-1, 1) for y in (-1, 1) for x in (-1, 1)], dtype=np.float64)
CUBE_FACES = np.array([[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]])


def topology(vertices: int, faces: np.ndarray, creases: tuple[list[list[int]], list[float]] = ([], [])) -> Topology:
    """Faces of one size with creases."""
    edges = np.array(creases[0], np.int64).reshape(-1, 2)
    none = np.zeros(0)
    counts = np.full(len(faces), faces.shape[1])
    return Topology(vertices, counts, faces.ravel(), edges, np.array(creases[1]), none.astype(np.int64), none)


def refined(
    points: np.ndarray, mesh: Topology, levels: int, scheme: str = "catmullClark", boundary: str = "edgeAndCorner"
) -> tuple[np.ndarray, Topology]:
    """Points and topology after some levels."""
    for _ in range(levels):
        step = Refinement(mesh, scheme, boundary)
        points, mesh = step.smooth(points), step.topology
    return points, mesh


def test_cube_corner_goes_to_its_limit() -> None:
    """The limit of an extraordinary vertex: (n² v + 4 Σ edges + Σ faces) / (n (n + 5)), Halstead et al. 1993."""
    n, v = 3, np.ones(3)
    edge_neighbours = np.array([[-1, 1, 1], [1, -1, 1], [1, 1, -1]])
    across = np.array([[-1, -1, 1], [1, -1, -1], [-1, 1, -1]])
    limit = (n * n * v + 4 * edge_neighbours.sum(0) + across.sum(0)) / (n * (n + 5))
    points, _ = refined(CUBE, topology(8, CUBE_FACES), 7)
    # The cube's vertex 7 is (1, 1, 1) and keeps its number.
    assert points[7] == pytest.approx(limit, abs=2e-4)


def test_regular_grid_reproduces_planes_and_keeps_its_corners() -> None:
    side = 4
    points = np.array([[x, y, 2 * x - y] for y in range(side) for x in range(side)], dtype=np.float64)
    faces = np.array(
        [
            [r * side + c, r * side + c + 1, (r + 1) * side + c + 1, (r + 1) * side + c]
            for r in range(3)
            for c in range(3)
        ]
    )
    fine, mesh = refined(points, topology(16, faces), 2)
    assert fine[:, 2] == pytest.approx(2 * fine[:, 0] - fine[:, 1], abs=1e-12)
    assert fine[[0, 3, 12, 15], :2] == pytest.approx(np.array([[0, 0], [3, 0], [0, 3], [3, 3]]))
    area = np.linalg.norm(face_normals(fine, mesh.counts, mesh.indices), axis=1).sum() / 2
    assert area == pytest.approx(9 * np.sqrt(6))


def test_boundary_curve_is_a_cubic_spline() -> None:
    """Boundary vertices follow (1, 6, 1)/8, boundary edges their middle; a corner stays only if it is asked to."""
    square = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], dtype=np.float64)
    kept, _ = refined(square, topology(4, np.array([[0, 1, 2, 3]])), 1)
    assert kept[0] == pytest.approx([0, 0, 0])
    loose, _ = refined(square, topology(4, np.array([[0, 1, 2, 3]])), 1, boundary="edgeOnly")
    assert loose[0] == pytest.approx([0.125, 0.125, 0])


def test_infinite_creases_keep_a_cube() -> None:
    edges = [[a, b] for a in range(8) for b in range(a) if bin(a ^ b).count("1") == 1]
    points, mesh = refined(CUBE, topology(8, CUBE_FACES, (edges, [np.inf] * 12)), 3)
    assert np.abs(points).max(axis=1) == pytest.approx(np.ones(len(points)))
    assert np.linalg.norm(face_normals(points, mesh.counts, mesh.indices), axis=1).sum() / 2 == pytest.approx(24)


def test_semi_sharp_creases_lie_between() -> None:
    edges = [[a, b] for a in range(8) for b in range(a) if bin(a ^ b).count("1") == 1]

    def area(sharpness: float) -> float:
        points, mesh = refined(CUBE, topology(8, CUBE_FACES, (edges, [sharpness] * 12)), 4)
        return float(np.linalg.norm(face_normals(points, mesh.counts, mesh.indices), axis=1).sum() / 2)

    areas = [area(s) for s in (0.0, 0.5, 1.0, 2.0, 3.5)]
    assert areas == sorted(areas)
    assert areas[-1] < 24


def test_loop_on_an_octahedron_keeps_symmetry_and_counts() -> None:
    points = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], dtype=np.float64)
    faces = np.array([[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]])
    fine, mesh = refined(points, topology(6, faces), 2, scheme="loop")
    assert len(mesh.counts) == 8 * 16
    # Valence 4: beta = 3/32, so a vertex goes to (1 − 4 β) v + β Σ neighbours, whose sum is zero here.
    once, _ = refined(points, topology(6, faces), 1, scheme="loop")
    assert once[0] == pytest.approx([1 - 4 * 3 / 32, 0, 0])
    radii = np.linalg.norm(fine[:6], axis=1)
    assert radii == pytest.approx(np.full(6, radii[0]))


def test_bilinear_changes_nothing_but_the_count() -> None:
    points, mesh = refined(CUBE, topology(8, CUBE_FACES), 2, scheme="bilinear")
    assert np.linalg.norm(face_normals(points, mesh.counts, mesh.indices), axis=1).sum() / 2 == pytest.approx(24)
    assert len(mesh.counts) == 6 * 16


def test_corner_values_follow_the_refined_corners() -> None:
    """Positions as values per corner: with bilinear refinement both ways agree."""
    mesh = topology(8, CUBE_FACES)
    step = Refinement(mesh, "bilinear", "edgeAndCorner")
    assert step.corners(CUBE[mesh.indices]) == pytest.approx(step.smooth(CUBE)[step.topology.indices])


@pytest.mark.parametrize("shape", [
    [[0, 0], [2, 0], [2, 1], [1, 1], [1, 2], [0, 2]],
    [[0, 0], [4, 0], [4, 3], [3, 3], [3, 1], [1, 1], [1, 3], [0, 3]],
    [[0, 0], [2, 0], [1, 0.5], [2, 2], [0, 2]],
])  # fmt: skip
@pytest.mark.parametrize("turn", [1, -1])
def test_concave_polygons_keep_their_area(shape: list[list[float]], turn: int) -> None:
    flat = np.array(shape[::turn], dtype=np.float64)
    points = np.stack([flat[:, 0], 0.3 * flat[:, 0], flat[:, 1]], axis=1)
    counts = np.array([len(points)])
    whole = np.linalg.norm(face_normals(points, counts, np.arange(len(points))), axis=1).sum() / 2
    triangles, faces = triangulate(points, counts, np.arange(len(points)))
    a, b, c = (points[triangles[:, i]] for i in range(3))
    assert len(triangles) == len(points) - 2
    assert (faces == 0).all()
    assert np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2 == pytest.approx(whole)


def test_tube_has_the_area_of_a_cylinder() -> None:
    points, counts, indices, normals = tube(0.5, 3.0, "X")
    assert np.linalg.norm(face_normals(points, counts, indices), axis=1).sum() / 2 == pytest.approx(2 * np.pi * 0.5 * 3)
    outward = (np.repeat(face_normals(points, counts, indices), 4, axis=0) * normals).sum(axis=1)
    assert (outward > 0).all()
