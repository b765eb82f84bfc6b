"""What the add-on writes is valid glTF and says what the scene holds."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest

from blender_addon import receivers
from blender_addon.changes import Changes
from blender_addon.errors import Note
from blender_addon.export.snapshot import take
from blender_addon.export.write import Writer
from blender_addon.places import arrange
from glb import Glb
from node import run_script
from tests.blender.scenes_in_blender import lamp, material, place, quad, world


def export(folder: Path) -> tuple[Glb, list[Note], Path]:
    """Exports the scene as a bake does."""
    scene, layer = bpy.context.scene, bpy.context.view_layer
    maps, notes = receivers.prepare(scene, receivers.candidates(scene, layer), Changes())
    layer.update()
    snapshot = take(scene, layer)
    chosen, more = receivers.chosen(scene, layer, snapshot, maps)
    writer = Writer(snapshot, arrange(chosen, snapshot.meshes, scene.lightkiln.resolution_limit), chosen)
    writer.collect(scene.world, folder, {})
    path = folder / "scene.glb"
    writer.finish(path)
    return Glb.read(path), notes + more + writer.notes, path


def errors(path: Path) -> list[str]:
    """The Khronos validator's errors."""
    report: dict[str, Any] = run_script("validate.cjs", path)[str(path)]
    return [f"{m['code']} at {m.get('pointer')}" for m in report["issues"]["messages"] if m["severity"] == 0]


def textured(name: str, image: bpy.types.Image, alpha: str = "") -> bpy.types.Material:
    """A Principled material with an image as base colour, and its alpha as opacity if asked for."""
    made = material(name, "ShaderNodeBsdfPrincipled", Roughness=0.7)
    tree = made.node_tree
    node = tree.nodes.new("ShaderNodeTexImage")
    node.image = image
    shader = next(n for n in tree.nodes if n.bl_idname == "ShaderNodeBsdfPrincipled")
    tree.links.new(node.outputs["Color"], shader.inputs["Base Color"])
    if alpha == "cut":
        cut = tree.nodes.new("ShaderNodeMath")
        cut.operation = "GREATER_THAN"
        cut.inputs[1].default_value = 0.4
        tree.links.new(node.outputs["Alpha"], cut.inputs[0])
        tree.links.new(cut.outputs[0], shader.inputs["Alpha"])
    elif alpha:
        tree.links.new(node.outputs["Alpha"], shader.inputs["Alpha"])
    return made


def checkered(name: str, *, is_float: bool = False) -> bpy.types.Image:
    """A small image with a hole in its alpha."""
    image = bpy.data.images.new(name, 8, 8, alpha=True, float_buffer=is_float)
    rows = np.ones((8, 8, 4), np.float32)
    rows[::2, :, :3] = (0.8, 0.2, 0.1)
    rows[2:6, 2:6, 3] = 0
    image.pixels.foreach_set((rows * (3 if is_float else 1)).ravel())
    return image


