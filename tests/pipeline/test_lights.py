"""UsdLux lights against closed forms, within 0.5 %: stage → GLB → bake → irradiance at a point."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from pxr import UsdLux

from lightkiln_pipeline.usd.convert import UsdSettings, convert
from stages import FLOOR, bake_stage, irradiance, middle_of, write_stage

TOLERANCE = 0.005


def lamp(kind: str, attributes: str, height: float = 1.0, api: str = "", extra: str = "") -> str:
    """A light above the floor that shines down."""
    schemas = f'(prepend apiSchemas = ["{api}"])' if api else ""
    return f"""
def {kind} "Lamp" {schemas} {{
    {attributes}
    double3 xformOp:translate = (0, {height}, 0)
    double xformOp:rotateX = -90
    {extra or 'uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateX"]'}
}}
"""


def tilted(kind: str, attributes: str, angle: float, api: str = "ShapingAPI") -> str:
    """A light one metre above the floor whose axis is `angle` degrees off the vertical."""
    order = '["xformOp:translate", "xformOp:rotateZ", "xformOp:rotateX"]'
    extra = f"double xformOp:rotateZ = {angle}\n uniform token[] xformOpOrder = {order}"
    return lamp(kind, attributes, 1.0, api, extra)


def cylinder_factor(radius: float, length: float, height: float) -> float:
    """Form factor from a floor point to a cylinder above it, by fine quadrature over its surface."""
    x = (np.arange(2000) + 0.5) / 2000 * length - length / 2
    around = (np.arange(720) + 0.5) / 720 * 2 * np.pi
    position = np.stack(np.broadcast_arrays(x[:, None], height - radius * np.cos(around), radius * np.sin(around)), -1)
    normal = np.stack([np.zeros_like(around), -np.cos(around), np.sin(around)], -1)
    squared = (position**2).sum(-1)
    out = np.maximum((-position * normal).sum(-1), 0) * position[..., 1] / squared**2 / np.pi
    return float(out.sum() * (length / 2000) * (radius * 2 * np.pi / 720))


# A small normalized sphere: 40/4 W/sr to all sides.
POINT = "float inputs:intensity = 40\nfloat inputs:radius = .01\nbool inputs:normalize = 1\n"
SMOOTH = 1 - (0.5**2 * (3 - 2 * 0.5))
FORMS = {
    "rect": (lamp("RectLight", "float inputs:intensity = 3"), np.pi * 3 * 0.2394565),
    "rect_scaled": (
        lamp(
            "RectLight",
            "float inputs:intensity = 3\nfloat inputs:width = .5\nfloat inputs:height = 2\n"
            "float3 xformOp:scale = (2, .5, 1)",
            extra='uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateX", "xformOp:scale"]',
        ),
        np.pi * 3 * 0.2394565,
    ),
    "rect_normalized": (
        lamp(
            "RectLight",
            "float inputs:intensity = 8\nbool inputs:normalize = 1\nfloat inputs:width = 2\nfloat inputs:height = 2",
            2.0,
        ),
        np.pi * 8 / 4 * 0.2394565,
    ),
    "rect_exposed": (
        lamp("RectLight", "float inputs:intensity = 3\nfloat inputs:exposure = 2"),
        np.pi * 12 * 0.2394565,
    ),
    "rect_diffuse": (
        lamp("RectLight", "float inputs:intensity = 3\nfloat inputs:diffuse = .5"),
        np.pi * 1.5 * 0.2394565,
    ),
    "disk": (lamp("DiskLight", "float inputs:intensity = 3\nfloat inputs:radius = 1"), np.pi * 3 * 0.5),
    "sphere": (lamp("SphereLight", "float inputs:intensity = 30\nfloat inputs:radius = .2", 2.0), np.pi * 30 * 0.01),
    "sphere_normalized": (
        lamp("SphereLight", "float inputs:intensity = 30\nfloat inputs:radius = .2\nbool inputs:normalize = 1", 2.0),
        30 / 4 / 4,
    ),
    "sphere_as_point": (
        lamp("SphereLight", "float inputs:intensity = 30\nfloat inputs:radius = .2\nbool treatAsPoint = 1", 2.0),
        np.pi * 30 * 0.01,
    ),
    "distant": (
        lamp("DistantLight", "float inputs:intensity = 1000\nfloat inputs:angle = 10"),
        1000 * np.pi * np.sin(np.radians(5)) ** 2,
    ),
    "distant_normalized": (
        lamp("DistantLight", "float inputs:intensity = 4\nfloat inputs:angle = 10\nbool inputs:normalize = 1"),
        4.0,
    ),
    "distant_parallel": (lamp("DistantLight", "float inputs:intensity = 4\nfloat inputs:angle = 0"), 4.0),
    "dome": (lamp("DomeLight", "float inputs:intensity = 2"), np.pi * 2),
    "cylinder": (
        lamp("CylinderLight", "float inputs:intensity = 5\nfloat inputs:radius = .1\nfloat inputs:length = 2"),
        np.pi * 5 * cylinder_factor(0.1, 2.0, 1.0),
    ),
    "cylinder_normalized": (
        lamp(
            "CylinderLight",
            "float inputs:intensity = 5\nfloat inputs:radius = .1\nfloat inputs:length = 2\nbool inputs:normalize = 1",
        ),
        np.pi * 5 * cylinder_factor(0.1, 2.0, 1.0) / (2 * np.pi * 0.1 * 2),
    ),
    "cone_inside": (
        tilted(
            "SphereLight",
            POINT + "float inputs:shaping:cone:angle = 40",
            30,
        ),
        10.0,
    ),
    "cone_soft": (
        tilted(
            "SphereLight",
            "float inputs:intensity = 40\nfloat inputs:radius = .01\nbool inputs:normalize = 1\n"
            "float inputs:shaping:cone:angle = 40\nfloat inputs:shaping:cone:softness = .5",
            30,
        ),
        10.0 * SMOOTH,
    ),
    "focus": (
        tilted(
            "SphereLight",
            POINT + "float inputs:shaping:focus = 3",
            30,
        ),
        10.0 * np.cos(np.radians(30)) ** 3,
    ),
    "small_rect_cone": (
        tilted(
            "RectLight",
            "float inputs:intensity = 40\nbool inputs:normalize = 1\n"
            "float inputs:width = .01\nfloat inputs:height = .01\n"
            "float inputs:shaping:cone:angle = 40\nfloat inputs:shaping:cone:softness = .5",
            30,
        ),
        40.0 * SMOOTH * np.cos(np.radians(30)),
    ),
}


@pytest.mark.parametrize("name", FORMS)
def test_light_matches_its_closed_form(name: str, tmp_path: Path) -> None:
    body, expected = FORMS[name]
    measured = irradiance(tmp_path, body)
    assert measured == pytest.approx([expected] * 3, rel=TOLERANCE)


def test_photometric_stages_are_divided_by_the_efficacy(tmp_path: Path) -> None:
    body = lamp("RectLight", "float inputs:intensity = 683")
    measured = irradiance(tmp_path, body, settings=UsdSettings())
    assert measured == pytest.approx([np.pi * 0.2394565] * 3, rel=TOLERANCE)


def test_colour_temperature_tints(tmp_path: Path) -> None:
    body = lamp("RectLight", "bool inputs:enableColorTemperature = 1\nfloat inputs:colorTemperature = 3000")
    tint = np.array(UsdLux.BlackbodyTemperatureAsRgb(3000.0))
    assert irradiance(tmp_path, body) == pytest.approx(np.pi * 0.2394565 * tint, rel=TOLERANCE)


def test_centimetres_and_z_up(tmp_path: Path) -> None:
    """The same lamp in another frame: everything a hundred times larger, up along Z."""
    body = f"""
