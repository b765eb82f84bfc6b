# SPDX-License-Identifier: GPL-3.0-or-later
"""What a material does to light: its shader tree → reflectance, emission and opacity, as far as glTF can say them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import bpy

from .nodes import WHITE, Color, Groups, Source, Texture, color, image_texture, mixed, number, source

BLACK = Color((0.0, 0.0, 0.0))


@dataclass(frozen=True)
class Opacity:
    """How much of the surface is there: a number, or an image's channel, which may be cut at a threshold."""

    value: float = 1.0
    texture: Texture | None = None
    # True: the image's alpha channel; false: its colour.
    from_alpha: bool = True
    cutoff: float | None = None


OPAQUE, ABSENT = Opacity(), Opacity(0.0)


@dataclass(frozen=True)
class Surface:
    """A material as the baker understands it."""

    base: Color = BLACK
    emission: Color = BLACK
    opacity: Opacity = OPAQUE
    # Share of the light that passes through as through clear glass.
    transmission: float = 0.0
    # What could not be read, and what stands for it.
    faults: tuple[str, ...] = ()
    # Names of the channels that are not what the material shows: "base", "emission".
    unread: frozenset[str] = field(default=frozenset())


def read_surface(material: bpy.types.Material | None) -> Surface:
    """The surface of a material; Blender's own grey where a slot is empty."""
    if material is None:
        return Surface(base=Color((0.8, 0.8, 0.8)))
    # From 5.0 on every material has nodes.
    if not getattr(material, "use_nodes", True) or material.node_tree is None:
        return Surface(base=Color(tuple(material.diffuse_color[:3])))
    output = material_output(material.node_tree)
    if output is None:
        return Surface()
    return _shader(output.inputs["Surface"], ())


def material_output(tree: bpy.types.NodeTree) -> bpy.types.Node | None:
    """The output node that Cycles uses."""
    outputs = [n for n in tree.nodes if n.bl_idname == "ShaderNodeOutputMaterial" and n.target in {"ALL", "CYCLES"}]
    return next((n for n in outputs if n.is_active_output), outputs[0] if outputs else None)


def _shader(socket: bpy.types.NodeSocket, groups: Groups) -> Surface:
    s = source(socket, groups)
    if s.node is None:
        # No shader: a black surface that blocks light.
        return Surface()
    reader = _READERS.get(s.node.bl_idname)
    if reader is None:
        return Surface(base=Color((0.8, 0.8, 0.8)), faults=(f"{s.node.bl_label} is taken as grey",))
    return reader(s)


def _color_of(s: Source, name: str, channel: str, faults: list[str], unread: set[str]) -> Color:
    """The colour of an input, or what stands for one that cannot be read."""
    read = color(s.node.inputs[name], s.groups)
    if read is not None:
        return read
    feeding = source(s.node.inputs[name], s.groups).node
    label = feeding.bl_label if feeding else name
    faults.append(f"{name} comes from {label}, which is taken as its mean colour")
    unread.add(channel)
    return Color((0.5, 0.5, 0.5)) if channel == "base" else Color()


def _number_of(s: Source, name: str, otherwise: float, faults: list[str]) -> float:
    if name not in s.node.inputs:
        return otherwise
    value = number(s.node.inputs[name], s.groups)
    if value is None:
        faults.append(f"{name} varies over the surface and is taken as {otherwise:g}")
        return otherwise
    return value


def _diffuse(s: Source) -> Surface:
    faults: list[str] = []
    unread: set[str] = set()
    base = _color_of(s, "Color", "base", faults, unread)
    return Surface(base=base, faults=tuple(faults), unread=frozenset(unread))


def _principled(s: Source) -> Surface:
    faults: list[str] = []
    unread: set[str] = set()
    base = _color_of(s, "Base Color", "base", faults, unread)
    diffuse = 1.0 - min(max(_number_of(s, "Metallic", 0.0, faults), 0.0), 1.0)
    transmission = min(max(_number_of(s, "Transmission Weight", 0.0, faults), 0.0), 1.0)
    strength = _number_of(s, "Emission Strength", 1.0, faults)
    emission = BLACK
    if strength > 0:
        emission = _color_of(s, "Emission Color", "emission", faults, unread).scaled((strength,) * 3)
    return Surface(
        base=base.scaled((diffuse,) * 3),
        emission=emission,
        opacity=_opacity(s.node.inputs["Alpha"], s.groups, faults),
        transmission=transmission * diffuse,
        faults=tuple(faults),
        unread=frozenset(unread),
    )


def _emission(s: Source) -> Surface:
    faults: list[str] = []
    unread: set[str] = set()
    strength = _number_of(s, "Strength", 1.0, faults)
    emission = _color_of(s, "Color", "emission", faults, unread) if strength > 0 else BLACK
    return Surface(emission=emission.scaled((strength,) * 3), faults=tuple(faults), unread=frozenset(unread))


def _transparent(s: Source) -> Surface:
    tint = color(s.node.inputs["Color"], s.groups)
    if tint is not None and tint.is_constant():
        # Clear light passes; the tint is the mean of what passes per channel.
        return Surface(opacity=Opacity(1.0 - sum(tint.factor) / 3))
    return Surface(opacity=ABSENT, faults=("Transparent BSDF has a textured colour and is taken as clear",))


