# SPDX-License-Identifier: GPL-3.0-or-later
"""What light a scene has and what it falls on: scene → sources with their strengths, and digests of everything else.

Taken when a scene is baked and again when it is relit; the difference is what changed (relight_plan.py). Strengths
are in the units that the export writes, so that their ratio is the factor of the light.
"""

from __future__ import annotations

import json
from collections.abc import Generator, Iterator
from dataclasses import asdict, dataclass, field, replace

import bpy
from mathutils import Matrix

from .apply import original_materials
from .export.digest import digest, numbers_digest, tree_digest
from .export.lamps import lamp_group, profile_text, read_lamp
from .export.nodes import Color, Rgb
from .export.render_view import rendered_objects
from .export.snapshot import LIT_TYPES, light_group
from .export.surfaces import Surface, read_surface
from .export.world import plain_sky, sky_strength

# Groups that the baker names itself.
WORLD, MATERIAL, OTHERS = "environment", "material:", "others"
# Objects that are read in one step: some milliseconds.
AT_ONCE = 200
_STRENGTHS = ("radiance", "intensity", "irradiance")


@dataclass(frozen=True)
class Source:
    """A lamp, the world or an emissive material."""

    kind: str
    name: str
    # Name of its light in the baker; empty if it gave none.
    group: str
    # What its light is proportional to, per channel.
    strength: Rgb
    # Digests of where it is, and of all else that its light depends on.
    place: str
    shape: str


@dataclass(frozen=True)
class LightState:
    """All that the light of a scene depends on."""

    sources: list[Source] = field(default_factory=list)
    # Digests of place and form by object, and of what reflects and lets light through by material.
    objects: dict[str, list[str]] = field(default_factory=dict)
    looks: dict[str, str] = field(default_factory=dict)

    def to_text(self) -> str:
        """As JSON, to be saved with the file."""
        return json.dumps(asdict(self), separators=(",", ":"))

    @staticmethod
    def from_text(text: str) -> LightState:
        """From JSON; empty if there is none."""
        if not text:
            return LightState()
        data = json.loads(text)
        sources = [Source(**{**s, "strength": tuple(s["strength"])}) for s in data["sources"]]
        return LightState(sources, data["objects"], data["looks"])

    def grouped_as(self, groups: list[str]) -> LightState:
        """With the groups that the baker made: what it does not name is among the others, or gave no light."""
        rest = OTHERS if OTHERS in groups else ""
        return replace(self, sources=[s if s.group in groups else replace(s, group=rest) for s in self.sources])


def read(scene: bpy.types.Scene, view_layer: bpy.types.ViewLayer) -> LightState:
    """The state of the scene as its view layer is now."""
    steps = reading(scene, view_layer)
    while True:
        try:
            next(steps)
        except StopIteration as end:
            state: LightState = end.value
            return state


def reading(scene: bpy.types.Scene, view_layer: bpy.types.ViewLayer) -> Generator[None, None, LightState]:
    """The same in steps, so that a window with a large scene stays usable. Between them nothing may be removed."""
    state = LightState()
    surfaces: dict[bpy.types.Material, Surface] = {}
    emitters: set[tuple[str, bpy.types.Material]] = set()
    for count, (name, ob, matrix) in enumerate(_placed(view_layer)):
        if count % AT_ONCE == AT_ONCE - 1:
            yield
        if ob.type == "LIGHT":
            state.sources.append(_lamp(name, ob, matrix))
            continue
        materials = original_materials(ob) if ob.type in LIT_TYPES else []
        state.objects[name] = _object(ob, matrix, materials)
        for material in materials:
            if material is None:
                continue
            if material not in surfaces:
                surfaces[material] = read_surface(material)
                state.looks[material.name_full] = _look(surfaces[material], material)
            if max(surfaces[material].emission.factor) > 0:
                emitters.add((light_group(ob) or f"{MATERIAL}{material.name_full.strip()}", material))
    for group, material in sorted(emitters, key=lambda e: (e[1].name_full, e[0])):
        state.sources.append(_emitter(group, material, surfaces[material]))
    state.sources.extend(_world(scene.world))
    return state