def furnished_scene() -> None:
    """Everything that the writer has a branch for."""
    image, hdr = checkered("Checker"), checkered("Bright", is_float=True)
    mixed = material("Mixed", "ShaderNodeBsdfDiffuse", Color=(0.1, 0.7, 0.1, 1))
    tree = mixed.node_tree
    diffuse, output = tree.nodes[0], tree.nodes[1]
    clear, mix = tree.nodes.new("ShaderNodeBsdfTransparent"), tree.nodes.new("ShaderNodeMixShader")
    mix.inputs[0].default_value = 0.7
    tree.links.new(clear.outputs[0], mix.inputs[1])
    tree.links.new(diffuse.outputs[0], mix.inputs[2])
    tree.links.new(mix.outputs[0], output.inputs[0])
    glowing = textured("Glowing image", hdr)
    shader = next(n for n in glowing.node_tree.nodes if n.bl_idname == "ShaderNodeBsdfPrincipled")
    glowing.node_tree.links.new(
        next(n for n in glowing.node_tree.nodes if n.bl_idname == "ShaderNodeTexImage").outputs[0],
        shader.inputs["Emission Color"],
    )
    shader.inputs["Emission Strength"].default_value = 5
    materials = [
        textured("Image", image),
        textured("Cut out", image, "cut"),
        textured("Blended", image, "blend"),
        glowing,
        mixed,
        material("Diffuse", "ShaderNodeBsdfDiffuse", Color=(0.7, 0.1, 0.1, 1)),
        material("Emission", "ShaderNodeEmission", Color=(0.2, 0.4, 1, 1), Strength=30.0),
        material("Metal", "ShaderNodeBsdfPrincipled", Metallic=1.0),
        material("Glass", "ShaderNodeBsdfPrincipled", Transmission_Weight=1.0),
        None,
    ]
    for i, made in enumerate(materials):
        ob = quad(f"Quad {i}", 1, (2 * i, 0, 0), rotation_euler=(0.2 * i, 0.1, 0))
        if i % 2:
            uv = ob.data.uv_layers.new(name="UVMap")
            for k, corner in enumerate([(0, 0), (1, 0), (1, 1), (0, 1)]):
                uv.uv[k].vector = corner
        ob.data.materials.append(made)
    bpy.ops.mesh.primitive_monkey_add(location=(0, 4, 0), scale=(1, -2, 0.5))
    bpy.context.object.modifiers.new("Array", "ARRAY")
    sheared = place("Sheared", bpy.context.object.data, (3, 0, 0), rotation_euler=(0, 0.5, 0.7))
    sheared.parent = place("Parent", None, (0, 8, 0), scale=(1, 3, 1), rotation_euler=(0.3, 0, 0))
    text = bpy.data.curves.new("Text", "FONT")
    text.body = "Kiln"
    place("Text", text, (0, -4, 0))
    place("No faces", bpy.data.meshes.new("No faces"))
    flat = quad("Flattened", 1, (0, -8, 0))
    flat.scale = (1, 0, 1)
    for i, kind in enumerate(("POINT", "SPOT", "SUN", "AREA")):
        lamp(kind, (i, i, 5), (0.4 * i, 0.2, 0.1), energy=50).scale = (2, 2, 2)
    world((0.1, 0.2, 0.3), 1.0)


def test_a_furnished_scene_is_valid(tmp_path: Path) -> None:
    furnished_scene()
    glb, notes, path = export(tmp_path)
    assert errors(path) == []
    named = {note.place for note in notes}
    assert {"No faces", "Flattened"} <= named
    assert {"rect", "point", "spot", "sun"} == {
        light["type"] for light in glb.json["extensions"]["LIGHTKILN_scene"]["lights"]
    }


def test_identities_are_stored(tmp_path: Path) -> None:
    ob = quad("Table")
    ob.data.materials.append(material("Wood", "ShaderNodeBsdfDiffuse"))
    glb, _, _ = export(tmp_path)
    node = glb.json["nodes"][0]
    assert node["extras"]["lightkiln"]["object"] == "Table"
    assert glb.json["meshes"][node["mesh"]]["extras"]["lightkiln"]["slots"] == ["Wood"]
    assert glb.json["materials"][0]["extras"]["lightkiln"]["material"] == "Wood"


def test_shared_meshes_share_their_data(tmp_path: Path) -> None:
    one = quad("One")
    place("Two", one.data, (1, 0, 0))
    glb, _, _ = export(tmp_path)
    first, second = (mesh["primitives"][0] for mesh in glb.json["meshes"])
    assert first["indices"] == second["indices"]
    assert first["attributes"]["POSITION"] == second["attributes"]["POSITION"]
    assert first["attributes"]["TEXCOORD_1"] != second["attributes"]["TEXCOORD_1"]


def scatter(field: bpy.types.Object, pebble: bpy.types.Object) -> None:
    """Lets geometry nodes put one instance on each corner of the field, in place of its faces."""
    tree = bpy.data.node_groups.new("Scatter", "GeometryNodeTree")
    tree.interface.new_socket("Geometry", in_out="INPUT", socket_type="NodeSocketGeometry")
    tree.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
    start, end = tree.nodes.new("NodeGroupInput"), tree.nodes.new("NodeGroupOutput")
    scatter, info = tree.nodes.new("GeometryNodeInstanceOnPoints"), tree.nodes.new("GeometryNodeObjectInfo")
    info.inputs["Object"].default_value = pebble
    info.inputs["As Instance"].default_value = True
    tree.links.new(start.outputs[0], scatter.inputs["Points"])
    tree.links.new(info.outputs["Geometry"], scatter.inputs["Instance"])
    tree.links.new(scatter.outputs[0], end.inputs[0])
    field.modifiers.new("Scatter", "NODES").node_group = tree