def Xform "Turned" {{
    double xformOp:rotateX = 90
    float3 xformOp:scale = (100, 100, 100)
    uniform token[] xformOpOrder = ["xformOp:rotateX", "xformOp:scale"]
    {lamp("RectLight", "float inputs:intensity = 3")}
    {FLOOR}
}}
"""
    stage = write_stage(tmp_path / "scene.usda", body, metres=0.01, up="Z")
    baked = bake_stage(stage, "--texels-per-metre", "100")
    measured = middle_of(baked, "/World/Turned/Floor")
    assert measured == pytest.approx([np.pi * 3 * 0.2394565] * 3, rel=TOLERANCE)


# A lamp that was measured: 100 cd along its axis, falling linearly to nothing at 60°.
IES = "IESNA:LM-63-2002\nTILT=NONE\n1 -1 1 4 1 1 2 0 0 0\n1 1 0\n0 30 60 90\n0\n100 50 0 0\n"


def test_ies_profile_multiplies_and_normalizes(tmp_path: Path) -> None:
    (tmp_path / "lamp.ies").write_text(IES)
    shaped = POINT + "asset inputs:shaping:ies:file = @lamp.ies@"
    measured = irradiance(tmp_path, tilted("SphereLight", shaped, 15))
    assert measured == pytest.approx([10.0 * 75] * 3, rel=TOLERANCE)
    # The mean over the sphere by hand: ½ ∫ (100 − 100 θ/60°) sin θ dθ.
    limit = np.pi / 3
    mean = 0.5 * 100 * (1 - np.cos(limit) - (np.sin(limit) - limit * np.cos(limit)) / limit)
    measured = irradiance(tmp_path, tilted("SphereLight", shaped + "\nbool inputs:shaping:ies:normalize = 1", 15))
    assert measured == pytest.approx([10.0 * 75 / mean] * 3, rel=TOLERANCE)


def test_ies_angles_scale(tmp_path: Path) -> None:
    (tmp_path / "lamp.ies").write_text(IES)
    shaped = POINT + "asset inputs:shaping:ies:file = @lamp.ies@\nfloat inputs:shaping:ies:angleScale = .5"
    measured = irradiance(tmp_path, tilted("SphereLight", shaped, 15))
    assert measured == pytest.approx([10.0 * 50] * 3, rel=TOLERANCE)


def test_focus_tint_keeps_its_colour_off_the_axis(tmp_path: Path) -> None:
    shaped = POINT + "float inputs:shaping:focus = 3\ncolor3f inputs:shaping:focusTint = (1, .5, 0)"
    factor = np.cos(np.radians(30)) ** 3
    tint = np.array([1, 0.5, 0])
    measured = irradiance(tmp_path, tilted("SphereLight", shaped, 30))
    assert measured == pytest.approx(10.0 * (tint + (1 - tint) * factor), rel=TOLERANCE)


def test_mesh_light(tmp_path: Path) -> None:
    """A square metre that shines down, one metre above; its own colour counts, not that of a material."""
    body = """
