# SPDX-License-Identifier: GPL-3.0-or-later
"""Reads sockets of shader nodes through reroutes, groups and muted nodes: an input → a number, or a colour that glTF
can express (a factor times at most one image), or nothing if it can express neither."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import bpy

Rgb = tuple[float, float, float]
WHITE: Rgb = (1.0, 1.0, 1.0)
# Group nodes around a socket, outermost first.
Groups = tuple[bpy.types.Node, ...]


@dataclass(frozen=True)
class Texture:
    """An image as a node shows it."""

    image: bpy.types.Image
    # UV map by name; empty: the mesh's active one.
    uv_map: str = ""
    scale: tuple[float, float] = (1.0, 1.0)
    rotation: float = 0.0
    offset: tuple[float, float] = (0.0, 0.0)
    extension: str = "REPEAT"
    interpolation: str = "Linear"


@dataclass(frozen=True)
class Color:
    """factor × texture × vertex colour, linear."""

    factor: Rgb = WHITE
    texture: Texture | None = None
    # Vertex colours by name; empty: the mesh's active ones.
    attribute: str | None = None

    def is_constant(self) -> bool:
        """True if the factor is all there is."""
        return self.texture is None and self.attribute is None

    def scaled(self, by: Rgb) -> Color:
        """Times a constant."""
        a, b = self.factor, by
        return replace(self, factor=(a[0] * b[0], a[1] * b[1], a[2] * b[2]))


@dataclass(frozen=True)
class Source:
    """What feeds an input: a node's output, or nothing but the input's own value."""

    socket: bpy.types.NodeSocket
    node: Any
    groups: Groups = field(default=())


def source(socket: bpy.types.NodeSocket, groups: Groups = ()) -> Source:
    """Follows the link of an input to the node that makes its value."""
    for _ in range(1000):
        link = next((li for li in socket.links if li.is_valid and not li.is_muted), None) if socket.links else None
        if link is None:
            return Source(socket, None, groups)
        node, output = link.from_node, link.from_socket
        if node.mute:
            passed = next((li.from_socket for li in node.internal_links if li.to_socket == output), None)
            if passed is None:
                return Source(output, None, groups)
            socket = passed
        elif node.bl_idname == "NodeReroute":
            socket = node.inputs[0]
        elif node.bl_idname == "ShaderNodeGroup" and node.node_tree is not None:
            inner = _group_output(node.node_tree, output.identifier)
            if inner is None:
                return Source(output, None, groups)
            socket, groups = inner, (*groups, node)
        elif node.bl_idname == "NodeGroupInput" and groups:
            outer = next((s for s in groups[-1].inputs if s.identifier == output.identifier), None)
            if outer is None:
                return Source(output, None, groups)
            socket, groups = outer, groups[:-1]
        else:
            return Source(output, node, groups)
    return Source(socket, None, groups)


def _group_output(tree: bpy.types.NodeTree, identifier: str) -> bpy.types.NodeSocket | None:
    outputs = [n for n in tree.nodes if n.bl_idname == "NodeGroupOutput" and n.is_active_output]
    return next((s for n in outputs for s in n.inputs if s.identifier == identifier), None)


_MATH: dict[str, Callable[[float, float], float]] = {
    "ADD": lambda a, b: a + b,
    "SUBTRACT": lambda a, b: a - b,
    "MULTIPLY": lambda a, b: a * b,
    "DIVIDE": lambda a, b: a / b if b else 0.0,
    "POWER": lambda a, b: a**b if a >= 0 else 0.0,
    "MINIMUM": min,
    "MAXIMUM": max,
    "GREATER_THAN": lambda a, b: float(a > b),
    "LESS_THAN": lambda a, b: float(a < b),
    "SQRT": lambda a, _: math.sqrt(max(a, 0.0)),
}


def number(socket: bpy.types.NodeSocket, groups: Groups = ()) -> float | None:
    """The value of a number that is the same everywhere; none for any other."""
    s = source(socket, groups)
    if s.node is None:
        value = getattr(s.socket, "default_value", None)
        if value is None:
            return None
        return float(value) if isinstance(value, int | float) else float(sum(value[:3]) / 3)
    if s.node.bl_idname == "ShaderNodeValue":
        return float(s.node.outputs[0].default_value)
    if s.node.bl_idname == "ShaderNodeMath" and s.node.operation in _MATH:
        a, b = (number(i, s.groups) for i in s.node.inputs[:2])
        if a is None or b is None:
            return None
        value = _MATH[s.node.operation](a, b)
        return min(max(value, 0.0), 1.0) if s.node.use_clamp else value
    return None


def color(socket: bpy.types.NodeSocket, groups: Groups = ()) -> Color | None:
    """The colour of an input, if glTF can express it."""
    s = source(socket, groups)
    if s.node is None:
        value = getattr(s.socket, "default_value", None)
        if value is None:
            return None
        return Color((value,) * 3 if isinstance(value, int | float) else (value[0], value[1], value[2]))
    reader = _READERS.get(s.node.bl_idname)
    return reader(s) if reader else None


def _rgb(s: Source) -> Color:
    value = s.node.outputs[0].default_value
    return Color((value[0], value[1], value[2]))


def _value(s: Source) -> Color | None:
    value = number(s.socket.node.outputs[0], s.groups) if s.node.bl_idname == "ShaderNodeValue" else None
    return None if value is None else Color((value,) * 3)


def _image(s: Source) -> Color | None:
    texture = image_texture(s)
    return Color(texture=texture) if texture and s.socket.name == "Color" else None


def _vertex_color(s: Source) -> Color | None:
    is_attribute = s.node.bl_idname == "ShaderNodeAttribute"
    if s.socket.name != "Color" or (is_attribute and s.node.attribute_type != "GEOMETRY"):
        return None
    return Color(attribute=s.node.attribute_name if is_attribute else s.node.layer_name)


def _mix(s: Source) -> Color | None:
    node = s.node
    if node.bl_idname == "ShaderNodeMix":
        if node.data_type != "RGBA":
            return None
        sockets = {i.identifier: i for i in node.inputs}
        factor, a, b = sockets["Factor_Float"], sockets["A_Color"], sockets["B_Color"]
    else:
        factor, a, b = node.inputs[0], node.inputs[1], node.inputs[2]
    weight = number(factor, s.groups)
    if weight is None:
        return None
    weight = min(max(weight, 0.0), 1.0)
    left = color(a, s.groups) if weight < 1 or node.blend_type != "MIX" else Color()
    right = color(b, s.groups) if weight > 0 else Color()
    if left is None or right is None:
        return None
    if node.blend_type == "MIX":
        return mixed(left, right, weight)
    if node.blend_type == "MULTIPLY":
        return _multiplied(left, right, weight)
    if node.blend_type == "ADD" and left.is_constant() and right.is_constant():
        return Color(_each(left.factor, right.factor, lambda x, y: x + weight * y))
    return None


def mixed(left: Color, right: Color, weight: float) -> Color | None:
    """left · (1 − weight) + right · weight, if that is a colour that glTF can express."""
    if weight == 0.0 or left == right:
        return left
    if weight == 1.0:
        return right
    if left.is_constant() and right.is_constant():
        return Color(_each(left.factor, right.factor, lambda x, y: x + weight * (y - x)))
    if left.is_constant() and max(left.factor) == 0.0:
        return right.scaled((weight,) * 3)
    if right.is_constant() and max(right.factor) == 0.0:
        return left.scaled((1 - weight,) * 3)
    same = left.texture == right.texture and left.attribute == right.attribute
    return replace(left, factor=_each(left.factor, right.factor, lambda x, y: x + weight * (y - x))) if same else None


def _multiplied(left: Color, right: Color, weight: float) -> Color | None:
    if weight < 1.0:
        # 1 − w + w · b is a constant only if b is one.
        if not right.is_constant():
            return None
        right = Color(_each(right.factor, WHITE, lambda x, _: 1 - weight + weight * x))
    if (left.texture and right.texture) or (left.attribute is not None and right.attribute is not None):
        return None
    attribute = left.attribute if left.attribute is not None else right.attribute
    return Color(left.factor, left.texture or right.texture, attribute).scaled(right.factor)


def _each(a: Rgb, b: Rgb, f: Callable[[float, float], float]) -> Rgb:
    return (f(a[0], b[0]), f(a[1], b[1]), f(a[2], b[2]))


def image_texture(s: Source) -> Texture | None:
    """The image of an image node and how it lies on the surface; none if glTF cannot express it."""
    node = s.node
    if node is None or node.bl_idname != "ShaderNodeTexImage" or node.image is None or node.projection != "FLAT":
        return None
    if node.image.source not in {"FILE", "GENERATED"} or (not node.image.has_data and not all(node.image.size)):
        return None
    placed = _coordinates(node.inputs["Vector"], s.groups)
    if placed is None:
        return None
    return replace(placed, image=node.image, extension=node.extension, interpolation=node.interpolation)


def _coordinates(socket: bpy.types.NodeSocket, groups: Groups) -> Texture | None:
    """Texture coordinates: a UV map, moved, turned and scaled at most."""
    blank = Texture(image=None)
    s = source(socket, groups)
    if s.node is None:
        return blank
    kind = s.node.bl_idname
    if kind == "ShaderNodeTexCoord":
        return blank if s.socket.name == "UV" and not s.node.from_instancer else None
    if kind == "ShaderNodeUVMap":
        return None if s.node.from_instancer else replace(blank, uv_map=s.node.uv_map)
    if kind == "ShaderNodeAttribute" and s.node.attribute_type == "GEOMETRY" and s.socket.name == "Vector":
        return replace(blank, uv_map=s.node.attribute_name)
    if kind == "ShaderNodeMapping":
        return _mapping(s)
    return None


def _mapping(s: Source) -> Texture | None:
    """A mapping node over a UV map. glTF's v runs down, Blender's up; the transform is turned over with it."""
    inner = _coordinates(s.node.inputs["Vector"], s.groups)
    if (
        inner is None
        or replace(inner, uv_map="") != Texture(image=None)
        or s.node.vector_type not in {"POINT", "TEXTURE"}
    ):
        return None
    if any(source(s.node.inputs[name], s.groups).node for name in ("Location", "Rotation", "Scale")):
        return None
    move, turn, scale = (s.node.inputs[name].default_value for name in ("Location", "Rotation", "Scale"))
    if abs(turn[0]) > 1e-6 or abs(turn[1]) > 1e-6:
        return None
    angle, size, shift = turn[2], (scale[0], scale[1]), (move[0], move[1])
    if s.node.vector_type == "TEXTURE":
        # The inverse is move, turn, scale in that order: the same kind of transform only if the scale is even.
        if not size[0] or abs(size[0] - size[1]) > 1e-6:
            return None
        angle, size = -angle, (1 / size[0], 1 / size[1])
        c, n = math.cos(angle) * size[0], math.sin(angle) * size[0]
        shift = (-c * shift[0] + n * shift[1], -n * shift[0] - c * shift[1])
    c, n = math.cos(angle), math.sin(angle)
    offset = (-n * size[1] + shift[0], 1.0 - c * size[1] - shift[1])
    return replace(inner, scale=size, rotation=angle, offset=offset)


_READERS: dict[str, Callable[[Source], Color | None]] = {
    "ShaderNodeRGB": _rgb,
    "ShaderNodeValue": _value,
    "ShaderNodeTexImage": _image,
    "ShaderNodeVertexColor": _vertex_color,
    "ShaderNodeAttribute": _vertex_color,
    "ShaderNodeMix": _mix,
    "ShaderNodeMixRGB": _mix,
}
