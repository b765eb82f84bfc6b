"""What a stage shows: composition, instancing, visibility, purposes; and the way of the lightmap back to it."""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np
import pytest
from pxr import Usd, UsdGeom, UsdShade

from lightkiln_pipeline import program
from lightkiln_pipeline.errors import Notes, PipelineError
from lightkiln_pipeline.glb.reader import GlbReader
from lightkiln_pipeline.usd.convert import UsdSettings, convert
from lightkiln_pipeline.usd.layer import added_errors, validation_errors, write_layer
from lightkiln_pipeline.usd.lightmap_uv import read_lit
from lightkiln_pipeline.usd.stage import source_files
from stages import FLOOR, bake_stage, bilinear, read_rgb, write_stage

BOX = """
def Mesh "Box" {
    uniform token subdivisionScheme = "none"
    int[] faceVertexCounts = [4, 4, 4, 4, 4, 4]
    int[] faceVertexIndices = [0, 2, 3, 1, 4, 5, 7, 6, 0, 1, 5, 4, 2, 6, 7, 3, 0, 4, 6, 2, 1, 3, 7, 5]
    point3f[] points = [(-1, -1, -1), (1, -1, -1), (-1, 1, -1), (1, 1, -1),
        (-1, -1, 1), (1, -1, 1), (-1, 1, 1), (1, 1, 1)]
}
"""
SKY = 'def DomeLight "Sky" { float inputs:intensity = 1 }'


def names(path: Path) -> set[str]:
    """Names of the mesh nodes of a GLB."""
    return {n["name"] for n in GlbReader(path).items("nodes") if "mesh" in n}


def convert_body(tmp_path: Path, body: str, settings: UsdSettings | None = None) -> tuple[Path, str]:
    """The GLB of a stage, and the notes."""
    stage = write_stage(tmp_path / "scene.usda", body)
    done = convert(stage, tmp_path / "scene.glb", settings or UsdSettings())
    return tmp_path / "scene.glb", "\n".join(map(str, done.notes))


def test_visibility_and_purpose(tmp_path: Path) -> None:
    body = f"""
def Xform "Hidden" {{ token visibility = "invisible"
    {BOX} }}
def Xform "Proxy" {{ uniform token purpose = "proxy"
    {BOX} }}
def Xform "Render" {{ uniform token purpose = "render"
    {BOX} }}
def Xform "Plain" {{ {BOX} }}
"""
    glb, _ = convert_body(tmp_path, body)
    assert names(glb) == {"/World/Render/Box", "/World/Plain/Box"}
    glb, _ = convert_body(tmp_path, body, UsdSettings(purposes=("default", "proxy")))
    assert names(glb) == {"/World/Proxy/Box", "/World/Plain/Box"}


def test_references_payloads_variants_and_sublayers(tmp_path: Path) -> None:
    write_stage(tmp_path / "part.usda", BOX)
    write_stage(tmp_path / "under.usda", 'def Xform "FromSublayer" (references = @./part.usda@) { }')
    stage = write_stage(tmp_path / "scene.usda", """
def Xform "A" (references = @./part.usda@) { }
def Xform "B" (payload = @./part.usda@) { }
def Xform "C" (
    variants = { string size = "big" }
    prepend variantSets = "size"
) {
    variantSet "size" = {
        "big" { def Xform "Big" (references = @./part.usda@) { } }
        "small" { def Xform "Small" (references = @./part.usda@) { } }
    }
}""")  # fmt: skip
    text = stage.read_text().replace('upAxis = "Y"', 'upAxis = "Y"\n    subLayers = [@./under.usda@]')
    stage.write_text(text)
    convert(stage, tmp_path / "s.glb", UsdSettings())
    assert names(tmp_path / "s.glb") == {f"/World/{p}/Box" for p in ("A", "B", "C/Big", "FromSublayer")}
    convert(stage, tmp_path / "s.glb", UsdSettings(variants={"/World/C{size}": "small"}))
    assert "/World/C/Small/Box" in names(tmp_path / "s.glb")
    assert [p.name for p in source_files(stage)] == ["part.usda", "scene.usda", "under.usda"]


