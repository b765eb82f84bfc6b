"""A furnished room: the lightmap agrees with Cycles' bake on the same texels."""

from __future__ import annotations

import math

import bpy
import numpy as np

from tests.blender.scenes_in_blender import bake, lamp, material, pixels, quad

# Cycles' own noise is about a third of this with that many samples.
MEDIAN, MEAN = 0.02, 0.01
SAMPLES = 1024


def box(name: str, at: tuple[float, float, float], size: tuple[float, float, float], color: tuple[float, ...]) -> None:
    """A coloured box that stands at a point."""
    bpy.ops.mesh.primitive_cube_add(size=1, location=(at[0], at[1], at[2] + size[2] / 2), scale=size)
    made = bpy.context.object
    made.name = name
    made.data.materials.append(material(name, "ShaderNodeBsdfDiffuse", Color=(*color, 1)))


def furnish() -> None:
    """A room of 4 × 3 × 2.5 m with a table, a cupboard, a shelf and a lamp under the ceiling."""
    walls = [
        ("Floor", (0, 0, 0), (0, 0, 0), (4, 3), (0.5, 0.4, 0.3)),
        ("Ceiling", (0, 0, 2.5), (math.pi, 0, 0), (4, 3), (0.8, 0.8, 0.8)),
        ("Left", (-2, 0, 1.25), (0, math.pi / 2, 0), (2.5, 3), (0.7, 0.3, 0.3)),
        ("Right", (2, 0, 1.25), (0, -math.pi / 2, 0), (2.5, 3), (0.3, 0.6, 0.3)),
        ("Back", (0, 1.5, 1.25), (math.pi / 2, 0, 0), (4, 2.5), (0.7, 0.7, 0.7)),
        ("Front", (0, -1.5, 1.25), (-math.pi / 2, 0, 0), (4, 2.5), (0.7, 0.7, 0.7)),
    ]
    for name, at, turn, size, color in walls:
        wall = quad(name, 1, at, rotation_euler=turn, scale=(*size, 1))
        wall.data.materials.append(material(name, "ShaderNodeBsdfDiffuse", Color=(*color, 1)))
    box("Table", (0.3, 0.2, 0.7), (1.4, 0.8, 0.05), (0.6, 0.5, 0.3))
    for i, (x, y) in enumerate([(-0.3, -0.1), (0.9, -0.1), (-0.3, 0.5), (0.9, 0.5)]):
        box(f"Leg {i}", (x, y, 0.001), (0.08, 0.08, 0.69), (0.6, 0.5, 0.3))
    box("Cupboard", (-1.5, 1.1, 0.001), (0.8, 0.6, 1.8), (0.4, 0.4, 0.6))
    box("Shelf", (1.8, -0.5, 1.4), (0.3, 1.2, 0.04), (0.7, 0.7, 0.7))
    lamp("AREA", (0.2, 0.1, 2.4), energy=60, shape="DISK", size=0.8)


def bake_with_cycles(side: int) -> np.ndarray:
    """Irradiance / π by Cycles on a page with the same layout, and black where there is none."""
    scene = bpy.context.scene
    image = bpy.data.images.new("Cycles", side, side, float_buffer=True)
    objects = [ob for ob in scene.objects if ob.type == "MESH"]
    for ob in objects:
        sx, sy, ox, oy = ob["lightkiln_place"]
        final = ob.data.uv_layers.new(name="Final")
        uv = np.empty(2 * len(ob.data.loops), np.float32)
        ob.data.uv_layers["Lightmap"].uv.foreach_get("vector", uv)
        final.uv.foreach_set(
            "vector", np.ascontiguousarray(uv.reshape(-1, 2) * (sx, sy) + (ox, oy), np.float32).ravel()
        )
        final.active = True
        tree = ob.data.materials[0].node_tree
        node = tree.nodes.new("ShaderNodeTexImage")
        node.image = image
        tree.nodes.active = node
        ob.select_set(True)
    bpy.ops.lightkiln.view(view="ORIGINAL")
    scene.render.engine = "CYCLES"
    scene.cycles.device, scene.cycles.samples, scene.cycles.use_denoising = "CPU", SAMPLES, False
    scene.cycles.use_adaptive_sampling, scene.cycles.light_sampling_threshold = False, 0
    scene.cycles.max_bounces = scene.cycles.diffuse_bounces = 32
    scene.render.bake.margin = 0
    bpy.context.view_layer.objects.active = objects[0]
    bpy.ops.object.bake(type="DIFFUSE", pass_filter={"DIRECT", "INDIRECT"}, margin=0)
    return pixels(image)


def test_a_furnished_room_agrees_with_cycles() -> None:
    furnish()
    bake(density=8, error=1)
    image = bpy.context.scene.lightkiln.image
    ours = pixels(image).astype(np.float64)
    truth = bake_with_cycles(image.size[0]).astype(np.float64)
    lit = (truth.min(axis=2) > 0.02 * truth.mean()) & (ours.min(axis=2) > 0)
    # Texels at the edge of a chart hold the mean of what the chart covers here, and the light of its middle there.
    inner = lit & np.roll(lit, 1, 0) & np.roll(lit, -1, 0) & np.roll(lit, 1, 1) & np.roll(lit, -1, 1)
    assert inner.sum() > 2000
    ratio = ours[inner].sum() / truth[inner].sum()
    off = np.abs(ours[inner] - truth[inner]).mean(axis=1) / truth[inner].mean(axis=1)
    print(f"{inner.sum()} texels, mean ratio {ratio:.4f}, median error {np.median(off):.4f}")
    assert abs(ratio - 1) < MEAN
    assert np.median(off) < MEDIAN
