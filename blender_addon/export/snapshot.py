# SPDX-License-Identifier: GPL-3.0-or-later
"""Copies what a render would show out of Blender: meshes as arrays, their places, and the lamps.

After this the scene may be edited freely. Everything is read in one go, because the graph is valid only for a moment.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import bpy
import numpy as np
import numpy.typing as npt
from mathutils import Matrix

from ..errors import Note
from .render_view import render_view, rendered_objects

Floats = npt.NDArray[np.float32]
Ints = npt.NDArray[np.int32]
# (session_uid of the object, session_uid of the instancer or 0, place within the instancer)
InstanceKey = tuple[int, int, tuple[int, ...]]
_UNUSED = 2147483647
LIT_TYPES = {"MESH", "CURVE", "SURFACE", "FONT", "META"}


@dataclass
class MeshData:
    """A mesh, one entry per corner of a face."""

    positions: Floats
    normals: Floats
    # Triangles as corners, and the material slot of each.
    triangles: Ints
    slots: Ints
    uv_maps: dict[str, Floats]
    active_map: str
    colors: dict[str, Floats]
    active_color: str
    materials: list[bpy.types.Material | None]


@dataclass
class Instance:
    """A mesh in its place."""

    name: str
    key: InstanceKey
    mesh: int
    matrix: Matrix
    casts_shadow: bool
    # Light group of its emission; empty: one per material.
    group: str
    # True if the object stands in the scene itself or comes from a collection that does.
    addressable: bool


@dataclass
class Snapshot:
    """All that the export needs of the scene, apart from materials and the world."""

    meshes: list[MeshData] = field(default_factory=list)
    instances: list[Instance] = field(default_factory=list)
    # Name, lamp, place and light group, which may be empty.
    lamps: list[tuple[str, bpy.types.Light, Matrix, str]] = field(default_factory=list)
    notes: list[Note] = field(default_factory=list)


def light_group(ob: bpy.types.Object) -> str:
    """The light group that the user gave an object; empty if none. Files are named after it, so it has an end."""
    name: str = ob.lightkiln.group
    return name.strip()[:48].strip()


def take(scene: bpy.types.Scene, view_layer: bpy.types.ViewLayer) -> Snapshot:
    """Copies the scene as a render would show it."""
    snapshot = Snapshot()
    known: dict[Any, int] = {}
    unreal: dict[str, int] = {}
    with render_view(scene, view_layer) as graph:
        shown = {ob.session_uid for ob in rendered_objects(view_layer)}
        for place in graph.object_instances:
            ob = place.object
            if not _is_rendered(place, shown):
                continue
            if ob.type == "LIGHT":
                original = ob.original
                lamp = (_name(place), original.data, place.matrix_world.copy(), light_group(original))
                snapshot.lamps.append(lamp)
            elif ob.type in LIT_TYPES:
                _add_mesh(snapshot, known, unreal, place)
    for name, count in unreal.items():
        what = (
            f"{count} instances block and reflect light, but have no lightmap"
            if count
            else "only meshes get a lightmap"
        )
        snapshot.notes.append(Note(name, f"{what}: select it and use Make Copies for Lightmap"))
    return snapshot


def _is_rendered(place: bpy.types.DepsgraphObjectInstance, shown: set[int]) -> bool:
    if not place.show_self:
        return False
    if place.is_instance:
        parent = place.parent.original if place.parent else None
        return not place.object.original.hide_render and (parent is None or parent.session_uid in shown)
    original = place.object.original
    if original.is_instancer and not original.show_instancer_for_render:
        return False
    return original.session_uid in shown


def _name(place: bpy.types.DepsgraphObjectInstance) -> str:
    if place.is_instance and place.parent:
        return f"{place.parent.original.name}/{place.object.original.name}"
    name: str = place.object.original.name
    return name


def _key(place: bpy.types.DepsgraphObjectInstance) -> InstanceKey:
    path = tuple(i for i in place.persistent_id if i != _UNUSED) if place.is_instance else ()
    parent = place.parent.original.session_uid if place.is_instance and place.parent else 0
    return (place.object.original.session_uid, parent, path)


def _add_mesh(
    snapshot: Snapshot, known: dict[Any, int], unreal: dict[str, int], place: bpy.types.DepsgraphObjectInstance
) -> None:
    ob = place.object
    parent = place.parent.original if place.is_instance and place.parent else None
    materials = [slot.material.original if slot.material else None for slot in ob.material_slots]
    if ob.type == "MESH" and len(ob.data.materials) > len(materials):
        materials = [m.original if m else None for m in ob.data.materials]
    identity = (ob.data.as_pointer() if ob.data else 0, ob.type, tuple(m.name_full if m else "" for m in materials))
    if identity not in known:
        data = _read(ob, materials)
        if data is None:
            if not place.is_instance:
                snapshot.notes.append(Note(ob.original.name, "it has no faces and is skipped: delete it, or add faces"))
            return
        known[identity] = len(snapshot.meshes)
        snapshot.meshes.append(data)
    one_level = len([i for i in place.persistent_id if i != _UNUSED]) == 1
    of_collection = parent is not None and parent.instance_type == "COLLECTION" and one_level
    if ob.original.type != "MESH" and parent in {None, ob.original}:
        unreal.setdefault(ob.original.name, 0)
    elif parent is not None and not of_collection:
        unreal[parent.name] = unreal.get(parent.name, 0) + 1
    original = ob.original
    snapshot.instances.append(
        Instance(
            name=_name(place),
            key=_key(place),
            mesh=known[identity],
            matrix=place.matrix_world.copy(),
            casts_shadow=original.visible_shadow and original.lightkiln.casts_shadow,
            group=light_group(original),
            addressable=parent is None or of_collection,
        )
    )


def _read(ob: bpy.types.Object, materials: list[bpy.types.Material | None]) -> MeshData | None:
    """The object's mesh as arrays, or none if it has no faces."""
    converted = ob.type != "MESH"
    mesh = ob.to_mesh() if converted else ob.data
    try:
        if mesh is None or not mesh.polygons:
            return None
        return _arrays(mesh, materials)
    finally:
        if converted:
            ob.to_mesh_clear()