def test_missing_and_cyclic_references_are_named_and_the_rest_goes_on(tmp_path: Path) -> None:
    glb, notes = convert_body(tmp_path, f"""
def Xform "Gone" (references = @./gone.usda@) {{ }}
def Xform "Round" (references = </World/Round/Again>) {{ def Xform "Again" (references = </World/Round>) {{ }} }}
{BOX}""")  # fmt: skip
    assert names(glb) == {"/World/Box"}
    assert "/World/Gone: does not compose" in notes
    assert "gone.usda" in notes
    assert "/World/Round" in notes


@pytest.mark.parametrize("content", ["", "#usda 1.0\ndef {", "PXR-USDC broken"])
def test_broken_layers_are_an_error(tmp_path: Path, content: str) -> None:
    path = tmp_path / "broken.usd"
    path.write_text(content)
    with pytest.raises(PipelineError, match=r"broken\.usd"):
        convert(path, tmp_path / "s.glb", UsdSettings())


def test_sheared_and_mirrored_transforms_keep_world_positions(tmp_path: Path) -> None:
    body = f"""
def Xform "Turn" {{
    float3 xformOp:scale = (1, 3, -2)
    uniform token[] xformOpOrder = ["xformOp:scale"]
    def Xform "In" {{
        double xformOp:rotateZ = 30
        uniform token[] xformOpOrder = ["xformOp:rotateZ"]
        {BOX}
    }}
}}"""
    glb_path, _ = convert_body(tmp_path, body)
    glb = GlbReader(glb_path)
    (node,) = (n for n in glb.items("nodes") if "mesh" in n)
    assert "scale" not in node, "a sheared matrix goes into the vertices"
    attributes = glb.items("meshes")[0]["primitives"][0]["attributes"]
    positions, normals = glb.values(attributes["POSITION"]), glb.values(attributes["NORMAL"])
    stage = Usd.Stage.Open(str(tmp_path / "scene.usda"))
    bound = UsdGeom.BBoxCache(Usd.TimeCode.Default(), ["default"]).ComputeWorldBound(stage.GetPrimAtPath("/World/Turn"))
    box = bound.ComputeAlignedRange()
    assert positions.min(axis=0)[2] == pytest.approx(box.GetMin()[2])
    assert positions.max(axis=0)[2] == pytest.approx(box.GetMax()[2])
    indices = glb.values(glb.items("meshes")[0]["primitives"][0]["indices"]).reshape(-1, 3)
    a, b, c = (positions[indices[:, i]] for i in range(3))
    assert ((np.cross(b - a, c - a) * normals[indices[:, 0]]).sum(axis=1) > 0).all(), "faces look where normals point"
    assert ((a * normals[indices[:, 0]]).sum(axis=1) > 0).all(), "and that is outwards"


INSTANCED = f"""
class Xform "Proto" {{ {BOX} }}
def Xform "One" (inherits = </World/Proto> instanceable = true) {{ }}
def Xform "Two" (inherits = </World/Proto> instanceable = true) {{
    double3 xformOp:translate = (5, 0, 0)
    uniform token[] xformOpOrder = ["xformOp:translate"]
}}
def PointInstancer "Many" {{
    double3 xformOp:translate = (0, 0, 6)
    uniform token[] xformOpOrder = ["xformOp:translate"]
    point3f[] positions = [(0, 0, 0), (4, 0, 0), (8, 0, 0)]
    int[] protoIndices = [0, 0, 0]
    int64[] invisibleIds = [1]
    rel prototypes = </World/Many/Thing>
    def Xform "Thing" {{
        float3 xformOp:scale = (.5, .5, .5)
        uniform token[] xformOpOrder = ["xformOp:scale"]
        {BOX}
    }}
}}
{SKY}
""".replace("instanceable = true)", "\n instanceable = true\n)").replace("(inherits", "(\n inherits")


def test_instances_have_the_colours_that_are_handed_down(tmp_path: Path) -> None:
    body = f"""
class Xform "Proto" {{ {BOX} }}
def Xform "Red" (
    inherits = </World/Proto>
    instanceable = true
) {{ color3f[] primvars:displayColor = [(1, 0, 0)] }}
def Xform "Blue" (
    inherits = </World/Proto>
    instanceable = true
) {{ color3f[] primvars:displayColor = [(0, 0, 1)] }}
"""
    path, _ = convert_body(tmp_path, body)
    glb = GlbReader(path)
    colors = {}
    for node in glb.items("nodes"):
        attributes = glb.items("meshes")[node["mesh"]]["primitives"][0]["attributes"]
        colors[node["name"]] = glb.values(attributes["COLOR_0"])[0].tolist()
    assert colors == {"/World/Red/Box": [1, 0, 0], "/World/Blue/Box": [0, 0, 1]}


