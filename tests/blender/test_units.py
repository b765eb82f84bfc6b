"""Every lamp and sky has Blender's strength: bakes agree with closed forms, and with Cycles' own baking."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import bpy
import numpy as np
import pytest

from tests.blender.scenes_in_blender import bake, irradiance, lamp, material, pixels, quad, world

# Power, and the lamp's height over the receiver.
P, H = 100.0, 2.0
POINT = P / (4 * math.pi * H * H)
PI = math.pi


def rectangle(radiance: float, width: float, height: float) -> float:
    """Irradiance under the middle of a rectangle at height H."""
    a, b = width / 2 / H, height / 2 / H
    p, q = math.hypot(1, a), math.hypot(1, b)
    return 2 * radiance * (a / p * math.atan(b / p) + b / q * math.atan(a / q))


def ellipse(radiance: float, a: float, b: float) -> float:
    """Irradiance under the middle of an ellipse with these half axes, by quadrature."""
    n = 800
    r = np.sqrt((np.arange(n) + 0.5) / n)[:, None]
    t = (np.arange(n) + 0.5) / n * 2 * PI
    squared = (a * r * np.cos(t)) ** 2 + (b * r * np.sin(t)) ** 2 + H * H
    return float(radiance * (H * H / squared**2).mean() * PI * a * b)


def spot(degrees: float, size: float, blend: float) -> float:
    """Irradiance of a spot on a receiver that is off its axis by an angle."""
    cosine, edge = math.cos(math.radians(degrees)), math.cos(size / 2)
    x = min(max((cosine - edge) / ((1 - edge) * blend), 0.0), 1.0)
    return POINT * cosine**3 * x * x * (3 - 2 * x)


RIGHT = math.radians(60)
LAMPS: dict[str, tuple[float | tuple[float, ...], Callable[[], Any]]] = {
    "point": (POINT, lambda: lamp("POINT", energy=P, shadow_soft_size=0)),
    "sphere": (POINT, lambda: lamp("POINT", energy=P, shadow_soft_size=0.5)),
    "colour": (
        (POINT, POINT / 2, POINT / 4),
        lambda: lamp("POINT", energy=P, shadow_soft_size=0, color=(1, 0.5, 0.25)),
    ),
    "spot": (POINT, lambda: lamp("SPOT", energy=P, shadow_soft_size=0, spot_size=RIGHT, spot_blend=0.5)),
    "spot off its axis": (
        spot(20, RIGHT, 0.5),
        lambda: lamp(
            "SPOT",
            (-H * math.tan(math.radians(20)), 0, H),
            energy=P,
            shadow_soft_size=0,
            spot_size=RIGHT,
            spot_blend=0.5,
        ),
    ),
    "sun": (3.0, lambda: lamp("SUN", energy=3, angle=0)),
    "wide sun": (3.0, lambda: lamp("SUN", energy=3, angle=math.radians(10))),
    "slanting sun": (1.5, lambda: lamp("SUN", energy=3, angle=0, rotation=(math.radians(60), 0, 0))),
    "square": (rectangle(P / PI, 1, 1), lambda: lamp("AREA", energy=P, shape="SQUARE", size=1)),
    "rectangle": (rectangle(P / PI, 2, 0.5), lambda: lamp("AREA", energy=P, shape="RECTANGLE", size=2, size_y=0.5)),
    "disk": (P / PI / (0.25 + H * H), lambda: lamp("AREA", energy=P, shape="DISK", size=1)),
    "ellipse": (
        ellipse(P / (PI * PI * 0.25), 1, 0.25),
        lambda: lamp("AREA", energy=P, shape="ELLIPSE", size=2, size_y=0.5),
    ),
    "world": (PI, lambda: world((0.5, 0.5, 0.5), 2)),
}


def scaled_area() -> None:
    """An area lamp that its object's scale makes 2 × 0.5 m; its power stays."""
    lamp("AREA", energy=P, shape="SQUARE", size=1).scale = (2, 0.5, 1)


