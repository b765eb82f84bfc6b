# SPDX-License-Identifier: GPL-3.0-or-later
"""Which objects get a lightmap, and the UV maps that they need: the scene's settings → maps on base meshes."""

from __future__ import annotations

import math

import bpy

from .changes import Changes
from .errors import BakeError, Note
from .export.render_view import rendered_objects
from .export.snapshot import Snapshot
from .places import Receiver, uv_area, world_area
from .unwrap import MAP, is_current

# Texels between charts at the density that is asked for.
GAP = 3.0
# Share of a page that charts fill, roughly, to tell beforehand whether the density must be lowered.
FILL = 0.55


def candidates(scene: bpy.types.Scene, view_layer: bpy.types.ViewLayer) -> dict[int, bpy.types.Object]:
    """Mesh objects in the scene's scope that want a lightmap, and children of instanced collections, by session_uid."""
    found: dict[int, bpy.types.Object] = {}
    for ob in rendered_objects(view_layer):
        if not in_scope(scene, view_layer, ob):
            continue
        children = (
            ob.instance_collection.all_objects if ob.instance_type == "COLLECTION" and ob.instance_collection else ()
        )
        for candidate in (ob, *children):
            if candidate.type == "MESH" and not candidate.hide_render and not candidate.lightkiln.exclude:
                found[candidate.session_uid] = candidate
    return dict(sorted(found.items(), key=lambda item: item[1].name_full))


def in_scope(scene: bpy.types.Scene, view_layer: bpy.types.ViewLayer, ob: bpy.types.Object) -> bool:
    """True if the scene's settings include the object."""
    settings = scene.lightkiln
    if settings.scope == "SELECTED":
        selected: bool = ob.select_get(view_layer=view_layer)
        return selected
    if settings.scope == "COLLECTION":
        if settings.collection is None:
            raise BakeError("No collection is chosen: choose one, or bake all objects")
        return ob.name in settings.collection.all_objects
    return True


def shared_meshes(objects: list[bpy.types.Object]) -> list[bpy.types.Object]:
    """Objects whose mesh has other users, one of which may keep it."""
    keepers: set[int] = set()
    shared = []
    for ob in objects:
        if ob.data.users > 1 and ob.data.session_uid in keepers and ob.library is None:
            shared.append(ob)
        keepers.add(ob.data.session_uid)
    return shared


def prepare(
    scene: bpy.types.Scene, objects: dict[int, bpy.types.Object], changes: Changes
) -> tuple[dict[int, str], list[Note]]:
    """Makes the maps that are missing. Returns the map to use by session_uid of the object, and what was left out."""
    for ob in objects.values():
        if ob.mode == "EDIT":
            raise BakeError(f"`{ob.name}` is in Edit Mode: leave it and bake again")
    if scene.lightkiln.shared == "SINGLE_USER":
        for ob in shared_meshes(list(objects.values())):
            changes.make_single_user(ob)
    density = scene.lightkiln.density * expected_lowering(scene, objects)
    maps: dict[int, str] = {}
    notes: list[Note] = []
    for uid, ob in objects.items():
        if not ob.data.polygons:
            if not any(m.type == "NODES" for m in ob.modifiers):
                continue
            notes.append(
                Note(ob.name, "its mesh has no faces of its own, so it gets no lightmap: Make Copies for Lightmap")
            )
            continue
        own = ob.lightkiln.uv_map
        if own and own not in ob.data.uv_layers:
            raise BakeError(f"`{ob.name}` has no UV map `{own}`: choose another one in its Lightkiln settings")
        linked = ob.library or ob.data.library
        if linked and (ob.library or not (own or MAP in ob.data.uv_layers)):
            message = f"it is linked from `{linked.filepath}` and gets no lightmap: make it local, or bake it there"
            notes.append(Note(ob.name, message))
            continue
        gap = GAP / ((ob.lightkiln.density or scene.lightkiln.density) * density / scene.lightkiln.density)
        if not own and not linked and not is_current(ob.data, gap):
            changes.unwrap(ob.data, ob.matrix_world, gap)
        maps[uid] = own or MAP
    return maps, notes


def expected_lowering(scene: bpy.types.Scene, objects: dict[int, bpy.types.Object]) -> float:
    """About by how much the density must be lowered to stay within the resolution limit."""
    texels = 0.0
    for ob in objects.values():
        scale = abs(ob.matrix_world.to_3x3().determinant()) ** (2 / 3)
        area = sum(p.area for p in ob.data.polygons) * scale
        texels += area * (ob.lightkiln.density or scene.lightkiln.density) ** 2
    if texels <= 0:
        return 1.0
    return min(1.0, scene.lightkiln.resolution_limit * math.sqrt(FILL / texels))


def chosen(
    scene: bpy.types.Scene, view_layer: bpy.types.ViewLayer, snapshot: Snapshot, maps: dict[int, str]
) -> tuple[list[Receiver], list[Note]]:
    """The instances that get a lightmap, and why others of the wanted ones do not."""
    by_uid = {ob.session_uid: ob for ob in bpy.data.objects}
    receivers: list[Receiver] = []
    notes: list[Note] = []
    for instance in snapshot.instances:
        uid, parent, _ = instance.key
        if uid not in maps or not instance.addressable:
            continue
        if parent and not in_scope(scene, view_layer, by_uid[parent]):
            continue
        fault = _fault(snapshot, instance.mesh, instance.matrix, maps[uid])
        if fault:
            notes.append(Note(instance.name, fault))
            continue
        density = by_uid[uid].lightkiln.density or scene.lightkiln.density
        receivers.append(Receiver(instance, maps[uid], density))
    return receivers, notes


def _fault(snapshot: Snapshot, mesh: int, matrix: object, uv_map: str) -> str | None:
    data = snapshot.meshes[mesh]
    if uv_map not in data.uv_maps:
        return f"its modifiers lose the UV map `{uv_map}`, so it gets no lightmap: apply them, or keep the map in them"
    if world_area(data, matrix) <= 0.0:
        return "its faces have no area, so it gets no lightmap: check its scale"
    if uv_area(data, uv_map) <= 0.0:
        return f"its faces have no area in the UV map `{uv_map}`: unwrap it, or let Lightkiln make a map"
    return None
