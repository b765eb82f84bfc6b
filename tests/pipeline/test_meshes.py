"""Meshes from USD: interpolations, orientation, subsets, holes, bad input; and their charts."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from pxr import Usd, UsdGeom

from lightkiln_pipeline.errors import Notes
from lightkiln_pipeline.usd.layout import Charts
from lightkiln_pipeline.usd.mesh import MeshData, read_mesh
from stages import write_stage

TWO_QUADS = """
    uniform token subdivisionScheme = "none"
    int[] faceVertexCounts = [4, 4]
    int[] faceVertexIndices = [0, 1, 4, 3, 1, 2, 5, 4]
    point3f[] points = [(0, 0, 0), (1, 0, 0), (2, 0, 0), (0, 1, 0), (1, 1, 0), (2, 1, 0)]
"""


def read(tmp_path: Path, body: str, level: int = 0) -> tuple[MeshData | None, Notes]:
    """Reads /World/M."""
    stage = Usd.Stage.Open(str(write_stage(tmp_path / "mesh.usda", f'def Mesh "M" {{ {body} }}')))
    notes = Notes()
    return read_mesh(stage.GetPrimAtPath("/World/M"), Usd.TimeCode.EarliestTime(), level, notes, Charts()), notes


PRIMVARS = {
    "constant": ("[(1, 0)]", [[1, 0]] * 8),
    "uniform": ("[(1, 0), (2, 0)]", [[1, 0]] * 4 + [[2, 0]] * 4),
    "vertex": ("[(0, 0), (1, 0), (2, 0), (3, 0), (4, 0), (5, 0)]", [[i, 0] for i in (0, 1, 4, 3, 1, 2, 5, 4)]),
    "varying": ("[(0, 0), (1, 0), (2, 0), (3, 0), (4, 0), (5, 0)]", [[i, 0] for i in (0, 1, 4, 3, 1, 2, 5, 4)]),
    "faceVarying": ("[(0, 0), (1, 0), (2, 0), (3, 0), (4, 0), (5, 0), (6, 0), (7, 0)]", [[i, 0] for i in range(8)]),
}


@pytest.mark.parametrize("interpolation", PRIMVARS)
def test_primvars_of_every_interpolation(tmp_path: Path, interpolation: str) -> None:
    values, expected = PRIMVARS[interpolation]
    data, notes = read(tmp_path, f'{TWO_QUADS} texCoord2f[] primvars:st = {values} (interpolation = "{interpolation}")')
    assert data is not None and notes.list() == []
    assert data.uv_sets["st"].tolist() == expected


def test_indexed_and_inherited_primvars(tmp_path: Path) -> None:
    body = f"""def Xform "Up" {{
        color3f[] primvars:displayColor = [(1, 0, 0)] (interpolation = "constant")
        def Mesh "M" {{ {TWO_QUADS}
            texCoord2f[] primvars:st = [(7, 0), (9, 0)] (interpolation = "uniform")
            int[] primvars:st:indices = [1, 0] }} }}"""
    stage = Usd.Stage.Open(str(write_stage(tmp_path / "mesh.usda", body)))
    data = read_mesh(stage.GetPrimAtPath("/World/Up/M"), Usd.TimeCode.EarliestTime(), 0, Notes(), Charts())
    assert data is not None
    assert data.uv_sets["st"][[0, 4], 0].tolist() == [9, 7]
    assert data.colors["displayColor"].tolist() == [[1, 0, 0]] * 8


def test_left_handed_faces_are_turned(tmp_path: Path) -> None:
    right, _ = read(tmp_path, TWO_QUADS)
    left, _ = read(tmp_path, TWO_QUADS + 'uniform token orientation = "leftHanded"')
    assert right is not None and left is not None
    assert right.normals[0].tolist() == [0, 0, 1]
    assert left.normals[0].tolist() == [0, 0, -1]
    assert left.triangles[:, ::-1].tolist() == right.triangles.tolist()


def test_holes_are_left_out_of_subdivided_meshes(tmp_path: Path) -> None:
    body = TWO_QUADS.replace('"none"', '"bilinear"') + "int[] holeIndices = [1]"
    data, _ = read(tmp_path, body, level=1)
    assert data is not None
    assert len(data.triangles) == 8
    assert set(data.faces) == {0}


BAD = {
    "faceVertexCounts and faceVertexIndices do not match": TWO_QUADS.replace("[4, 4]", "[4, 5]"),
    "1 faces with fewer than 3 corners": TWO_QUADS.replace("[0, 1, 4, 3,", "[0, 1, 99, 3,"),
    "no faces": "point3f[] points = []",
    "primvars:st has 3 values where vertex needs 6": TWO_QUADS
    + 'texCoord2f[] primvars:st = [(0, 0), (1, 0), (2, 0)] (interpolation = "vertex")',
}


@pytest.mark.parametrize("message", BAD)
def test_faults_are_named_with_the_prim(tmp_path: Path, message: str) -> None:
    _, notes = read(tmp_path, BAD[message])
    assert any(n.place == "/World/M" and message in n.message for n in notes.list()), notes.list()


def test_sound_faces_survive_malformed_ones(tmp_path: Path) -> None:
    body = TWO_QUADS.replace("[0, 1, 4, 3,", "[0, 1, 99, 3,")
    data, _ = read(tmp_path, body + 'texCoord2f[] primvars:st = [(1, 0), (2, 0)] (interpolation = "uniform")')
    assert data is not None
    assert data.source_corners.tolist() == [4, 5, 6, 7]
    assert data.uv_sets["st"][:, 0].tolist() == [2, 2, 2, 2]


def test_every_polygon_lies_in_one_chart_without_folds() -> None:
    """A sphere of quads and triangles: each face's corners span its area in the layout, however xatlas cuts."""
    from lightkiln_pipeline.usd import solids

    stage = Usd.Stage.CreateInMemory()
    sphere = UsdGeom.Sphere.Define(stage, "/S")
    made = solids.solid(sphere.GetPrim(), Usd.TimeCode.Default())
    assert made is not None
    points, counts, indices, _ = made
    uv = Charts().lay_out(points, counts, indices)
    assert np.isfinite(uv).all()
    start = 0
    for count in counts:
        corners = uv[start : start + count]
        x, y = corners[:, 0], corners[:, 1]
        area = abs(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1))) / 2
        assert area > 0
        start += count
