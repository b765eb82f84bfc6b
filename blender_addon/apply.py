# SPDX-License-Identifier: GPL-3.0-or-later
"""Shows a lightmap: lit copies of materials on the objects' own slots. Meshes and original materials stay as they are.

What belongs to the lightmap is marked by custom properties, so that it is found again, by name or not, after saving:
on an object STATE (its slots before, its lit materials), PLACE (see places.py); on a material SOURCE.
"""

from __future__ import annotations

import zlib
from dataclasses import dataclass

import bpy

from .lit_materials import SOURCE, lit_material, remove_groups, set_light_only
from .unwrap import remove_map

STATE, PLACE = "lightkiln_state", "lightkiln_place"


@dataclass(frozen=True)
class Placed:
    """One object and where it lies in the lightmap."""

    ob: bpy.types.Object
    # Who carries the place: the object, or the empty that instances its collection.
    carrier: bpy.types.Object
    attribute: str
    uv_map: str
    place: tuple[float, float, float, float]


def attribute_name(ob: bpy.types.Object, *, instanced: bool) -> str:
    """Name of the property that holds an object's place. Children of one instanced collection share a carrier."""
    return f"{PLACE}_{zlib.crc32(ob.name_full.encode()):08x}" if instanced else PLACE


def apply(scene: bpy.types.Scene, image: bpy.types.Image, placed: list[Placed]) -> None:
    """Shows the lightmap on the objects; whatever an earlier bake showed in this scene goes."""
    remove(scene, keep_maps=True, keep_image=True)
    made: dict[tuple[str, str, str], bpy.types.Material] = {}
    for one in placed:
        one.carrier[one.attribute] = one.place
        if STATE in one.ob:
            continue
        _ensure_slot(one.ob)
        lit = []
        for slot in one.ob.material_slots:
            key = (slot.material.name_full if slot.material else "", one.uv_map, one.attribute)
            if key not in made:
                made[key] = lit_material(slot.material, image, one.uv_map, one.attribute)
            lit.append(made[key])
        _remember(one.ob, lit)
        one.ob[STATE]["uv_map"], one.ob[STATE]["attribute"] = one.uv_map, one.attribute
    scene.lightkiln.image = image
    set_view(scene, "LIT")


def placed_now(scene: bpy.types.Scene) -> list[Placed]:
    """What shows a lightmap now, as `apply` takes it."""
    placed: list[Placed] = []
    everything = _reachable(scene)
    for ob in [ob for ob in everything if STATE in ob]:
        uv_map, attribute = ob[STATE].get("uv_map", ""), ob[STATE].get("attribute", "")
        carriers = [ob] if attribute == PLACE else everything
        placed += [Placed(ob, c, attribute, uv_map, tuple(c[attribute])) for c in carriers if attribute in c]
    return placed


def set_view(scene: bpy.types.Scene, view: str) -> None:
    """Shows the lit materials ("LIT"), the light on grey ("LIGHT"), or the original materials ("ORIGINAL")."""
    for ob in lit_objects(scene):
        if view == "ORIGINAL":
            _show_original(ob)
        else:
            _show_lit(ob)
    set_light_only(scene.lightkiln.image, view == "LIGHT")
    scene.lightkiln.view = view


def original_materials(ob: bpy.types.Object) -> list[bpy.types.Material | None]:
    """The materials of an object's slots without the lightmap."""
    if STATE not in ob:
        return [slot.material for slot in ob.material_slots]
    own, meshs = ob[STATE]["original"], ob.data.materials
    return [own.get(str(i)) or (meshs[i] if i < len(meshs) else None) for i in range(len(ob.material_slots))]


def lit_objects(scene: bpy.types.Scene) -> list[bpy.types.Object]:
    """Objects of the scene, and of the collections that it instances, that have a lightmap."""
    return [ob for ob in _reachable(scene) if STATE in ob]


def _reachable(scene: bpy.types.Scene) -> list[bpy.types.Object]:
    found = {ob: None for ob in scene.objects}
    queue = list(found)
    for ob in queue:
        for child in ob.instance_collection.all_objects if ob.instance_collection else ():
            if child not in found:
                found[child] = None
                queue.append(child)
    return list(found)


def remove(scene: bpy.types.Scene, *, keep_maps: bool = False, keep_image: bool = False) -> None:
    """Takes everything away that baking added to the scene."""
    lit: set[bpy.types.Material] = set()
    bare: set[bpy.types.Mesh] = set()
    for ob in lit_objects(scene):
        lit.update(m for m in ob[STATE]["lit"].values() if m)
        _show_original(ob)
        del ob[STATE]
        bare.add(ob.data)
    # Only when no object of a shared mesh needs the slot any more.
    for mesh in [mesh for mesh in bare if mesh.get(_ADDED_SLOT)]:
        mesh.materials.clear()
        del mesh[_ADDED_SLOT]
    meshes = set()
    for ob in _reachable(scene):
        for name in [k for k in ob.keys() if k.startswith(PLACE)]:  # noqa: SIM118 (not a dictionary)
            del ob[name]
        if ob.type == "MESH":
            meshes.add(ob.data)
    for material in lit:
        if material.users == 0:
            bpy.data.materials.remove(material)
    remove_groups()
    image = scene.lightkiln.image
    if image is not None and not keep_image:
        bpy.data.images.remove(image)
    if not keep_maps:
        for mesh in meshes:
            remove_map(mesh)
    scene.lightkiln.view = "ORIGINAL"


def detach(scene: bpy.types.Scene) -> None:
    """Leaves what is shown as ordinary materials, and forgets the originals on the slots."""
    set_view(scene, "LIT")
    for ob in lit_objects(scene):
        for material in ob[STATE]["lit"].values():
            if material and SOURCE in material:
                del material[SOURCE]
        del ob[STATE]
    scene.lightkiln.image = None
    scene.lightkiln.view = "ORIGINAL"


_ADDED_SLOT = "lightkiln_added_slot"


def _ensure_slot(ob: bpy.types.Object) -> None:
    """A mesh without slots gets an empty one: object materials need a slot to stand on."""
    if not ob.material_slots:
        ob.data.materials.append(None)
        ob.data[_ADDED_SLOT] = True


def _remember(ob: bpy.types.Object, lit: list[bpy.types.Material]) -> None:
    """Stores the slots as they are, and the materials to show instead. References count as users."""
    ob[STATE] = {"links": "".join(slot.link[0] for slot in ob.material_slots), "original": {}, "lit": {}}
    state = ob[STATE]
    for i, slot in enumerate(ob.material_slots):
        state["lit"][str(i)] = lit[i]
        if slot.link == "OBJECT" and slot.material:
            state["original"][str(i)] = slot.material


def _show_lit(ob: bpy.types.Object) -> None:
    lit = ob[STATE]["lit"]
    for i, slot in enumerate(ob.material_slots):
        material = lit.get(str(i))
        if material is not None:
            slot.link = "OBJECT"
            slot.material = material


def _show_original(ob: bpy.types.Object) -> None:
    state = ob[STATE]
    for i, slot in enumerate(ob.material_slots):
        if i < len(state["links"]):
            slot.link = "OBJECT"
            slot.material = state["original"].get(str(i))
            slot.link = "OBJECT" if state["links"][i] == "O" else "DATA"
