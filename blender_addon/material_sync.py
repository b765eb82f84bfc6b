# SPDX-License-Identifier: GPL-3.0-or-later
"""Keeps the values of lit materials and of their originals alike, whichever of them the user edits.

While a lightmap is shown, the material that the user sees is a copy; what is set there is meant for the original. Only
values follow, not nodes and links: those are edited in the original.
"""

from __future__ import annotations

import bpy

from .apply import STATE, lit_objects, original_materials
from .lit_materials import REPLACED, STANDS_FOR


def follow(scene: bpy.types.Scene, edited: list[bpy.types.Material]) -> None:
    """Brings the values of edited materials to their copies, or to their originals."""
    if not edited:
        return
    copies = _copies(scene)
    for original, lit in copies.items():
        if original in edited:
            for copy in lit:
                _to_copy(original.node_tree, copy.node_tree)
        else:
            for copy in [copy for copy in lit if copy in edited]:
                if original.library is None:
                    _to_original(copy.node_tree, original.node_tree)
                    for other in lit - {copy}:
                        _to_copy(original.node_tree, other.node_tree)


def _copies(scene: bpy.types.Scene) -> dict[bpy.types.Material, set[bpy.types.Material]]:
    """Originals with their lit copies."""
    found: dict[bpy.types.Material, set[bpy.types.Material]] = {}
    for ob in lit_objects(scene):
        lit = ob[STATE]["lit"]
        for i, original in enumerate(original_materials(ob)):
            copy = lit.get(str(i))
            if original is not None and copy is not None:
                found.setdefault(original, set()).add(copy)
    return found


def _to_copy(original: bpy.types.NodeTree | None, copy: bpy.types.NodeTree | None) -> None:
    for ours, theirs, names in _pairs(original, copy):
        _inputs(theirs, ours, {b: a for a, b in names.items()} if names else None)


def _to_original(copy: bpy.types.NodeTree | None, original: bpy.types.NodeTree | None) -> None:
    # A shader and its stand-in are both in the copy; the stand-in is the one that is seen, so it comes last.
    for ours, theirs, names in _pairs(original, copy):
        is_replaced = not names and any(n.get(STANDS_FOR) == theirs.name for n in copy.nodes) if copy else False
        if not is_replaced:
            _inputs(ours, theirs, names)


def _pairs(
    original: bpy.types.NodeTree | None, copy: bpy.types.NodeTree | None
) -> list[tuple[bpy.types.Node, bpy.types.Node, dict[str, str] | None]]:
    """Nodes of the original, those that show them in the copy, and original's by copy's inputs where these differ."""
    if original is None or copy is None:
        return []
    found: list[tuple[bpy.types.Node, bpy.types.Node, dict[str, str] | None]] = []
    for theirs in copy.nodes:
        stands_for = theirs.get(STANDS_FOR)
        ours = original.nodes.get(stands_for or theirs.name)
        if ours is None:
            continue
        if stands_for:
            found.append((ours, theirs, {b: a for a, b in REPLACED.get(ours.bl_idname, {}).items()}))
        elif ours.bl_idname == theirs.bl_idname:
            found.append((ours, theirs, None))
            inner = getattr(ours, "node_tree", None)
            if inner is not None and inner != theirs.node_tree:
                found += _pairs(inner, theirs.node_tree)
    return found


def _inputs(target: bpy.types.Node, origin: bpy.types.Node, names: dict[str, str] | None) -> None:
    """Copies what is not linked; `names`: the target's input by the origin's, if they do not go by position."""
    if names is not None:
        sockets = [(target.inputs.get(names[s.name]), s) for s in origin.inputs if s.name in names]
    else:
        sockets = list(zip(target.inputs, origin.inputs, strict=False))
        if not target.inputs or target.bl_idname in {"ShaderNodeValue", "ShaderNodeRGB"}:
            sockets += list(zip(target.outputs, origin.outputs, strict=False))
    for mine, its in sockets:
        if mine is None or (its.is_linked and not its.is_output) or not hasattr(its, "default_value"):
            continue
        if not hasattr(mine, "default_value"):
            continue
        value, before = its.default_value, mine.default_value
        if hasattr(value, "__len__") and not isinstance(value, str):
            if len(value) == len(before) and tuple(value) != tuple(before):
                mine.default_value = value
        elif value != before:
            mine.default_value = value