def _placed(view_layer: bpy.types.ViewLayer) -> Iterator[tuple[str, bpy.types.Object, Matrix]]:
    """Rendered objects and what instanced collections hold, however deep, with what the export calls them."""
    for ob in sorted(rendered_objects(view_layer), key=lambda ob: ob.name_full):
        yield from _shown(ob.name, ob, ob.matrix_world, ())


def _shown(
    name: str, ob: bpy.types.Object, matrix: Matrix, within: tuple[bpy.types.Collection, ...]
) -> Iterator[tuple[str, bpy.types.Object, Matrix]]:
    """An object, or what the collection that it shows holds. `within`: collections around, which may not come again."""
    collection = ob.instance_collection if ob.instance_type == "COLLECTION" else None
    if ob.type == "LIGHT" or ob.type in LIT_TYPES:
        yield name, ob, matrix
    elif collection is not None and collection not in within:
        inner = matrix @ Matrix.Translation(-collection.instance_offset)
        for child in collection.all_objects:
            if not child.hide_render:
                yield from _shown(f"{ob.name}/{child.name}", child, inner @ child.matrix_world, (*within, collection))


def _lamp(name: str, ob: bpy.types.Object, matrix: Matrix) -> Source:
    lamp, node, _ = read_lamp(name, ob.data, matrix)
    strength = next(tuple(lamp[key]) for key in _STRENGTHS if key in lamp)
    shape = {k: v for k, v in lamp.items() if k not in {*_STRENGTHS, "name"}}
    place = [*node["translation"], *node["rotation"]]
    return Source(
        "lamp",
        name,
        light_group(ob) or lamp_group(ob.data),
        strength,
        digest(place),
        digest(shape, profile_text(ob.data)),
    )


def _emitter(group: str, material: bpy.types.Material, surface: Surface) -> Source:
    shape = digest(_color(surface.emission), "emission" in surface.unread and tree_digest(material.node_tree))
    return Source("material", material.name_full, group, surface.emission.factor, "", shape)


def _world(world: bpy.types.World | None) -> list[Source]:
    sky = plain_sky(world)
    if sky is None:
        assert world is not None
        strength, fixed = sky_strength(world)
        return [Source("world", world.name, WORLD, (strength,) * 3, "", fixed)]
    ends = list(sky.get("gradient", {}).values()) or [sky.get("radiance", (0.0, 0.0, 0.0))]
    red, green, blue = (max(end[c] for end in ends) for c in range(3))
    if max(red, green, blue) <= 0:
        return []
    top = (red, green, blue)
    shares = [[end[c] / top[c] if top[c] > 0 else 0.0 for c in range(3)] for end in ends]
    return [Source("world", world.name if world else "World", WORLD, top, "", digest(shares))]


def _object(ob: bpy.types.Object, matrix: Matrix, materials: list[bpy.types.Material | None]) -> list[str]:
    data = ob.data
    counts = [len(data.vertices), len(data.polygons)] if ob.type == "MESH" else []
    bounds = [number for corner in ob.bound_box for number in corner]
    # A mesh without materials gets an empty slot for the lightmap's.
    names = [m.name_full if m else "" for m in materials] if any(materials) else []
    casts = ob.visible_shadow and ob.lightkiln.casts_shadow
    place = [number for row in matrix for number in row]
    return [numbers_digest(place), numbers_digest([*counts, *bounds], f"{names} {casts}")]


def _look(surface: Surface, material: bpy.types.Material) -> str:
    """Digest of what reflects and lets light through; emission is told apart."""
    opacity = surface.opacity
    lets = (opacity.value, opacity.texture and opacity.texture.image.name_full, opacity.from_alpha, opacity.cutoff)
    unread = "base" in surface.unread and tree_digest(material.node_tree)
    return digest(surface.base.factor, _color(surface.base), lets, surface.transmission, unread)


def _color(color: Color) -> list[object]:
    """What a colour is besides its factor."""
    texture = color.texture
    if texture is None:
        return [color.attribute]
    place = [*texture.scale, texture.rotation, *texture.offset]
    return [color.attribute, texture.image.name_full, texture.uv_map, place, texture.extension, texture.interpolation]
