"""Builds small scenes in Blender, bakes them with the add-on and reads the lightmap back through its own mapping."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import bpy
import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Vector = Sequence[float]


def quad(name: str, size: float = 0.02, at: Vector = (0, 0, 0), **settings: Any) -> bpy.types.Object:
    """A square in the XY plane that looks up, without UV maps and materials."""
    s = size / 2
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata([(-s, -s, 0), (s, -s, 0), (s, s, 0), (-s, s, 0)], [], [(0, 1, 2, 3)])
    return place(name, mesh, at, **settings)


def place(name: str, data: Any, at: Vector = (0, 0, 0), **settings: Any) -> bpy.types.Object:
    """An object in the scene."""
    ob = bpy.data.objects.new(name, data)
    ob.location = at
    for key, value in settings.items():
        setattr(ob, key, value)
    bpy.context.scene.collection.objects.link(ob)
    bpy.context.view_layer.update()
    return ob


def lamp(kind: str, at: Vector = (0, 0, 2), rotation: Vector = (0, 0, 0), **settings: Any) -> bpy.types.Object:
    """A lamp. Settings that this Blender lacks are an error."""
    light = bpy.data.lights.new("Lamp", kind)
    if hasattr(light, "use_soft_falloff"):
        light.use_soft_falloff = False
    for key, value in settings.items():
        setattr(light, key, value)
    return place("Lamp", light, at, rotation_euler=rotation)


def material(name: str, kind: str, **inputs: Any) -> bpy.types.Material:
    """A material of one shader node."""
    made = bpy.data.materials.new(name)
    made.use_nodes = True
    tree = made.node_tree
    tree.nodes.clear()
    shader = tree.nodes.new(kind)
    for key, value in inputs.items():
        shader.inputs[key.replace("_", " ")].default_value = value
    output = tree.nodes.new("ShaderNodeOutputMaterial")
    tree.links.new(shader.outputs[0], output.inputs["Surface"])
    return made


def world(color: Vector, strength: float) -> bpy.types.World:
    """A world of one colour, in use."""
    made = bpy.data.worlds.new("World")
    made.use_nodes = True
    tree = made.node_tree
    tree.nodes.clear()
    background = tree.nodes.new("ShaderNodeBackground")
    background.inputs["Color"].default_value = (*color, 1)
    background.inputs["Strength"].default_value = strength
    output = tree.nodes.new("ShaderNodeOutputWorld")
    tree.links.new(background.outputs[0], output.inputs["Surface"])
    bpy.context.scene.world = made
    return made


def bake(density: float = 200.0, error: float = 0.5) -> None:
    """Bakes the scene with the operator."""
    settings = bpy.context.scene.lightkiln
    settings.density, settings.error = density, error
    assert bpy.ops.lightkiln.bake() == {"FINISHED"}


def pixels(image: bpy.types.Image) -> npt.NDArray[np.float32]:
    """RGB rows, the lowest first."""
    width, height = image.size
    flat = np.empty(width * height * 4, np.float32)
    image.pixels.foreach_get(flat)
    return flat.reshape(height, width, 4)[..., :3]


def bilinear(page: npt.NDArray[np.float32], u: float, v: float) -> Array:
    """The page at a coordinate, as a renderer filters it."""
    height, width = page.shape[:2]
    x = min(max(u * width - 0.5, 0.0), width - 1.001)
    y = min(max(v * height - 0.5, 0.0), height - 1.001)
    i, k = int(x), int(y)
    s, t = x - i, y - k
    block = page[k : k + 2, i : i + 2].astype(np.float64)
    return np.asarray(
        (block[0, 0] * (1 - s) + block[0, 1] * s) * (1 - t) + (block[1, 0] * (1 - s) + block[1, 1] * s) * t
    )


def irradiance(
    ob: bpy.types.Object, face: int = 0, carrier: bpy.types.Object | None = None, attribute: str = "lightkiln_place"
) -> Array:
    """Irradiance (W/m²) in the middle of a face, through UV map and place as the materials go."""
    mesh = ob.data
    layer = mesh.uv_layers[ob.lightkiln.uv_map or "Lightmap"]
    corners = [layer.uv[i].vector for i in mesh.polygons[face].loop_indices]
    u, v = (sum(c[k] for c in corners) / len(corners) for k in (0, 1))
    sx, sy, ox, oy = (carrier or ob)[attribute]
    page = pixels(bpy.context.scene.lightkiln.image)
    return np.pi * bilinear(page, u * sx + ox, v * sy + oy)
