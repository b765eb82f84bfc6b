# SPDX-License-Identifier: GPL-3.0-or-later
"""Settings that are saved with the file: of the scene, of each object, and what the last bake left."""

import bpy
from bpy.props import (
    BoolProperty,
    CollectionProperty,
    EnumProperty,
    FloatProperty,
    IntProperty,
    PointerProperty,
    StringProperty,
)

# Error targets of the presets, as fractions.
PRESETS = {"PREVIEW": 0.1, "PRODUCTION": 0.02, "REFERENCE": 0.005}

# Blender before 4.5 takes every path as one that may begin with //, and does not know the option that says so.
_PATH_OPTIONS = {"PATH_SUPPORTS_BLEND_RELATIVE"} if bpy.app.version >= (4, 5, 0) else set()


def _apply_preset(settings: bpy.types.PropertyGroup, _context: bpy.types.Context) -> None:
    if settings.preset in PRESETS:
        settings["error"] = PRESETS[settings.preset] * 100


def _leave_preset(settings: bpy.types.PropertyGroup, _context: bpy.types.Context) -> None:
    fits = [name for name, error in PRESETS.items() if abs(settings.error - error * 100) < 1e-4]
    settings.preset = fits[0] if fits else "CUSTOM"


def _look_at_lights(settings: bpy.types.PropertyGroup, _context: bpy.types.Context) -> None:
    from . import live

    live.look(settings.id_data)


def _own_maps(_settings: bpy.types.PropertyGroup, context: bpy.types.Context, typed: str) -> list[str]:
    mesh = getattr(context.object, "data", None)
    return [layer.name for layer in getattr(mesh, "uv_layers", []) if typed.lower() in layer.name.lower()]


class LIGHTKILN_PG_note(bpy.types.PropertyGroup):
    """Something that the last bake skipped or approximated."""

    place: StringProperty()
    message: StringProperty()
    kind: StringProperty()


