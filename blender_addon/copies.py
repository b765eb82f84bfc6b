# SPDX-License-Identifier: GPL-3.0-or-later
"""Real meshes in place of what cannot have a lightmap: instances of geometry nodes, curves, repeated faces.

The copies stand in a collection of their own; the originals are hidden until they are restored.
"""

from __future__ import annotations

from typing import Any

import bpy

from . import session
from .apply import STATE
from .export.snapshot import LIT_TYPES

COLLECTION = "Lightkiln Copies"
# On a copy: its original. On an original: how it was hidden before.
COPY_OF, HIDDEN = "lightkiln_copy_of", "lightkiln_hidden"


def collection_of(scene: bpy.types.Scene) -> bpy.types.Collection | None:
    """The scene's collection of copies."""
    return next((c for c in scene.collection.children if c.get(COLLECTION)), None)


def make(scene: bpy.types.Scene, view_layer: bpy.types.ViewLayer, originals: list[bpy.types.Object]) -> int:
    """Copies the originals and their instances as meshes and hides them. Returns how many copies there are."""
    wanted = {ob.session_uid for ob in originals}
    graph = view_layer.depsgraph
    graph.update()
    meshes: dict[Any, bpy.types.Mesh] = {}
    made: list[tuple[str, bpy.types.Mesh, Any, bpy.types.Object]] = []
    for place in graph.object_instances:
        owner = place.parent.original if place.is_instance and place.parent else place.object.original
        if owner.session_uid not in wanted or place.object.type not in LIT_TYPES or not place.show_self:
            continue
        key = (place.object.data.as_pointer(), place.object.original.session_uid, place.object.type)
        if key not in meshes:
            # A curve shows itself as an instance of a mesh that is there for a moment only, which 4.2 cannot convert.
            curve = place.object.original.type != "MESH"
            source = place.object.original.evaluated_get(graph) if curve else place.object
            meshes[key] = bpy.data.meshes.new_from_object(source, preserve_all_data_layers=True, depsgraph=graph)
        if meshes[key].polygons:
            made.append((place.object.original.name, meshes[key], place.matrix_world.copy(), owner))
    for mesh in [mesh for mesh in meshes.values() if not mesh.polygons]:
        bpy.data.meshes.remove(mesh)
    if not made:
        return 0
    collection = collection_of(scene)
    if collection is None:
        collection = bpy.data.collections.new(COLLECTION)
        collection[COLLECTION] = True
        scene.collection.children.link(collection)
    for name, mesh, matrix, owner in made:
        copy = bpy.data.objects.new(f"{name} Copy", mesh)
        copy.matrix_world = matrix
        copy[COPY_OF] = owner
        collection.objects.link(copy)
    for owner in {owner for *_, owner in made}:
        owner[HIDDEN] = [int(owner.hide_render), int(owner.hide_viewport)]
        owner.hide_render = owner.hide_viewport = True
    return len(made)


def restore(scene: bpy.types.Scene) -> None:
    """Removes the copies and shows the originals as they were."""
    collection = collection_of(scene)
    if collection is None:
        return
    for copy in list(collection.objects):
        original, mesh = copy.get(COPY_OF), copy.data
        if original is not None and HIDDEN in original:
            hidden = original[HIDDEN]
            original.hide_render, original.hide_viewport = bool(hidden[0]), bool(hidden[1])
            del original[HIDDEN]
        lit = [m for m in copy[STATE]["lit"].values() if m] if STATE in copy else []
        bpy.data.objects.remove(copy)
        if mesh.users == 0:
            bpy.data.meshes.remove(mesh)
        for material in lit:
            if material.users == 0:
                bpy.data.materials.remove(material)
    bpy.data.collections.remove(collection)


class LIGHTKILN_OT_make_copies(bpy.types.Operator):
    """Copy what the selected objects show, instances included, as meshes that can have a lightmap; hide the objects"""

    bl_idname = "lightkiln.make_copies"
    bl_label = "Make Copies for Lightmap"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Something must be selected that is no copy."""
        return session.running is None and any(COPY_OF not in ob for ob in context.selected_objects)

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Makes them."""
        originals = [ob for ob in context.selected_objects if COPY_OF not in ob and ob.library is None]
        count = make(context.scene, context.view_layer, originals)
        if count == 0:
            self.report({"WARNING"}, "The selected objects show no faces: select meshes, curves, texts or instancers")
            return {"CANCELLED"}
        self.report({"INFO"}, f"{count} copies stand in the collection {COLLECTION}")
        return {"FINISHED"}


class LIGHTKILN_OT_restore_originals(bpy.types.Operator):
    """Remove the copies and show the objects that they were made from"""

    bl_idname = "lightkiln.restore_originals"
    bl_label = "Restore Originals"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """There must be copies."""
        return session.running is None and collection_of(context.scene) is not None

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Restores them."""
        restore(context.scene)
        return {"FINISHED"}


CLASSES = (LIGHTKILN_OT_make_copies, LIGHTKILN_OT_restore_originals)


def register() -> None:
    """Registers the operators."""
    for cls in CLASSES:
        bpy.utils.register_class(cls)


def unregister() -> None:
    """Removes them."""
    for cls in reversed(CLASSES):
        bpy.utils.unregister_class(cls)