def test_round_trip_of_instances(tmp_path: Path) -> None:
    """USD → bake → layer → no new errors → the layer's coordinates find the light that was baked."""
    stage_path = write_stage(tmp_path / "scène 1.usda", INSTANCED)
    before = hashlib.sha256(stage_path.read_bytes()).hexdigest()
    baked = bake_stage(stage_path, "--texels-per-metre", "4", "--error", "10%")
    assert baked.report["scene"]["instances"] == 4
    assert baked.report["scene"]["meshes"] == 2, "instances share their mesh"
    target = baked.folder / "lit layer.usda"
    notes = Notes()
    write_layer(stage_path, next(baked.folder.glob("*.lit.glb")), target, notes)
    assert notes.list() == []
    assert added_errors(stage_path, target) == []
    assert hashlib.sha256(stage_path.read_bytes()).hexdigest() == before

    lit = Usd.Stage.Open(str(target))
    meshes = [p for p in lit.Traverse(Usd.TraverseInstanceProxies()) if p.HasAttribute("primvars:lightmapUV")]
    assert {str(p.GetPath()) for p in meshes} == {
        "/World/One/Box",
        "/World/Two/Box",
        "/World/Many_lightmapped/instance_0/prototype/Box",
        "/World/Many_lightmapped/instance_2/prototype/Box",
    }
    shown = UsdGeom.Imageable(lit.GetPrimAtPath("/World/Many")).ComputeVisibility()
    assert shown == UsdGeom.Tokens.invisible
    places = set()
    for prim in meshes:
        uv = np.array(UsdGeom.PrimvarsAPI(prim).GetPrimvar("lightmapUV").Get())
        file = prim.GetAttribute("lightkiln:lightmap:file").Get()
        assert file.resolvedPath
        page = read_rgb(Path(file.resolvedPath))
        # The upper face (+Y) of a box is number 3; only sky is above it.
        u, v = uv[12:16].mean(axis=0)
        assert bilinear(page, float(u), float(v)) == pytest.approx([np.pi] * 3, rel=0.02)
        assert prim.GetAttribute("lightkiln:lightmap:unit").Get() == "W/m^2"
        assert prim.GetAttribute("lightkiln:lightmap:quantity").Get() == "irradiance"
        places.add((round(float(u), 4), round(float(v), 4)))
    assert len(places) == 4, "every instance has a place of its own"
    world = UsdGeom.XformCache().GetLocalToWorldTransform(
        lit.GetPrimAtPath("/World/Many_lightmapped/instance_2/prototype/Box")
    )
    assert list(world.Transform((1, 1, 1))) == pytest.approx([8.5, 0.5, 6.5])


def test_preview_shows_the_lightmap_over_the_sources_own_bindings(tmp_path: Path) -> None:
    bound = 'def Mesh "Floor" (\n prepend apiSchemas = ["MaterialBindingAPI"]\n) {\n rel material:binding = </World/M>'
    body = FLOOR.replace('def Mesh "Floor" {', bound) + SKY + '\ndef Material "M" { }'
    stage_path = write_stage(tmp_path / "scene.usda", body)
    baked = bake_stage(stage_path, "--texels-per-metre", "100")
    target = baked.folder / "lit.usda"
    write_layer(stage_path, next(baked.folder.glob("*.lit.glb")), target, Notes())
    lit = Usd.Stage.Open(str(target))
    floor = UsdShade.MaterialBindingAPI(lit.GetPrimAtPath("/World/Floor"))
    assert floor.ComputeBoundMaterial()[0].GetPath() == "/World/M"
    lit.GetPrimAtPath("/World").GetVariantSets().SetSelection("lightmap", "preview")
    shown = floor.ComputeBoundMaterial()[0]
    assert "LightkilnPreview" in str(shown.GetPath())
    texture = UsdShade.Shader(lit.GetPrimAtPath(shown.GetPath().AppendChild("lightmap")))
    assert texture.GetInput("file").Get().resolvedPath.endswith("lightmap_0.exr")


