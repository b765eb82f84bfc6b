# SPDX-License-Identifier: GPL-3.0-or-later
"""Blender's lamps in radiometric units: a light and its world matrix → a lamp of LIGHTKILN_scene and its node.

Blender's power e (W, or W/m² for suns) is energy · 2^exposure · colour · temperature colour. With A the emitting area:
a point or spot has the intensity e/4π W/sr, an area lamp the radiance e/πA, a sun the irradiance e. Where `normalize`
is off, the strength does not depend on the size: e is the strength for a sphere of area 4πr² = 1, for A = 1, and for a
sun disc of π sin²(angle/2) = 1.
"""

from __future__ import annotations

import math
from pathlib import Path

import bpy
from mathutils import Matrix, Vector

from ..errors import Note
from .axes import node_rotation, to_gltf
from .glb import Json
from .nodes import Source, color, number, source

# What the baker divides candela by, and what Blender's IES texture divides them by.
LUMENS_PER_WATT, BLENDERS_EFFICACY = 683.0, 177.83


def read_lamp(name: str, light: bpy.types.Light, matrix: Matrix) -> tuple[Json, Json, list[Note]]:
    """The lamp, the node that places it, and what could not be said exactly."""
    notes: list[Note] = []
    lamp: Json = {"name": light.name}
    power = _power(name, light, notes)
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


def lamp_group(light: bpy.types.Light) -> str:
    """The light group of a lamp that is in none of the user's: lamps that share their data share their light."""
    return light.name.strip() or "Lamp"


def _power(name: str, light: bpy.types.Light, notes: list[Note]) -> Vector:
    """Power per channel, W or W/m²."""
    strength = light.energy * 2.0 ** getattr(light, "exposure", 0.0)
    power = Vector(light.color) * strength
    if getattr(light, "use_temperature", False):
        power = _times(power, light.temperature_color)
    # From 5.0 on `use_nodes` may be gone; a lamp without nodes then has no tree.
    if _has_nodes(light):
        factor = _emission_factor(light.node_tree)
        if factor is None:
            notes.append(Note(name, "its light nodes are ignored: use its power and colour instead", "APPROXIMATED"))
        else:
            power = _times(power, factor)
            emission = _emission(light.node_tree)
            fed = source(emission.node.inputs["Strength"], emission.groups) if emission else None
            if fed and _is_profile(fed) and profile_text(light) is None:
                missing = "its IES file is missing: find it, or remove the node"
                notes.append(
                    Note(name, missing if light.type in {"POINT", "SPOT"} else "only points and spots have IES")
                )
    return power


def _has_nodes(light: bpy.types.Light) -> bool:
    return getattr(light, "use_nodes", True) and light.node_tree is not None


def _emission(tree: bpy.types.NodeTree) -> Source | None:
    """What feeds the tree's output; none for a tree without output, which is dark."""
    output = next((n for n in tree.nodes if n.bl_idname == "ShaderNodeOutputLight" and n.is_active_output), None)
    fed = source(output.inputs[0]) if output else None
    return fed if fed and fed.node else None


def _emission_factor(tree: bpy.types.NodeTree) -> Vector | None:
    """Colour × strength of a tree that is one emission node, perhaps with a profile; none for any other tree."""
    emission = _emission(tree)
    if emission is None:
        return Vector((0.0, 0.0, 0.0))
    if emission.node.bl_idname != "ShaderNodeEmission":
        return None
    tint = color(emission.node.inputs["Color"], emission.groups)
    fed = source(emission.node.inputs["Strength"], emission.groups)
    inner = fed.node.inputs["Strength"] if _is_profile(fed) else emission.node.inputs["Strength"]
    strength = number(inner, fed.groups if _is_profile(fed) else emission.groups)
    if tint is None or not tint.is_constant() or strength is None:
        return None
    return Vector(tint.factor) * strength


def _is_profile(s: Source) -> bool:
    return s.node is not None and s.node.bl_idname == "ShaderNodeTexIES" and not s.node.inputs["Vector"].links


def profile_text(light: bpy.types.Light) -> str | None:
    """The IES profile that shapes a point or spot; none if it has none that can be read."""
    emission = _emission(light.node_tree) if _has_nodes(light) and light.type in {"POINT", "SPOT"} else None
    if emission is None or emission.node.bl_idname != "ShaderNodeEmission":
        return None
    fed = source(emission.node.inputs["Strength"], emission.groups)
    if not _is_profile(fed):
        return None
    if fed.node.mode == "INTERNAL":
        text = fed.node.ies
        return text.as_string() if text else None
    path = Path(bpy.path.abspath(fed.node.filepath, library=light.library))
    return path.read_text("latin-1") if path.is_file() else None


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
    if profile_text(light) is not None:
        # The profile says how many candela there are, per watt of the lamp and by the efficacy that Blender assumes.
        intensity = intensity * 4 * math.pi * LUMENS_PER_WATT / BLENDERS_EFFICACY
    lamp |= {"type": light.type.lower(), "intensity": list(intensity), "radius": radius}
    if light.type == "SPOT":
        lamp |= {"outerConeAngle": light.spot_size / 2, "blend": light.spot_blend}
    if radius > 0 and getattr(light, "use_soft_falloff", False):
        lamp["softFalloff"] = True
