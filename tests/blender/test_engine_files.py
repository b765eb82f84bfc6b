"""The files for engines: a lit GLB that is valid and shows what Blender shows, and a USD layer that changes nothing."""

from __future__ import annotations

import importlib
import json
import math
import struct
import subprocess
import zlib
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest

from baker import program
from blender_addon import engine_export
from blender_addon.export.lit import white
from tests.blender.scenes_in_blender import bake, irradiance, lamp, material, pixels, place, quad, world
from tests.blender.test_export import errors
from tests.blender.test_lifecycle import state_of_file


def furnished() -> bpy.types.Object:
    """A floor, a box with two materials, an instanced collection, and an unlit lamp shade that shares a material."""
    floor = quad("Floor", 2)
    wood = material("Wood", "ShaderNodeBsdfDiffuse", Color=(0.6, 0.4, 0.2, 1))
    floor.data.materials.append(wood)
    bpy.ops.mesh.primitive_cube_add(size=0.4, location=(0.5, 0, 0.2))
    bpy.context.object.name = "Box 1"
    bpy.context.object.modifiers.new("Round", "BEVEL")
    collection = bpy.data.collections.new("Set")
    child = quad("Child", 0.3, (0, 0, 0.4))
    collection.objects.link(child)
    bpy.context.scene.collection.objects.unlink(child)
    for x in (-0.6, 0.1):
        place(f"Empty {x}", None, (x, 0.5, 0), instance_type="COLLECTION", instance_collection=collection)
    shade = quad("Shade", 0.3, (0, -0.8, 0.5))
    shade.lightkiln.exclude = True
    shade.data.materials.append(wood)
    lamp("POINT", (0.2, -0.2, 1.5), energy=80, shadow_soft_size=0.1)
    return floor


def read_glb(path: Path) -> tuple[dict[str, Any], bytes]:
    """JSON and binary chunk."""
    data = path.read_bytes()
    length = struct.unpack_from("<I", data, 12)[0]
    return json.loads(data[20 : 20 + length]), data[28 + length :]


def read_png(data: bytes) -> np.ndarray:
    """Pixels of a PNG without filters, as the add-on writes them."""
    width, height = struct.unpack_from(">II", data, 16)
    at, parts = 8, []
    while at < len(data):
        size, kind = struct.unpack_from(">I4s", data, at)
        parts += [data[at + 8 : at + 8 + size]] if kind == b"IDAT" else []
        at += 12 + size
    rows = np.frombuffer(zlib.decompress(b"".join(parts)), np.uint8).reshape(height, -1)[:, 1:]
    return rows.reshape(height, width, -1)


def test_the_lit_glb_is_valid_and_shows_the_lightmap(tmp_path: Path) -> None:
    furnished()
    bake(density=24, error=10)
    bpy.ops.lightkiln.view(view="LIGHT")
    before = state_of_file()
    assert bpy.ops.lightkiln.export_glb() == {"FINISHED"}
    assert state_of_file() == before and bpy.context.scene.lightkiln.view == "LIGHT"
    folder = tmp_path / "lightmaps"
    assert sorted(p.name for p in folder.iterdir()) == ["untitled_Scene.exr", "untitled_Scene.lit.glb"]
    path = folder / "untitled_Scene.lit.glb"
    assert errors(path) == []
    document, binary = read_glb(path)
    lit: list[str] = []
    unlit: list[str] = []
    for node in document["nodes"]:
        for primitive in document["meshes"][node["mesh"]]["primitives"] if "mesh" in node else []:
            shows = "MOZ_lightmap" in document["materials"][primitive["material"]].get("extensions", {})
            (lit if shows else unlit).append(node["name"])
    assert set(lit) == {"Floor", "Box 1", "Empty -0.6/Child", "Empty 0.1/Child"} and unlit == ["Shade"]
    (image,) = document["images"]
    assert image["extras"]["lightmap"] == {"uri": "untitled_Scene.exr", "quantity": "radiance", "unit": "W/(m^2*sr)"}
    view = document["bufferViews"][image["bufferView"]]
    texture = read_png(binary[view["byteOffset"] : view["byteOffset"] + view["byteLength"]])
    intensity = next(m["extensions"]["MOZ_lightmap"]["intensity"] for m in document["materials"] if m.get("extensions"))
    shown = texture[::-1].astype(np.float64) / 255 * intensity
    truth = math.pi * pixels(bpy.context.scene.lightkiln.image)
    assert np.abs(shown - np.minimum(truth, intensity)).max() < intensity / 255