def test_instances_of_geometry_nodes_are_written_and_named(tmp_path: Path) -> None:
    scatter(quad("Field", 2), quad("Pebble", 0.1, (5, 0, 0)))
    glb, notes, path = export(tmp_path)
    pebbles = [n for n in glb.json["nodes"] if n["name"] == "Field/Pebble"]
    assert len(pebbles) == 4
    assert len({n["mesh"] for n in pebbles}) == 1
    assert any(note.place == "Field" and "4 instances" in note.message for note in notes)
    assert errors(path) == []


def test_the_sky_is_numbers_or_a_panorama(tmp_path: Path) -> None:
    quad("Ground")
    world((0.5, 0.25, 1.0), 2.0)
    glb, _, _ = export(tmp_path)
    assert glb.json["extensions"]["LIGHTKILN_scene"]["environment"] == {"radiance": [1.0, 0.5, 2.0]}
    tree = bpy.context.scene.world.node_tree
    background = next(n for n in tree.nodes if n.bl_idname == "ShaderNodeBackground")
    split, coordinate = tree.nodes.new("ShaderNodeSeparateXYZ"), tree.nodes.new("ShaderNodeTexCoord")
    join = tree.nodes.new("ShaderNodeCombineXYZ")
    tree.links.new(coordinate.outputs["Generated"], split.inputs[0])
    for axis in "XYZ":
        tree.links.new(split.outputs[axis], join.inputs[axis])
    tree.links.new(join.outputs[0], background.inputs["Color"])
    glb, _, _ = export(tmp_path)
    assert glb.json["extensions"]["LIGHTKILN_scene"]["environment"]["image"] == "sky.exr"
    # The sky's colour is its direction: +X in the middle, +Y at the left, +Z above; strength 2.
    sky = bpy.data.images.load(str(tmp_path / "sky.exr"))
    width, height = sky.size
    flat = np.empty(width * height * 4, np.float32)
    sky.pixels.foreach_get(flat)
    rows = flat.reshape(height, width, 4)[..., :3]
    assert rows[height // 2, width // 2] == pytest.approx((2, 0, 0), abs=0.03)
    assert rows[height // 2, width // 4] == pytest.approx((0, 2, 0), abs=0.03)
    assert rows[-1, width // 2] == pytest.approx((0, 0, 2), abs=0.03)


def test_a_gradient_sky_is_numbers(tmp_path: Path) -> None:
    quad("Ground")
    made = world((0, 0, 0), 2.0)
    tree = made.node_tree
    background = next(n for n in tree.nodes if n.bl_idname == "ShaderNodeBackground")
    split, coordinate = tree.nodes.new("ShaderNodeSeparateXYZ"), tree.nodes.new("ShaderNodeTexCoord")
    mix = tree.nodes.new("ShaderNodeMix")
    mix.data_type = "RGBA"
    sockets = {s.identifier: s for s in mix.inputs}
    sockets["A_Color"].default_value, sockets["B_Color"].default_value = (0.5, 0.5, 0.5, 1), (0.1, 0.2, 0.4, 1)
    tree.links.new(coordinate.outputs["Generated"], split.inputs[0])
    tree.links.new(split.outputs["Z"], sockets["Factor_Float"])
    tree.links.new(next(o for o in mix.outputs if o.identifier == "Result_Color"), background.inputs["Color"])
    glb, _, _ = export(tmp_path)
    gradient = glb.json["extensions"]["LIGHTKILN_scene"]["environment"]["gradient"]
    assert gradient["zenith"] == pytest.approx([0.2, 0.4, 0.8])
    assert gradient["horizon"] == gradient["ground"] == pytest.approx([1, 1, 1])


def test_the_file_holds_no_nan(tmp_path: Path) -> None:
    furnished_scene()
    glb, _, path = export(tmp_path)
    json.dumps(glb.json, allow_nan=False)
    assert path.stat().st_size > 1000
