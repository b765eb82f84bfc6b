# SPDX-License-Identifier: GPL-3.0-or-later
"""Digests of values and node trees: eight letters that change when what they stand for does, apart from rounding."""

from __future__ import annotations

import json
import zlib
from typing import Any

import bpy

# What nodes have that does not change what they make.
_LOOKS = {
    "location",
    "width",
    "height",
    "select",
    "show_options",
    "show_preview",
    "show_texture",
    "hide",
    "label",
    "name",
}
_LOOKS |= {"color", "use_custom_color", "location_absolute", "dimensions", "warning_propagation", "color_tag"}


def digest(*values: object) -> str:
    """The digest of numbers, texts, lists and dictionaries."""
    return f"{zlib.crc32(json.dumps(_rounded(values), default=str).encode()):08x}"


def numbers_digest(numbers: list[float], text: str = "") -> str:
    """The digest of many numbers and a text, which takes a tenth of the time."""
    # Not minus zero, which reads differently.
    rounded = ("%.5g " * len(numbers)) % tuple([number + 0.0 for number in numbers])
    return f"{zlib.crc32((rounded + text).encode('utf-8', 'replace')):08x}"


def tree_digest(tree: bpy.types.NodeTree, without: bpy.types.NodeSocket | None = None) -> str:
    """The digest of a node tree and the groups in it, but for the value of one input."""
    return digest(_described(tree, without, set()))


def _rounded(value: object) -> object:
    if isinstance(value, float):
        return float(f"{value:.5g}") if abs(value) > 1e-6 else 0.0
    if isinstance(value, dict):
        return {k: _rounded(v) for k, v in sorted(value.items())}
    if isinstance(value, list | tuple):
        return [_rounded(v) for v in value]
    return value


def _described(tree: bpy.types.NodeTree, without: bpy.types.NodeSocket | None, seen: set[str]) -> list[object]:
    if tree.name_full in seen and not tree.is_embedded_data:
        return [tree.name_full]
    seen.add(tree.name_full)
    described: list[object] = []
    for node in sorted(tree.nodes, key=lambda n: n.name):
        inputs = [_plain(getattr(s, "default_value", None)) for s in node.inputs if s != without]
        outputs = [_plain(getattr(s, "default_value", None)) for s in node.outputs]
        described.append([node.name, node.bl_idname, node.mute, inputs, outputs, _settings(node)])
        if getattr(node, "node_tree", None) is not None:
            described.append(_described(node.node_tree, without, seen))
    links = [
        (li.from_node.name, li.from_socket.identifier, li.to_node.name, li.to_socket.identifier) for li in tree.links
    ]
    return [described, sorted(links)]


def _settings(node: bpy.types.Node) -> list[object]:
    """What is set on a node itself: numbers, choices, images, and the points of ramps and curves."""
    found: list[object] = []
    for name in sorted(p.identifier for p in node.bl_rna.properties if not p.is_readonly):
        if name not in _LOOKS and not name.startswith(("bl_", "parent")):
            found.append([name, _plain(getattr(node, name, None))])
    ramp, mapping = getattr(node, "color_ramp", None), getattr(node, "mapping", None)
    if ramp is not None:
        found.append([ramp.interpolation, [[e.position, list(e.color)] for e in ramp.elements]])
    if mapping is not None:
        found.append([[list(p.location) for p in curve.points] for curve in mapping.curves])
    return found


def _plain(value: Any) -> object:
    if isinstance(value, bpy.types.ID):
        return value.name_full
    if value is None or isinstance(value, int | float | str):
        return value
    try:
        return list(value)
    except TypeError:
        return ""