def test_a_rendered_sky_is_inside_the_lit_glb(tmp_path: Path) -> None:
    quad("Floor", 1)
    made = world((1, 1, 1), 1.0)
    tree = made.node_tree
    checker = tree.nodes.new("ShaderNodeTexChecker")
    background = next(n for n in tree.nodes if n.bl_idname == "ShaderNodeBackground")
    tree.links.new(checker.outputs["Color"], background.inputs["Color"])
    bake(density=8, error=20)
    bpy.ops.lightkiln.export_glb()
    path = tmp_path / "lightmaps" / "untitled_Scene.lit.glb"
    document, _ = read_glb(path)
    assert "bufferView" in document["extensions"]["LIGHTKILN_scene"]["environment"]["image"]
    again = subprocess.run([program(), "info", path], capture_output=True, text=True, check=True)
    assert "environment  image" in again.stdout


def test_white_leaves_out_a_few_that_outshine_all() -> None:
    page = np.full((100, 100, 3), 2.0, np.float32)
    assert white(page) == 2.0
    page[0, 0] = 3.0
    assert white(page) == 3.0
    page[0, 0] = 500.0
    assert white(page) == 2.0
    assert white(np.zeros((4, 4, 3), np.float32)) == 1.0


@pytest.mark.skipif(not engine_export.has_usd(), reason="this Blender has no USD")
def test_the_usd_layer_shows_the_lightmap_over_the_scene(tmp_path: Path) -> None:
    floor = furnished()
    settings = bpy.context.scene.lightkiln
    settings.storage = "FILE"
    bake(density=24, error=10)
    before = state_of_file()
    assert bpy.ops.lightkiln.export_usd() == {"FINISHED"}
    assert state_of_file() == before and settings.view == "LIT"
    folder = tmp_path / "lightmaps"
    names = ["untitled_Scene.exr", "untitled_Scene.lightmap.usda", "untitled_Scene.usdc"]
    assert sorted(p.name for p in folder.iterdir()) == names
    usd, geometry, shade = (importlib.import_module(f"pxr.{name}") for name in ("Usd", "UsdGeom", "UsdShade"))
    stage = usd.Stage.Open(str(folder / names[1]))
    lit = {}
    for prim in stage.Traverse():
        if prim.IsA(geometry.Mesh) and geometry.PrimvarsAPI(prim).HasPrimvar("lightmapUV"):
            lit[str(prim.GetPath().GetParentPath())] = prim
    assert len(lit) == 4 and "/root/Floor" in lit and not any("Shade" in path for path in lit)
    prim = lit["/root/Floor"]
    assert prim.GetAttribute("lightkiln:lightmap:file").Get().path == "./untitled_Scene.exr"
    assert prim.GetAttribute("lightkiln:lightmap:unit").Get() == "W/(m^2*sr)"
    # Coordinates lead to the same light as the material's in Blender.
    u, v = np.array(geometry.PrimvarsAPI(prim).GetPrimvar("lightmapUV").Get()).mean(axis=0)
    page = pixels(settings.image)
    texel = page[int(v * page.shape[0]), int(u * page.shape[1])]
    assert np.pi * texel == pytest.approx(irradiance(floor), rel=0.1)
    children = [p for path, p in lit.items() if "Child" in path]
    first, second = (np.array(geometry.PrimvarsAPI(p).GetPrimvar("lightmapUV").Get()) for p in children)
    assert not np.allclose(first, second)
    # The scene's own materials, until the preview is chosen.
    root = stage.GetPrimAtPath("/root")
    bound = shade.MaterialBindingAPI(prim).ComputeBoundMaterial()[0]
    assert "Wood" in str(bound.GetPath())
    root.GetVariantSets().SetSelection("lightmap", "preview")
    bound = shade.MaterialBindingAPI(prim).ComputeBoundMaterial()[0]
    assert "LightkilnPreview" in str(bound.GetPath())
    scale = stage.GetPrimAtPath(f"{bound.GetPath()}/lightmap").GetAttribute("inputs:scale").Get()
    assert tuple(scale)[:3] == pytest.approx((0.6, 0.4, 0.2))


def test_exports_need_a_folder_and_a_lightmap() -> None:
    furnished()
    assert not bpy.ops.lightkiln.export_glb.poll()
    bake(density=8, error=20)
    bpy.context.scene.lightkiln.folder = "//beside"
    with pytest.raises(RuntimeError, match="save the file"):
        bpy.ops.lightkiln.export_glb()
    assert bpy.context.scene.lightkiln.view == "LIT"