def Mesh "Panel" (prepend apiSchemas = ["MeshLightAPI"]) {
    uniform token subdivisionScheme = "none"
    int[] faceVertexCounts = [4]
    int[] faceVertexIndices = [0, 1, 2, 3]
    point3f[] points = [(-.5, 1, -.5), (.5, 1, -.5), (.5, 1, .5), (-.5, 1, .5)]
    float inputs:intensity = 3
    bool primvars:lightkiln:lightmap = 0
}
"""
    assert irradiance(tmp_path, body) == pytest.approx([np.pi * 3 * 0.2394565] * 3, rel=TOLERANCE)


def test_lights_that_cannot_be_expressed_are_named(tmp_path: Path) -> None:
    body = (
        FLOOR
        + 'def GeometryLight "Old" { }\n'
        + 'def RectLight "Zero" { float inputs:width = 0 }\n'
        + 'def SphereLight "Gone" { asset inputs:shaping:ies:file = @gone.ies@ }\n'
        + 'def DomeLight "Sky" { asset inputs:texture:file = @gone.exr@ }\n'
    )
    stage = write_stage(tmp_path / "scene.usda", body)
    done = convert(stage, tmp_path / "scene.glb", UsdSettings())
    places = {n.place for n in done.notes}
    assert {"/World/Old", "/World/Zero", "/World/Gone", "/World/Sky"} <= places
