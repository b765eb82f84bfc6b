# SPDX-License-Identifier: GPL-3.0-or-later
"""Blender's lamps in radiometric units: a light and its world matrix → a lamp of LIGHTKILN_scene and its node.

Blender's power e (W, or W/m² for suns) is energy · 2^exposure · colour · temperature colour. With A the emitting area:
a point or spot has the intensity e/4π W/sr, an area lamp the radiance e/πA, a sun the irradiance e. Where `normalize`
is off, the strength does not depend on the size: e is the strength for a sphere of area 4πr² = 1, for A = 1, and for a
sun disc of π sin²(angle/2) = 1.
"""

from __future__ import annotations

import math

import bpy
from mathutils import Matrix, Vector

from ..errors import Note
from .axes import node_rotation, to_gltf
from .glb import Json


def read_lamp(name: str, light: bpy.types.Light, matrix: Matrix) -> tuple[Json, Json, list[Note]]:
    """The lamp, the node that places it, and what could not be said exactly."""
    notes: list[Note] = []
    power = _power(name, light, notes)
    lamp: Json = {"name": light.name}
    if light.type == "SUN":
        _sun(lamp, light, power)
    elif light.type == "AREA":
        _area(lamp, light, power, matrix)
    else:
        _point_or_spot(lamp, light, power)
    if not light.use_shadow:
        lamp["castsShadows"] = False
    location, rotation, _ = matrix.decompose()
    node = {"name": name, "translation": to_gltf(location), "rotation": node_rotation(rotation)}
    return lamp, node, notes


def _power(name: str, light: bpy.types.Light, notes: list[Note]) -> Vector:
    """Power per channel, W or W/m²."""
    strength = light.energy * 2.0 ** getattr(light, "exposure", 0.0)
    power = Vector(light.color) * strength
    if getattr(light, "use_temperature", False):
        power = _times(power, light.temperature_color)
    # From 5.0 on `use_nodes` may be gone; a lamp without nodes then has no tree.
    if getattr(light, "use_nodes", True) and light.node_tree is not None:
        factor = _emission_factor(light.node_tree)
        if factor is None:
            notes.append(Note(name, "its light nodes are ignored: use its power and colour instead", "APPROXIMATED"))
        else:
            power = _times(power, factor)
    return power


def _emission_factor(tree: bpy.types.NodeTree) -> Vector | None:
    """Colour × strength of a tree that is one emission node; none for any other tree."""
    output = next((n for n in tree.nodes if n.bl_idname == "ShaderNodeOutputLight" and n.is_active_output), None)
    if output is None or not output.inputs[0].links:
        return Vector((0.0, 0.0, 0.0))
    node = output.inputs[0].links[0].from_node
    if node.bl_idname != "ShaderNodeEmission" or any(socket.links for socket in node.inputs):
        return None
    return Vector(node.inputs["Color"].default_value[:3]) * node.inputs["Strength"].default_value


def _times(a: Vector, b: Vector) -> Vector:
    return Vector([x * y for x, y in zip(a, b, strict=True)])


def _sun(lamp: Json, light: bpy.types.Light, power: Vector) -> None:
    if not getattr(light, "normalize", True):
        power = power * math.pi * math.sin(light.angle / 2) ** 2
    lamp |= {"type": "sun", "irradiance": list(power), "angle": light.angle}


def _area(lamp: Json, light: bpy.types.Light, power: Vector, matrix: Matrix) -> None:
    scale = matrix.to_scale()
    height = light.size if light.shape in {"SQUARE", "DISK"} else light.size_y
    size = [abs(light.size * scale.x), abs(height * scale.y)]
    is_round = light.shape in {"DISK", "ELLIPSE"}
    area = size[0] * size[1] * (math.pi / 4 if is_round else 1.0)
    if getattr(light, "normalize", True):
        radiance = power / (math.pi * area) if area > 0 else Vector((0.0, 0.0, 0.0))
    else:
        radiance = power / math.pi
    lamp |= {"type": "disk" if is_round else "rect", "radiance": list(radiance), "size": size}
    # The radiance is that of the whole half space: the baker narrows the beam and keeps the power, as Blender does.
    lamp["spread"] = light.spread


def _point_or_spot(lamp: Json, light: bpy.types.Light, power: Vector) -> None:
    radius = light.shadow_soft_size
    intensity = power / (4 * math.pi)
    if not getattr(light, "normalize", True):
        intensity = intensity * 4 * math.pi * radius**2
    lamp |= {"type": light.type.lower(), "intensity": list(intensity), "radius": radius}
    if light.type == "SPOT":
        lamp |= {"outerConeAngle": light.spot_size / 2, "blend": light.spot_blend}
    if radius > 0 and getattr(light, "use_soft_falloff", False):
        lamp["softFalloff"] = True
