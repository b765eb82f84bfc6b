# SPDX-License-Identifier: GPL-3.0-or-later
"""Colours that cannot be read from nodes, such as procedural ones, are baked by Cycles on the lightmap's map.

In: objects with such materials. Out: images of diffuse colour and emission, linear. Works on copies in a scene of its
own; nothing of the user's is changed.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field

import bpy
from mathutils import Matrix

from ..errors import Note
from ..places import Page, Receiver
from .materials import BakedColors
from .write import Writer

# Texels of a baked colour, at least and at most.
LEAST, MOST = 64, 512
_PASSES = {"base": "DIFFUSE", "emission": "EMIT"}
# Rays per texel: patterns finer than a texel are averaged.
_SAMPLES = 8


@dataclass(frozen=True)
class Wish:
    """What is to be baked: channels per material of one object."""

    mesh: int
    ob: bpy.types.Object
    matrix: Matrix
    uv_map: str
    # Side of the object's place in the lightmap, texels.
    side: int
    channels: Mapping[str, frozenset[str]]


@dataclass
class Baked:
    """Baked colours by (mesh, material). The images exist inside the block only."""

    colors: dict[tuple[int, str], BakedColors] = field(default_factory=dict)
    notes: list[Note] = field(default_factory=list)


def wishes(page: Page, receivers: list[Receiver], writer: Writer) -> list[Wish]:
    """What must be baked because it cannot be read, once per mesh."""
    by_uid = {ob.session_uid: ob for ob in bpy.data.objects}
    found: dict[int, Wish] = {}
    for receiver in receivers:
        number = receiver.instance.mesh
        channels = writer.unread(number)
        ob = by_uid[receiver.instance.key[0]]
        if channels and number not in found and ob.type == "MESH":
            side = round(page.places[receiver.instance.key].values[0] * page.side)
            found[number] = Wish(number, ob, receiver.instance.matrix, receiver.uv_map, side, channels)
    return list(found.values())


@contextmanager
def baked_colors(wishes: list[Wish]) -> Iterator[Baked]:
    """Bakes all wishes; whatever it made is gone afterwards."""
    baked = Baked()
    made: list[bpy.types.Image] = []
    try:
        for wish in wishes:
            try:
                _bake(wish, baked, made)
            except RuntimeError as error:
                reason = str(error).strip().splitlines()[-1]
                baked.notes.append(Note(wish.ob.name, f"its colours could not be baked ({reason}): simplify its nodes"))
        yield baked
    finally:
        for image in made:
            bpy.data.images.remove(image)


def _bake(wish: Wish, baked: Baked, made: list[bpy.types.Image]) -> None:
    graph = bpy.context.evaluated_depsgraph_get()
    mesh = bpy.data.meshes.new_from_object(wish.ob.evaluated_get(graph), depsgraph=graph)
    ob = bpy.data.objects.new("Lightkiln colours", mesh)
    scene = bpy.data.scenes.new("Lightkiln colours")
    copies: list[bpy.types.Material] = []
    try:
        scene.collection.objects.link(ob)
        ob.matrix_world = wish.matrix
        for layer in mesh.uv_layers:
            if layer.name == wish.uv_map:
                layer.active = True
        _settings(scene)
        slots = [slot.material for slot in wish.ob.material_slots]
        nodes = _targets(mesh, slots, copies)
        for channel, kind in _PASSES.items():
            names = [name for name, channels in wish.channels.items() if channel in channels]
            if names:
                images = _run(scene, ob, kind, nodes, min(max(wish.side, LEAST), MOST))
                made += images.values()
                for name in names:
                    colors = baked.colors.setdefault((wish.mesh, name), BakedColors({}, wish.uv_map))
                    baked.colors[wish.mesh, name] = BakedColors({**colors.images, channel: images[name]}, wish.uv_map)
    finally:
        bpy.data.scenes.remove(scene)
        bpy.data.objects.remove(ob)
        bpy.data.meshes.remove(mesh)
        for copy in copies:
            bpy.data.materials.remove(copy)


def _targets(
    mesh: bpy.types.Mesh, slots: list[bpy.types.Material | None], copies: list[bpy.types.Material]
) -> dict[str, bpy.types.Node]:
    """Copies of the materials with an image node each that Cycles bakes into, by the materials' names."""
    nodes: dict[str, bpy.types.Node] = {}
    made: dict[str, bpy.types.Material] = {}
    while len(mesh.materials) < max(len(slots), 1):
        mesh.materials.append(None)
    for i in range(len(mesh.materials)):
        source = slots[i] if i < len(slots) else None
        name = source.name_full if source else ""
        if name not in made:
            copy = source.copy() if source else bpy.data.materials.new("Lightkiln colours")
            copies.append(copy)
            if copy.node_tree is None:
                copy.use_nodes = True
            node = copy.node_tree.nodes.new("ShaderNodeTexImage")
            copy.node_tree.nodes.active = node
            made[name], nodes[name] = copy, node
        mesh.materials[i] = made[name]
    return nodes


def _run(
    scene: bpy.types.Scene, ob: bpy.types.Object, kind: str, nodes: dict[str, bpy.types.Node], side: int
) -> dict[str, bpy.types.Image]:
    """One pass of Cycles' bake, into one image for all materials, because they share the map."""
    image = bpy.data.images.new("Lightkiln colours", side, side, alpha=False, float_buffer=True)
    image.colorspace_settings.name = "Linear Rec.709"
    for node in nodes.values():
        node.image = image
    layer = scene.view_layers[0]
    layer.objects.active = ob
    ob.select_set(True, view_layer=layer)
    layer.update()
    context = {"scene": scene, "view_layer": layer, "object": ob, "active_object": ob}
    with bpy.context.temp_override(**context, selected_objects=[ob], selected_editable_objects=[ob]):
        if kind == "DIFFUSE":
            bpy.ops.object.bake(type=kind, pass_filter={"COLOR"}, margin=4, use_clear=True)
        else:
            bpy.ops.object.bake(type=kind, margin=4, use_clear=True)
    return dict.fromkeys(nodes, image)


def _settings(scene: bpy.types.Scene) -> None:
    scene.render.engine = "CYCLES"
    scene.cycles.device, scene.cycles.samples, scene.cycles.use_denoising = "CPU", _SAMPLES, False
    scene.cycles.use_adaptive_sampling = False
    scene.render.bake.target = "IMAGE_TEXTURES"