def _glossy(s: Source) -> Surface:
    return Surface(faults=(f"{s.node.bl_label} does not reflect into the lightmap",))


def _glass(s: Source) -> Surface:
    tint = color(s.node.inputs["Color"], s.groups) or Color()
    faults = (f"{s.node.bl_label} lets light through straight",)
    return Surface(base=tint, transmission=1.0, faults=faults)


def _opacity(socket: bpy.types.NodeSocket, groups: Groups, faults: list[str]) -> Opacity:
    """Opacity that a number input gives."""
    value = number(socket, groups)
    if value is not None:
        return Opacity(min(max(value, 0.0), 1.0))
    s = source(socket, groups)
    texture = image_texture(s)
    if texture is not None:
        return Opacity(texture=texture, from_alpha=s.socket.name == "Alpha")
    if s.node is not None and s.node.bl_idname == "ShaderNodeMath":
        a, b = s.node.inputs[0], s.node.inputs[1]
        left, threshold = source(a, s.groups), number(b, s.groups)
        texture = image_texture(left)
        if texture is not None and threshold is not None and s.node.operation in {"GREATER_THAN", "ROUND"}:
            cutoff = threshold if s.node.operation == "GREATER_THAN" else 0.5
            return Opacity(texture=texture, from_alpha=left.socket.name == "Alpha", cutoff=cutoff)
    faults.append("its opacity cannot be read and is taken as 1")
    return OPAQUE


def _mix(s: Source) -> Surface:
    faults: list[str] = []
    weight = number(s.node.inputs[0], s.groups)
    left, right = (_shader(i, s.groups) for i in s.node.inputs[1:3])
    if weight is None and left.opacity == ABSENT:
        # A mask between nothing and something: the mask is the opacity.
        mask = _opacity(s.node.inputs[0], s.groups, faults)
        return replace(right, opacity=mask, faults=left.faults + right.faults + tuple(faults))
    if weight is None:
        faults.append("Mix Shader varies over the surface and is taken as half and half")
        weight = 0.5
    return _sum(left, right, 1.0 - min(max(weight, 0.0), 1.0), min(max(weight, 0.0), 1.0), faults)


def _add(s: Source) -> Surface:
    left, right = (_shader(i, s.groups) for i in s.node.inputs[:2])
    # Emission that is added to nothing leaves the surface transparent.
    return _sum(left, right, 1.0, 1.0, [])


def _sum(left: Surface, right: Surface, a: float, b: float, faults: list[str]) -> Surface:
    """Two shaders upon each other, `a` of the one and `b` of the other."""
    base = _weighted(left.base, right.base, a, b)
    emission = _weighted(left.emission, right.emission, a, b)
    unread = set(left.unread | right.unread)
    if base is None:
        faults.append("the colours of two mixed shaders are textured; their mean stands for them")
        unread.add("base")
        base = Color((0.5, 0.5, 0.5))
    if emission is None:
        faults.append("two mixed emissions are textured; the first stands for them")
        unread.add("emission")
        emission = left.emission
    opacity = left.opacity if left.opacity == right.opacity else None
    if opacity is None:
        if left.opacity.texture or right.opacity.texture:
            faults.append("the opacities of two mixed shaders differ; the one with the image stands for them")
            opacity = left.opacity if left.opacity.texture else right.opacity
        else:
            opacity = Opacity(min(max(a * left.opacity.value + b * right.opacity.value, 0.0), 1.0))
    # What is not there neither reflects nor emits: glTF weighs colour by opacity, the mix did so already.
    if 0.0 < opacity.value < 1.0 and opacity.texture is None:
        base = base.scaled((1 / opacity.value,) * 3)
    transmission = a * left.transmission + b * right.transmission
    merged = left.faults + right.faults + tuple(faults)
    return Surface(base, emission, opacity, min(transmission, 1.0), merged, frozenset(unread))


def _weighted(left: Color, right: Color, a: float, b: float) -> Color | None:
    total = a + b
    if total <= 0:
        return BLACK
    both = mixed(left, right, b / total)
    return None if both is None else both.scaled((total,) * 3)


_READERS: dict[str, Callable[[Source], Surface]] = {
    "ShaderNodeBsdfDiffuse": _diffuse,
    "ShaderNodeBsdfPrincipled": _principled,
    "ShaderNodeEmission": _emission,
    "ShaderNodeBsdfTransparent": _transparent,
    "ShaderNodeMixShader": _mix,
    "ShaderNodeAddShader": _add,
    "ShaderNodeSubsurfaceScattering": _diffuse,
    "ShaderNodeBsdfSheen": _diffuse,
    "ShaderNodeBsdfAnisotropic": _glossy,
    "ShaderNodeBsdfGlossy": _glossy,
    "ShaderNodeBsdfMetallic": _glossy,
    "ShaderNodeBsdfGlass": _glass,
    "ShaderNodeBsdfRefraction": _glass,
}
__all__ = ["WHITE", "Opacity", "Surface", "material_output", "read_surface"]
