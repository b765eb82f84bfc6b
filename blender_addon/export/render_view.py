# SPDX-License-Identifier: GPL-3.0-or-later
"""Makes the viewport's dependency graph hold what a render would: visible objects, and modifiers at render level.

Blender's Python has no render graph, so settings of the viewport are changed and put back at once.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import bpy

_LEVELS = (("levels", "render_levels"), ("resolution", "render_resolution"))


def rendered_objects(view_layer: bpy.types.ViewLayer) -> set[bpy.types.Object]:
    """Objects of the view layer that a render shows themselves."""
    found: set[bpy.types.Object] = set()

    def visit(layer: bpy.types.LayerCollection) -> None:
        if layer.exclude or layer.collection.hide_render:
            return
        found.update(ob for ob in layer.collection.objects if not ob.hide_render)
        for child in layer.children:
            visit(child)

    visit(view_layer.layer_collection)
    return found


@contextmanager
def render_view(scene: bpy.types.Scene, view_layer: bpy.types.ViewLayer) -> Iterator[bpy.types.Depsgraph]:
    """The view layer's graph as a render sees it. It and what it holds are valid inside the block only."""
    undo: list[tuple[Any, str, Any]] = []
    hidden: list[bpy.types.Object] = []

    def put(owner: Any, name: str, value: Any) -> None:
        old = getattr(owner, name)
        if old != value:
            undo.append((owner, name, old))
            setattr(owner, name, value)

    def show(layer: bpy.types.LayerCollection) -> None:
        if layer.exclude or layer.collection.hide_render:
            return
        put(layer, "hide_viewport", False)
        put(layer.collection, "hide_viewport", False)
        for child in layer.children:
            show(child)

    objects = rendered_objects(view_layer)
    instanced = {ob for parent in objects for ob in getattr(parent.instance_collection, "all_objects", ())}
    try:
        show(view_layer.layer_collection)
        for ob in objects | instanced:
            if ob.hide_render or ob.library:
                continue
            put(ob, "hide_viewport", False)
            if ob in objects and ob.hide_get(view_layer=view_layer):
                hidden.append(ob)
                ob.hide_set(False, view_layer=view_layer)
            for modifier in ob.modifiers:
                put(modifier, "show_viewport", modifier.show_render)
                for viewport, render in _LEVELS:
                    if hasattr(modifier, viewport) and hasattr(modifier, render):
                        put(modifier, viewport, getattr(modifier, render))
        view_layer.update()
        yield view_layer.depsgraph
    finally:
        for owner, name, old in reversed(undo):
            setattr(owner, name, old)
        for ob in hidden:
            ob.hide_set(True, view_layer=view_layer)
        view_layer.update()