def emitter() -> None:
    """A square metre of emission that looks down."""
    ob = quad("Emitter", 1, (0, 0, H), rotation_euler=(PI, 0, 0))
    ob.data.materials.append(material("Glow", "ShaderNodeEmission", Strength=10.0))
    ob.lightkiln.exclude = True


LAMPS["soft falloff"] = (
    P / (4 * PI * (H * H + 0.25)),
    lambda: lamp("POINT", energy=P, shadow_soft_size=0.5, use_soft_falloff=True),
)
LAMPS["scaled area"] = (rectangle(P / PI, 2, 0.5), scaled_area)
LAMPS["emission"] = (rectangle(10, 1, 1), emitter)

# What lamps can do from Blender 4.5 or 5.0 on.
NEW_LAMPS: dict[str, tuple[str, float, dict[str, Any]]] = {
    "exposure": ("POINT", 2 * POINT, {"exposure": 1}),
    "point, not normalized": ("POINT", POINT * PI, {"normalize": False}),
    "spot, not normalized": ("SPOT", POINT * PI, {"normalize": False, "spot_size": RIGHT, "spot_blend": 0.1}),
    "area, not normalized": ("AREA", rectangle(P / PI, 0.5, 0.5), {"normalize": False, "size": 0.5}),
    "sun, not normalized": (
        "SUN",
        P * PI * math.sin(math.radians(5)) ** 2,
        {"normalize": False, "angle": math.radians(10)},
    ),
}


@pytest.mark.parametrize("name", LAMPS)
def test_strength_is_the_closed_form(name: str) -> None:
    expected, build = LAMPS[name]
    receiver = quad("Receiver")
    build()
    bake()
    assert irradiance(receiver) == pytest.approx(np.broadcast_to(expected, 3), rel=0.005)


@pytest.mark.parametrize("name", NEW_LAMPS)
def test_newer_settings_have_their_strength(name: str) -> None:
    kind, expected, settings = NEW_LAMPS[name]
    if not hasattr(bpy.types.PointLight, "exposure") and "exposure" not in bpy.types.PointLight.bl_rna.properties:
        pytest.skip("this Blender's lamps have neither exposure nor normalization")
    receiver = quad("Receiver")
    soft: dict[str, Any] = {} if kind in {"AREA", "SUN"} else {"shadow_soft_size": 0.5}
    lamp(kind, energy=P, **soft, **settings)
    bake()
    assert irradiance(receiver) == pytest.approx(np.broadcast_to(expected, 3), rel=0.005)


def test_temperature_colours_the_light() -> None:
    if "temperature" not in bpy.types.PointLight.bl_rna.properties:
        pytest.skip("this Blender's lamps have no temperature")
    receiver = quad("Receiver")
    ob = lamp("POINT", energy=P, shadow_soft_size=0, use_temperature=True, temperature=3000)
    bake()
    assert irradiance(receiver) == pytest.approx(POINT * np.array(ob.data.temperature_color), rel=0.005)


def test_a_beam_keeps_its_power() -> None:
    receiver = quad("Receiver")
    half = math.radians(45)
    lamp("AREA", energy=P, shape="SQUARE", size=0.02, spread=2 * half)
    bake()
    on_axis = P / (PI * H * H) * math.tan(half) / (math.tan(half) - half)
    assert irradiance(receiver) == pytest.approx(np.full(3, on_axis), rel=0.005)


