"""UsdPreviewSurface and its textures: networks → glTF materials with the same values."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import OpenImageIO as oiio
import pytest

from lightkiln_pipeline.glb.reader import GlbReader
from lightkiln_pipeline.usd.convert import Conversion, UsdSettings, convert
from stages import write_stage

QUAD = """
def Mesh "Quad" (prepend apiSchemas = ["MaterialBindingAPI"]) {
    uniform token subdivisionScheme = "none"
    int[] faceVertexCounts = [4]
    int[] faceVertexIndices = [0, 1, 2, 3]
    point3f[] points = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]
    texCoord2f[] primvars:st = [(0, 0), (1, 0), (1, 1), (0, 1)] (interpolation = "vertex")
    color3f[] primvars:paint = [(1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 1)] (interpolation = "vertex")
    rel material:binding = </World/Mat>
}
"""

DIFFUSE = "color3f inputs:diffuseColor.connect = </World/Mat/T.outputs:rgb>"


def material(inputs: str, nodes: str = "") -> str:
    """A material with one UsdPreviewSurface."""
    return f"""
def Material "Mat" {{
    token outputs:surface.connect = </World/Mat/S.outputs:surface>
    def Shader "S" {{
        uniform token info:id = "UsdPreviewSurface"
        {inputs}
        token outputs:surface
    }}
    {nodes}
}}
"""


def texture(file: str, inputs: str = "", transform: str = "") -> str:
    """A UsdUVTexture with its reader, and a transform between them."""
    source = "T2" if transform else "R"
    return f"""
    def Shader "T" {{
        uniform token info:id = "UsdUVTexture"
        asset inputs:file = @{file}@
        float2 inputs:st.connect = </World/Mat/{source}.outputs:result>
        {inputs}
        float3 outputs:rgb
        float outputs:r
        float outputs:a
    }}
    def Shader "R" {{
        uniform token info:id = "UsdPrimvarReader_float2"
        string inputs:varname = "st"
        float2 outputs:result
    }}
    def Shader "T2" {{
        uniform token info:id = "UsdTransform2d"
        float2 inputs:in.connect = </World/Mat/R.outputs:result>
        {transform}
        float2 outputs:result
    }}