def test_the_layer_bakes_to_the_same_light(tmp_path: Path) -> None:
    """Re-import of the layer: the same scene with the same light."""
    stage_path = write_stage(tmp_path / "scene.usda", INSTANCED)
    baked = bake_stage(stage_path, "--texels-per-metre", "4", "--error", "10%")
    target = baked.folder / "again.usda"
    write_layer(stage_path, next(baked.folder.glob("*.lit.glb")), target, Notes())
    again = bake_stage(target, "--texels-per-metre", "4", "--error", "10%")
    assert again.report["scene"]["instances"] == 4
    assert again.report["scene"]["triangles"] == baked.report["scene"]["triangles"]
    assert again.page().mean() == pytest.approx(baked.page().mean(), rel=0.02)


def test_the_source_is_never_overwritten(tmp_path: Path) -> None:
    stage_path = write_stage(tmp_path / "scene.usda", FLOOR + SKY)
    baked = bake_stage(stage_path, "--texels-per-metre", "100")
    with pytest.raises(PipelineError, match="overwrite its source"):
        write_layer(stage_path, next(baked.folder.glob("*.lit.glb")), stage_path, Notes())


def test_subdivided_cages_get_coordinates_per_source_corner(tmp_path: Path) -> None:
    body = BOX.replace('"none"', '"catmullClark"') + SKY
    stage_path = write_stage(tmp_path / "scene.usda", body)
    baked = bake_stage(stage_path, "--texels-per-metre", "4", settings=UsdSettings(level=2))
    assert baked.report["scene"]["triangles"] == 6 * 16 * 2
    (mesh,) = read_lit(next(baked.folder.glob("*.lit.glb"))).meshes
    corners = np.concatenate([c for c, _ in mesh.pages.values()])
    assert set(corners) == set(range(24))


def test_a_scene_without_light_gets_a_sky(tmp_path: Path) -> None:
    glb, notes = convert_body(tmp_path, FLOOR)
    assert GlbReader(glb).json["extensions"]["LIGHTKILN_scene"]["environment"] == {"radiance": [1.0, 1.0, 1.0]}
    assert "no light at all" in notes


def test_dome_pictures_keep_their_orientation(tmp_path: Path) -> None:
    """A dome that is bright towards +X only lights what looks towards +X: OpenEXR has +X a quarter from the left."""
    import OpenImageIO as oiio

    sky = np.zeros((32, 64, 3), np.float32)
    sky[12:20, 12:20] = 50.0
    spec = oiio.ImageSpec(64, 32, 3, oiio.FLOAT)
    picture = oiio.ImageBuf(spec)
    picture.set_pixels(spec.roi, sky)
    assert picture.write(str(tmp_path / "sky.exr"))
    wall = FLOOR.replace(
        '"Floor" {', '"Floor" {\n double xformOp:rotateZ = {angle}\n uniform token[] xformOpOrder = ["xformOp:rotateZ"]'
    )
    received = {}
    for axis, angle in (("+X", -90), ("-X", 90)):
        body = wall.replace("{angle}", str(angle)) + 'def DomeLight "Sky" { asset inputs:texture:file = @../sky.exr@ }'
        stage = write_stage(tmp_path / axis / "scene.usda", body)
        received[axis] = float(bake_stage(stage, "--texels-per-metre", "100").page().mean())
    assert received["-X"] < 1e-3 * received["+X"]
    assert received["+X"] > 1


def test_the_bundled_courtyard_bakes_without_a_warning(tmp_path: Path) -> None:
    source = Path(__file__).resolve().parents[2] / "scenes" / "courtyard.usda"
    done = convert(source, tmp_path / "courtyard.glb", UsdSettings(level=2))
    assert done.notes == []
    assert (done.instances, done.lamps) == (9, 2)
    result = program.bake(
        tmp_path / "courtyard.glb", tmp_path / "out", ["--uv", "pack", "--error", "10%"], lambda _: None
    )
    assert result.notes == []
    target = tmp_path / "out" / "courtyard.usda"
    write_layer(source, tmp_path / "out" / "courtyard.lit.glb", target, Notes())
    assert validation_errors(target) == set()