def test_a_sky_of_nodes_shines_from_where_it_should() -> None:
    """A sky whose colour is its direction: red from +X, green from +Y, blue from above."""
    tree = world((0, 0, 0), 1).node_tree
    background = next(n for n in tree.nodes if n.bl_idname == "ShaderNodeBackground")
    split, coordinate = tree.nodes.new("ShaderNodeSeparateXYZ"), tree.nodes.new("ShaderNodeTexCoord")
    join = tree.nodes.new("ShaderNodeCombineXYZ")
    tree.links.new(coordinate.outputs["Generated"], split.inputs[0])
    for axis in "XYZ":
        clamp = tree.nodes.new("ShaderNodeMath")
        clamp.operation = "MAXIMUM"
        clamp.inputs[1].default_value = 0
        tree.links.new(split.outputs[axis], clamp.inputs[0])
        tree.links.new(clamp.outputs[0], join.inputs[axis])
    tree.links.new(join.outputs[0], background.inputs["Color"])
    up = quad("Up")
    to_x = quad("To X", at=(3, 0, 0), rotation_euler=(0, PI / 2, 0))
    to_y = quad("To Y", at=(0, 3, 0), rotation_euler=(-PI / 2, 0, 0))
    sun = lamp("SUN", energy=1, angle=0)
    sun.data.color = (0, 0, 1)
    bake()
    if any("not lit" in note.message for note in bpy.context.scene.lightkiln.notes):
        pytest.skip("this baker does not light sky images")
    along, across = 2 * PI / 3, 2 / 3
    assert irradiance(to_x) == pytest.approx((along, across, across), rel=0.01)
    assert irradiance(to_y) == pytest.approx((across, along, across), rel=0.01)
    assert irradiance(up) == pytest.approx((across, across, along + 1), rel=0.01)


def cycles_irradiance(ob: bpy.types.Object) -> Any:
    """Mean irradiance on an object by Cycles' bake."""
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.cycles.device, scene.cycles.samples, scene.cycles.use_denoising = "CPU", 2048, False
    scene.cycles.light_sampling_threshold = 0
    scene.render.bake.margin = 0
    image = bpy.data.images.new("Cycles", 4, 4, float_buffer=True)
    white = material("White", "ShaderNodeBsdfDiffuse", Color=(0.5, 0.5, 0.5, 1))
    node = white.node_tree.nodes.new("ShaderNodeTexImage")
    node.image = image
    white.node_tree.nodes.active = node
    ob.data.materials.clear()
    ob.data.materials.append(white)
    layer = ob.data.uv_layers.new(name="Cycles")
    for i, corner in enumerate([(0, 0), (1, 0), (1, 1), (0, 1)]):
        layer.uv[i].vector = corner
    layer.active = layer.active_render = True
    bpy.context.view_layer.objects.active = ob
    ob.select_set(True)
    bpy.ops.object.bake(type="DIFFUSE", pass_filter={"DIRECT", "INDIRECT"})
    return math.pi * pixels(image).mean(axis=(0, 1))


COMPARED = {name: LAMPS[name][1] for name in ("sphere", "spot off its axis", "ellipse", "world", "emission")}
COMPARED["soft falloff"] = lambda: lamp("POINT", energy=P, shadow_soft_size=0.5, use_soft_falloff=True)


PROFILE = """IESNA:LM-63-1995
TILT=NONE
1 -1 1 4 5 1 2 0 0 0
1 1 1
0 30 60 90
0 90 180 270 360
100 200 50 10
100 150 40 5
100 80 20 0
100 120 90 0
100 200 50 10
"""


def profiled() -> None:
    """A tilted point lamp with a profile that no rotation leaves as it is."""
    ob = lamp("POINT", (0.5, 0.3, H), (0.3, 0.2, 0.9), energy=20, shadow_soft_size=0)
    light = ob.data
    light.use_nodes = True
    tree = light.node_tree
    emission = next(n for n in tree.nodes if n.bl_idname == "ShaderNodeEmission")
    node = tree.nodes.new("ShaderNodeTexIES")
    text = bpy.data.texts.new("Profile")
    text.write(PROFILE)
    node.mode, node.ies = "INTERNAL", text
    node.inputs["Strength"].default_value = 1.5
    tree.links.new(node.outputs[0], emission.inputs["Strength"])


COMPARED["profile"] = profiled
COMPARED["beam"] = lambda: lamp("AREA", energy=P, shape="DISK", size=1, spread=math.radians(120))


@pytest.mark.parametrize("name", COMPARED)
def test_strength_is_that_of_cycles(name: str) -> None:
    receiver = quad("Receiver")
    if name == "profile" and bpy.app.version < (5, 0, 0):
        pytest.skip("Cycles interpolates profiles in another way before 5.0")
    COMPARED[name]()
    bake()
    ours = irradiance(receiver)
    bpy.ops.lightkiln.remove()
    assert ours == pytest.approx(cycles_irradiance(receiver), rel=0.01)