def _arrays(mesh: bpy.types.Mesh, materials: list[bpy.types.Material | None]) -> MeshData:
    mesh.calc_loop_triangles()
    corners = len(mesh.loops)

    def read(items: Any, name: str, count: int, kind: Any) -> npt.NDArray[Any]:
        values = np.empty(count, kind)
        items.foreach_get(name, values)
        return values

    positions = read(mesh.vertices, "co", 3 * len(mesh.vertices), np.float32).reshape(-1, 3)
    vertex_of = read(mesh.loops, "vertex_index", corners, np.int32)
    normals = read(mesh.corner_normals, "vector", 3 * corners, np.float32).reshape(-1, 3)
    triangles = read(mesh.loop_triangles, "loops", 3 * len(mesh.loop_triangles), np.int32).reshape(-1, 3)
    polygons = read(mesh.loop_triangles, "polygon_index", len(mesh.loop_triangles), np.int32)
    slots = read(mesh.polygons, "material_index", len(mesh.polygons), np.int32)[polygons]
    uv_maps = {layer.name: read(layer.uv, "vector", 2 * corners, np.float32).reshape(-1, 2) for layer in mesh.uv_layers}
    active = next((layer.name for layer in mesh.uv_layers if layer.active_render), "")
    colors = {}
    for attribute in mesh.color_attributes:
        per_vertex = attribute.domain == "POINT"
        values = read(attribute.data, "color", 4 * len(attribute.data), np.float32).reshape(-1, 4)
        colors[attribute.name] = values[vertex_of] if per_vertex else values
    default = mesh.color_attributes.default_color_name if hasattr(mesh.color_attributes, "default_color_name") else ""
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    normals = np.where(length > 1e-8, normals / np.maximum(length, 1e-8), np.array((0, 0, 1), np.float32))
    slots = np.clip(slots, 0, max(len(materials) - 1, 0))
    return MeshData(
        positions=positions[vertex_of],
        normals=normals.astype(np.float32),
        triangles=triangles,
        slots=slots,
        uv_maps=uv_maps,
        active_map=active,
        colors=colors,
        active_color=default or next(iter(colors), ""),
        materials=materials or [None],
    )