class LIGHTKILN_PG_scene(bpy.types.PropertyGroup):
    """How a scene is baked."""

    preset: EnumProperty(
        name="Quality",
        items=[
            ("PREVIEW", "Preview", "An error of 10 %: seconds"),
            ("PRODUCTION", "Production", "An error of 2 %, which is hard to see"),
            ("REFERENCE", "Reference", "An error of 0.5 %: slow"),
            ("CUSTOM", "Custom", "The error below"),
        ],
        default="PRODUCTION",
        update=_apply_preset,
    )
    error: FloatProperty(
        name="Error",
        description="Relative error to aim for. Lightkiln has no samples and no denoiser",
        subtype="PERCENTAGE",
        default=2.0,
        min=0.1,
        max=50.0,
        precision=1,
        update=_leave_preset,
    )
    progressive: BoolProperty(
        name="Show While Baking",
        description="Show the lightmap as far as it has come: coarse within seconds, then better. "
        "It takes a little longer",
        default=True,
    )
    light: EnumProperty(
        name="Light",
        description="Which light the lightmap holds",
        items=[
            ("combined", "Combined", "All light"),
            ("direct", "Direct", "Light straight from lamps: neither world nor emissive materials, and no bounce"),
            (
                "indirect",
                "Indirect",
                "World, emissive materials and every bounce: for engines whose own lamps shine on lightmapped surfaces",
            ),
        ],
        default="combined",
    )
    groups: BoolProperty(
        name="Light Groups",
        description="Keep the light of every lamp, emissive material and of the world apart. After such a bake their "
        "colours and strengths can be changed without another one. It takes about an eighth longer",
        default=False,
    )
    live: BoolProperty(
        name="Live Relight",
        description="Update the lightmap as soon as a lamp, the world or an emissive material is changed",
        default=True,
        update=_look_at_lights,
    )
    density: FloatProperty(
        name="Texel Density", description="Texels per metre", default=16.0, min=0.01, soft_max=256.0, max=4096.0
    )
    resolution_limit: IntProperty(
        name="Resolution Limit",
        description="Largest side of the lightmap. The density is lowered where it would need more",
        default=2048,
        min=16,
        max=8192,
    )
    scope: EnumProperty(
        name="Objects",
        description="Which objects get a lightmap. All that are rendered block and reflect light",
        items=[
            ("ALL", "All", "Every mesh that is rendered"),
            ("SELECTED", "Selected", "The selected meshes"),
            ("COLLECTION", "Collection", "The meshes of a collection"),
        ],
    )
    collection: PointerProperty(name="Collection", type=bpy.types.Collection)
    shared: EnumProperty(
        name="Shared Meshes",
        description="What objects that share a mesh get",
        items=[
            ("PLACES", "Keep Shared", "Each object gets its own place in the lightmap; the mesh stays shared"),
            ("SINGLE_USER", "Make Single User", "Each object gets a mesh of its own, after you confirm it"),
        ],
    )
    storage: EnumProperty(
        name="Lightmap",
        items=[
            ("FILE", "In a Folder", "An EXR file in the output folder"),
            ("PACKED", "In the .blend", "Packed into the .blend file"),
        ],
    )
    folder: StringProperty(
        name="Output Folder",
        description="Folder for lightmaps and exports; // is the folder of the .blend",
        default="//lightmaps",
        subtype="DIR_PATH",
        options=_PATH_OPTIONS,
    )
    write_glb: BoolProperty(
        name="Lit GLB",
        description="Also write a glTF of the scene that shows the lightmap in game engines",
        default=False,
    )
    notes: CollectionProperty(type=LIGHTKILN_PG_note)
    image: PointerProperty(name="Lightmap", type=bpy.types.Image)
    # Folder of the light groups that the lightmap was made of, beside the lightmap if it is relative, and what tells it
    # from that of another bake. Empty if the lightmap cannot be relit.
    solution: StringProperty()
    solution_stamp: StringProperty()
    # The lights, objects and materials as they were baked (light_state.py), as JSON.
    baked: StringProperty()
    # What a relight changed, and what it could not, one per line.
    relit: StringProperty()
    stale: StringProperty()
    # What the viewport shows: "LIT", "LIGHT" or "ORIGINAL"; set by operators, so that each change can be undone.
    view: StringProperty(default="ORIGINAL")
    summary: StringProperty()


class LIGHTKILN_PG_object(bpy.types.PropertyGroup):
    """How one object is baked."""

    exclude: BoolProperty(
        name="No Lightmap", description="The object blocks and reflects light, but gets no lightmap", default=False
    )
    density: FloatProperty(
        name="Texel Density",
        description="Texels per metre on this object; 0: as in the scene",
        default=0.0,
        min=0.0,
        soft_max=256.0,
        max=4096.0,
    )
    group: StringProperty(
        name="Light Group",
        description="Lamps and emissive objects with the same group are baked as one and can only be relit together. "
        "Empty: a group of its own",
    )
    casts_shadow: BoolProperty(name="Casts Shadow", description="The object blocks light", default=True)
    uv_map: StringProperty(
        name="UV Map",
        description="UV map of your own for the lightmap; empty: one named Lightmap is made",
        search=_own_maps,
    )


CLASSES = (LIGHTKILN_PG_note, LIGHTKILN_PG_scene, LIGHTKILN_PG_object)


def register() -> None:
    """Registers the settings on scenes and objects."""
    for cls in CLASSES:
        bpy.utils.register_class(cls)
    bpy.types.Scene.lightkiln = PointerProperty(type=LIGHTKILN_PG_scene)
    bpy.types.Object.lightkiln = PointerProperty(type=LIGHTKILN_PG_object)


def unregister() -> None:
    """Removes them."""
    del bpy.types.Object.lightkiln
    del bpy.types.Scene.lightkiln
    for cls in reversed(CLASSES):
        bpy.utils.unregister_class(cls)
