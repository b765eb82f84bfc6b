# SPDX-License-Identifier: GPL-3.0-or-later
"""The sky: a world's node tree → the environment of LIGHTKILN_scene.

A constant or a gradient between horizon and zenith is written as numbers. Any other tree is rendered by Cycles as a
lat-long panorama, in linear radiance, to an EXR beside the GLB: its centre looks along +X, its
right half turns from there to Blender's −Y (glTF's +Z), its upper edge is up.
"""

from __future__ import annotations

import math
from pathlib import Path

import bpy

from .digest import tree_digest
from .glb import Json
from .nodes import Color, Groups, Source, color, number, source

PANORAMA = "sky.exr"
# Columns of the panorama, and rays per pixel: a sun disc is smaller than a pixel.
_WIDTH, _SAMPLES = 1024, 16


def environment(world: bpy.types.World | None, folder: Path) -> Json | None:
    """What surrounds the scene; none for black. May write the panorama into `folder`."""
    sky = plain_sky(world)
    if sky is None:
        render_panorama(world, folder / PANORAMA)
        return {"image": PANORAMA, "rotation": [0.0, 0.0, 0.0, 1.0], "strength": 1.0}
    return sky or None


def plain_sky(world: bpy.types.World | None) -> Json | None:
    """A constant or gradient sky as numbers, nothing for a black one; none for one that must be rendered."""
    if world is None:
        return {}
    if not getattr(world, "use_nodes", True) or world.node_tree is None:
        return {"radiance": list(world.color)}
    background = _background(world.node_tree)
    if background is None:
        return {}
    if background.node.bl_idname == "ShaderNodeBackground":
        strength = number(background.node.inputs["Strength"], background.groups)
        plain = color(background.node.inputs["Color"], background.groups)
        if strength is not None and plain is not None and plain.is_constant():
            return {"radiance": [c * strength for c in plain.factor]}
        gradient = _gradient(source(background.node.inputs["Color"], background.groups))
        if strength is not None and gradient is not None:
            horizon, zenith = ([c * strength for c in end.factor] for end in gradient)
            return {"gradient": {"zenith": zenith, "horizon": horizon, "ground": horizon}}
    return None


def _background(tree: bpy.types.NodeTree) -> Source | None:
    """The shader that feeds the tree's output."""
    outputs = [n for n in tree.nodes if n.bl_idname == "ShaderNodeOutputWorld"]
    output = next((n for n in outputs if n.is_active_output), None)
    fed = source(output.inputs["Surface"]) if output else None
    return fed if fed and fed.node else None


def sky_strength(world: bpy.types.World) -> tuple[float, str]:
    """Strength of a sky that must be rendered, and a digest of all but that."""
    background = _background(world.node_tree)
    if background and background.node.bl_idname == "ShaderNodeBackground":
        socket = background.node.inputs["Strength"]
        strength = number(socket, background.groups)
        if strength is not None and not socket.links:
            return strength, tree_digest(world.node_tree, socket)
    return 1.0, tree_digest(world.node_tree)


def _gradient(s: Source) -> tuple[Color, Color] | None:
    """Horizon and zenith of a mix of two colours by the upward part of the direction, clamped at the horizon."""
    node = s.node
    if node is None or node.bl_idname != "ShaderNodeMix" or node.data_type != "RGBA" or node.blend_type != "MIX":
        return None
    sockets = {i.identifier: i for i in node.inputs}
    if not node.clamp_factor or not _is_upward(sockets["Factor_Float"], s.groups):
        return None
    ends = [color(sockets[name], s.groups) for name in ("A_Color", "B_Color")]
    if ends[0] is None or ends[1] is None or not (ends[0].is_constant() and ends[1].is_constant()):
        return None
    return ends[0], ends[1]


def _is_upward(socket: bpy.types.NodeSocket, groups: Groups) -> bool:
    """True if the input is the Z of the direction."""
    split = source(socket, groups)
    if split.node is None or split.node.bl_idname != "ShaderNodeSeparateXYZ" or split.socket.name != "Z":
        return False
    origin = source(split.node.inputs[0], split.groups)
    return (
        origin.node is not None and origin.node.bl_idname == "ShaderNodeTexCoord" and origin.socket.name == "Generated"
    )


def render_panorama(world: bpy.types.World, path: Path) -> None:
    """Renders the world alone. The user's scene and render settings stay as they are."""
    scene = bpy.data.scenes.new("Lightkiln sky")
    camera_data = bpy.data.cameras.new("Lightkiln sky")
    camera = bpy.data.objects.new("Lightkiln sky", camera_data)
    try:
        scene.collection.objects.link(camera)
        scene.camera, scene.world = camera, world
        # Looking along +X, upright.
        camera.rotation_euler = (math.pi / 2, 0.0, -math.pi / 2)
        camera_data.type = "PANO"
        # The panorama's settings moved from Cycles to the camera in 5.0.
        panorama = camera_data if hasattr(camera_data, "panorama_type") else camera_data.cycles
        panorama.panorama_type = "EQUIRECTANGULAR"
        _settings(scene)
        scene.render.filepath = str(path)
        bpy.ops.render.render(write_still=True, scene=scene.name)
    finally:
        bpy.data.objects.remove(camera)
        bpy.data.cameras.remove(camera_data)
        bpy.data.scenes.remove(scene)


def _settings(scene: bpy.types.Scene) -> None:
    render, cycles = scene.render, scene.cycles
    render.engine = "CYCLES"
    render.resolution_x, render.resolution_y, render.resolution_percentage = _WIDTH, _WIDTH // 2, 100
    render.film_transparent = False
    # A box filter: each pixel is the mean over its own square.
    cycles.pixel_filter_type, cycles.samples = "BOX", _SAMPLES
    cycles.device, cycles.use_denoising, cycles.use_adaptive_sampling = "CPU", False, False
    image = render.image_settings
    if hasattr(image, "media_type"):
        image.media_type = "IMAGE"
    image.file_format, image.color_depth, image.color_mode = "OPEN_EXR", "32", "RGB"
    image.color_management = "OVERRIDE"
    image.linear_colorspace_settings.name = "Linear Rec.709"