"""


def write_image(path: Path, pixels: np.ndarray, bits: str = "uint8") -> None:
    """A picture with values as they are stored."""
    spec = oiio.ImageSpec(pixels.shape[1], pixels.shape[0], pixels.shape[2], bits)
    # What is stored is what is given: no premultiplication.
    spec.attribute("oiio:UnassociatedAlpha", 1)
    picture = oiio.ImageBuf(spec)
    picture.set_pixels(spec.roi, np.ascontiguousarray(pixels, np.float32))
    assert picture.write(str(path))


def converted(tmp_path: Path, body: str) -> tuple[GlbReader, Conversion]:
    """The GLB of a stage with the quad."""
    stage = write_stage(tmp_path / "scene.usda", QUAD + body)
    done = convert(stage, tmp_path / "scene.glb", UsdSettings(light_units="radiometric"))
    return GlbReader(tmp_path / "scene.glb"), done


def picture(glb: GlbReader, index: int, tmp_path: Path) -> np.ndarray:
    """The stored values of an image, 0..1."""
    image = glb.items("images")[glb.items("textures")[index]["source"]]
    path = tmp_path / f"embedded.{image['mimeType'].partition('/')[2]}"
    path.write_bytes(glb.view(image["bufferView"]))
    config = oiio.ImageSpec()
    config.attribute("oiio:UnassociatedAlpha", 1)
    file = oiio.ImageInput.open(str(path), config)
    assert file is not None
    return np.asarray(file.read_image(oiio.FLOAT)).reshape(file.spec().height, file.spec().width, -1)


def srgb(value: float) -> float:
    """A linear value as sRGB stores it."""
    return 12.92 * value if value <= 0.0031308 else 1.055 * value ** (1 / 2.4) - 0.055


def test_constants(tmp_path: Path) -> None:
    glb, done = converted(tmp_path, material("""
        color3f inputs:diffuseColor = (.1, .2, .3)
        color3f inputs:emissiveColor = (2, 4, 1)
        float inputs:metallic = .25
    """))  # fmt: skip
    (made,) = glb.items("materials")
    assert made["pbrMetallicRoughness"]["baseColorFactor"] == pytest.approx([0.1, 0.2, 0.3, 1])
    assert made["pbrMetallicRoughness"]["metallicFactor"] == 0.25
    strength = made["extensions"]["KHR_materials_emissive_strength"]["emissiveStrength"]
    assert [f * strength for f in made["emissiveFactor"]] == pytest.approx([2, 4, 1])
    assert done.notes == []


def test_the_specular_workflow_has_no_metals(tmp_path: Path) -> None:
    glb, _ = converted(tmp_path, material("int inputs:useSpecularWorkflow = 1\nfloat inputs:metallic = 1"))
    assert glb.items("materials")[0]["pbrMetallicRoughness"]["metallicFactor"] == 0


def test_unauthored_inputs_are_the_specification_s(tmp_path: Path) -> None:
    glb, _ = converted(tmp_path, material(""))
    assert glb.items("materials")[0]["pbrMetallicRoughness"]["baseColorFactor"] == pytest.approx([0.18, 0.18, 0.18, 1])


@pytest.mark.parametrize(
    ("kind", "space", "stored", "linear"),
    [
        ("uint8", "auto", 0.5, 0.21404),
        ("uint8", "raw", 0.5, 0.5),
        ("half", "auto", 0.5, 0.5),
        ("half", "sRGB", 0.5, 0.21404),
    ],
)
def test_colour_spaces_scale_and_bias(tmp_path: Path, kind: str, space: str, stored: float, linear: float) -> None:
    file = "t.png" if kind == "uint8" else "t.exr"
    write_image(tmp_path / file, np.full((4, 4, 3), stored), kind)
    inputs = f'token inputs:sourceColorSpace = "{space}"\n'
    inputs += "float4 inputs:scale = (.5, 1, 1, 1)\nfloat4 inputs:bias = (.1, 0, 0, 0)"
    glb, _ = converted(tmp_path, material(DIFFUSE, texture(file, inputs)))
    values = picture(glb, 0, tmp_path)[0, 0]
    assert values[:3] == pytest.approx([srgb(0.5 * linear + 0.1), srgb(linear), srgb(linear)], abs=0.006)


def test_opacity_texture_becomes_a_mask(tmp_path: Path) -> None:
    pixels = np.zeros((2, 2, 4))
    pixels[..., 0] = 1
    pixels[0, 0, 3] = 1
    write_image(tmp_path / "t.png", pixels)
    glb, _ = converted(tmp_path, material("""
        color3f inputs:diffuseColor.connect = </World/Mat/T.outputs:rgb>
        float inputs:opacity.connect = </World/Mat/T.outputs:a>
        float inputs:opacityThreshold = .5
    """, texture("t.png")))  # fmt: skip
    made = glb.items("materials")[0]
    assert (made["alphaMode"], made["alphaCutoff"]) == ("MASK", 0.5)
    alpha = picture(glb, 0, tmp_path)[..., 3]
    assert alpha.tolist() == [[1, 0], [0, 0]]


def test_emissive_textures_keep_values_above_one(tmp_path: Path) -> None:
    pixels = np.ones((2, 2, 3))
    pixels[0, 0] = (8, 4, 2)
    write_image(tmp_path / "t.exr", pixels, "float")
    glb, _ = converted(tmp_path, material(DIFFUSE.replace("diffuse", "emissive"), texture("t.exr")))
    made = glb.items("materials")[0]
    strength = made["extensions"]["KHR_materials_emissive_strength"]["emissiveStrength"]
    stored = picture(glb, made["emissiveTexture"]["index"], tmp_path)
    assert strength == pytest.approx(8)
    assert stored[0, 0] == pytest.approx([srgb(1), srgb(0.5), srgb(0.25)], abs=0.004)
    assert stored[1, 1, 0] == pytest.approx(srgb(1 / 8), abs=0.004)


def test_transform2d_moves_the_same_point_to_the_same_texel(tmp_path: Path) -> None:
    write_image(tmp_path / "t.png", np.full((4, 4, 3), 0.5))
    transform = "float inputs:rotation = 30\nfloat2 inputs:scale = (2, 3)\nfloat2 inputs:translation = (.1, .2)"
    nodes = texture("t.png", "", transform)
    glb, _ = converted(tmp_path, material(DIFFUSE, nodes))
    info = glb.items("materials")[0]["pbrMetallicRoughness"]["baseColorTexture"]["extensions"]["KHR_texture_transform"]
    angle, (ox, oy), (sx, sy) = info["rotation"], info["offset"], info["scale"]
    cos, sin = np.cos(angle), np.sin(angle)
    for s, t in ((0.0, 0.0), (1.0, 0.0), (0.3, 0.8)):
        # USD: scale, rotate, translate with t upwards; glTF the same with v downwards.
        c, n = np.cos(np.radians(30)), np.sin(np.radians(30))
        wanted = (c * 2 * s - n * 3 * t + 0.1, n * 2 * s + c * 3 * t + 0.2)
        u, v = s, 1 - t
        got = (cos * sx * u + sin * sy * v + ox, -sin * sx * u + cos * sy * v + oy)
        assert (got[0], 1 - got[1]) == pytest.approx(wanted)


def test_primvar_colours_become_vertex_colours(tmp_path: Path) -> None:
    nodes = """
    def Shader "P" {
        uniform token info:id = "UsdPrimvarReader_float3"
        string inputs:varname = "paint"
        float3 outputs:result
    }"""
    glb, _ = converted(tmp_path, material("color3f inputs:diffuseColor.connect = </World/Mat/P.outputs:result>", nodes))
    attributes = glb.items("meshes")[0]["primitives"][0]["attributes"]
    colors = glb.values(attributes["COLOR_0"])
    assert {tuple(c) for c in colors.tolist()} == {(1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 1)}


FAULTS: dict[str, tuple[str, str]] = {
    "was not found": (
        material(DIFFUSE, texture("gone.png", "float4 inputs:fallback = (.9, 0, 0, 1)")),
        "gone.png",
    ),
    "put the file there": (
        material(DIFFUSE, texture("t.<UDIM>.png", "float4 inputs:fallback = (.9, 0, 0, 1)")),
        "t.<UDIM>.png",
    ),
    "is not read; the display colour is baked": (
        material("").replace("UsdPreviewSurface", "MyRendererSurface"),
        "MyRendererSurface",
    ),
}  # fmt: skip


@pytest.mark.parametrize("message", FAULTS)
def test_what_cannot_be_read_is_named(tmp_path: Path, message: str) -> None:
    body, name = FAULTS[message]
    glb, done = converted(tmp_path, body)
    assert any(message in n.message and name in str(n) for n in done.notes), done.notes
    if "fallback = " in body:
        assert glb.items("materials")[0]["pbrMetallicRoughness"]["baseColorFactor"][:3] == pytest.approx([0.9, 0, 0])


# Colours of the tiles of a set with a gap: (column, row) → stored red.
SET = {(1, 0): 0.2, (2, 0): 0.4, (2, 1): 0.8}


@pytest.mark.parametrize(("transform", "turned"), [
    ("", False),
    ("float2 inputs:scale = (2, 1)\n        float2 inputs:translation = (1, 0)", False),
    ("float inputs:rotation = 90\n        float2 inputs:translation = (3, 0)", True),
])  # fmt: skip
def test_tiles_of_a_udim_set_lie_where_their_numbers_say(tmp_path: Path, transform: str, turned: bool) -> None:
    for (u, v), red in SET.items():
        # Tiles of different sizes; each has a dark top row.
        side = 8 if (u, v) == (1, 0) else 4
        pixels = np.zeros((side, side, 3), np.float32)
        pixels[side // 4 :, :, 0] = red
        write_image(tmp_path / f"t.{1001 + u + 10 * v}.png", pixels)
    nodes = texture("t.<UDIM>.png", "float4 inputs:fallback = (0, 1, 0, 1)", transform)
    glb, done = converted(tmp_path, material(DIFFUSE, nodes))
    assert [n.message.partition(":")[0] for n in done.notes] == ["it has no light at all"]
    info = glb.items("materials")[0]["pbrMetallicRoughness"]["baseColorTexture"]
    shown = picture(glb, info["index"], tmp_path)
    assert shown.shape == (16, 16, 3)
    placing = info["extensions"]["KHR_texture_transform"]

    def seen(st: tuple[float, float]) -> float | str:
        """What glTF shows at the coordinates that a mesh has in USD: stored red, or that it is green."""
        u, v = st[0], 1 - st[1]
        (sx, sy), (ox, oy), angle = placing["scale"], placing["offset"], placing["rotation"]
        cos, sin = np.cos(angle), np.sin(angle)
        x, y = cos * sx * u + sin * sy * v + ox, -sin * sx * u + cos * sy * v + oy
        red, green, _ = shown[int(y * 16), int(x * 16)]
        return "fallback" if green > 0.9 else round(float(red), 2)

    def source(at: tuple[float, float]) -> tuple[float, float]:
        """Coordinates of the mesh that the transform takes to those of a tile."""
        if turned:
            return at[1], 3 - at[0]
        return ((at[0] - 1) / 2, at[1]) if transform else at

    for (u, v), red in SET.items():
        assert seen(source((u + 0.4, v + 0.4))) == pytest.approx(red, abs=0.03)
        # Made larger, an edge swings a little.
        assert seen(source((u + 0.4, v + 0.9))) == pytest.approx(0.0, abs=0.07)
    assert seen(source((1.4, 1.4))) == "fallback"


def test_a_broken_picture_is_named(tmp_path: Path) -> None:
    (tmp_path / "t.png").write_bytes(b"no picture")
    _, done = converted(tmp_path, material(DIFFUSE, texture("t.png")))
    assert any("cannot be read" in n.message and "t.png" in n.place for n in done.notes), done.notes


def test_subsets_have_materials_of_their_own(tmp_path: Path) -> None:
    body = """
def Mesh "Two" (prepend apiSchemas = ["MaterialBindingAPI"]) {
    uniform token subdivisionScheme = "none"
    int[] faceVertexCounts = [3, 3]
    int[] faceVertexIndices = [0, 1, 2, 0, 2, 3]
    point3f[] points = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]
    color3f[] primvars:displayColor = [(0, 0, 1)]
    def GeomSubset "Part" (prepend apiSchemas = ["MaterialBindingAPI"]) {
        uniform token elementType = "face"
        uniform token familyName = "materialBind"
        int[] indices = [1]
        rel material:binding = </World/Mat>
    }
}"""
    glb, _ = converted(tmp_path, body + material("color3f inputs:diffuseColor = (1, 0, 0)"))
    mesh: dict[str, Any] = next(m for m in glb.items("meshes") if m["name"] == "Two")
    named = [glb.items("materials")[p["material"]]["name"] for p in mesh["primitives"]]
    assert sorted(named) == ["/World/Mat", "displayColor"]
