# SPDX-License-Identifier: GPL-3.0-or-later
"""Panels: the bake in the render properties and the sidebar, an object's settings in the object properties."""

import bpy

from . import copies, live, relit, session

# Notes that the panel lists; the rest is counted.
MOST_NOTES = 12
# The same of changes that need a bake.
MOST_STALE = 5


class _BakePanel:
    """The bake's button and progress."""

    bl_label = "Lightkiln"
    layout: bpy.types.UILayout

    def draw(self, context: bpy.types.Context) -> None:
        """Draws button or progress, then the settings that matter most."""
        layout = self.layout
        settings = context.scene.lightkiln
        if session.running is not None:
            _draw_progress(layout, session.running)
        else:
            row = layout.row()
            row.scale_y = 1.4
            row.operator("lightkiln.bake", icon="RENDER_STILL")
            if session.failure:
                _wrapped(layout, session.failure, "ERROR", context)
            elif settings.summary:
                layout.label(text=settings.summary, icon="CHECKMARK")
        if settings.image is not None or settings.view != "ORIGINAL":
            _draw_result(layout, settings)
            _draw_relight(layout, settings, context)


class _SettingsPanel:
    """What is baked, how well, and where to."""

    bl_label = "Settings"
    layout: bpy.types.UILayout

    def draw(self, context: bpy.types.Context) -> None:
        """Draws the settings."""
        layout = self.layout
        layout.use_property_split, layout.use_property_decorate = True, False
        layout.enabled = session.running is None
        settings = context.scene.lightkiln
        column = layout.column()
        column.prop(settings, "preset")
        column.prop(settings, "error")
        _wrapped(column, "There are no samples and no denoiser: the error is what you choose", "INFO", context)
        column.prop(settings, "progressive")
        column = layout.column()
        column.prop(settings, "density")
        column.prop(settings, "resolution_limit")
        column.operator("lightkiln.checker", depress=overlay_is_on())
        column = layout.column()
        column.prop(settings, "light")
        row = column.row()
        row.enabled = settings.light == "combined"
        row.prop(settings, "groups")
        column = layout.column()
        column.prop(settings, "scope")
        if settings.scope == "COLLECTION":
            column.prop(settings, "collection")
        column.prop(settings, "shared")
        column.operator("lightkiln.make_copies")
        if copies.collection_of(context.scene) is not None:
            column.operator("lightkiln.restore_originals")
        column = layout.column()
        column.prop(settings, "storage")
        column.prop(settings, "write_glb")
        if settings.storage == "FILE" or settings.write_glb:
            column.prop(settings, "folder")


class _NotesPanel:
    """What the last bake approximated or skipped."""

    bl_label = "Notes"
    layout: bpy.types.UILayout
    bl_options = {"DEFAULT_CLOSED"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Only if there is something to say."""
        return bool(context.scene.lightkiln.notes)

    def draw_header_preset(self, context: bpy.types.Context) -> None:
        """Shows how many there are."""
        self.layout.label(text=str(len(context.scene.lightkiln.notes)))

    def draw(self, context: bpy.types.Context) -> None:
        """Lists them."""
        notes = context.scene.lightkiln.notes
        for kind, title, icon in (("APPROXIMATED", "Approximated", "MATERIAL"), ("WARNING", "Warnings", "ERROR")):
            listed = [note for note in notes if note.kind == kind]
            if listed:
                self.layout.label(text=title, icon=icon)
            for note in listed[:MOST_NOTES]:
                _wrapped(self.layout.box(), f"{note.place}: {note.message}", "NONE", context)
            if len(listed) > MOST_NOTES:
                self.layout.label(text=f"and {len(listed) - MOST_NOTES} more")


def _draw_progress(layout: bpy.types.UILayout, running: session.Session) -> None:
    progress = running.bake.progress
    layout.progress(factor=progress.done, type="BAR", text=session.status(running.bake).removeprefix("Lightkiln: "))
    layout.operator("lightkiln.cancel", icon="CANCEL")


def _draw_result(layout: bpy.types.UILayout, settings: bpy.types.PropertyGroup) -> None:
    row = layout.row(align=True)
    for view, text in (("LIT", "Lit"), ("LIGHT", "Light Only"), ("ORIGINAL", "Original")):
        row.operator("lightkiln.view", text=text, depress=settings.view == view).view = view
    row = layout.row(align=True)
    row.operator("lightkiln.compare", icon="ARROW_LEFTRIGHT")
    row.operator("lightkiln.detach", icon="UNLINKED")
    row.operator("lightkiln.remove", text="Remove", icon="TRASH")
    row = layout.row(align=True)
    row.operator("lightkiln.export_glb", icon="EXPORT")
    row.operator("lightkiln.export_usd", icon="EXPORT")


def _draw_relight(layout: bpy.types.UILayout, settings: bpy.types.PropertyGroup, context: bpy.types.Context) -> None:
    """The switch and the button, and what only a bake can bring."""
    if not settings.solution:
        return
    if relit.solution(context.scene) is None:
        text = f"The light groups in {settings.solution} are gone: bake again to relight"
        _wrapped(layout, text, "INFO", context)
        return
    row = layout.row(align=True)
    row.prop(settings, "live", toggle=True, icon="LIGHT")
    row.operator("lightkiln.relight", icon="FILE_REFRESH")
    if live.running is not None and live.running.is_working:
        layout.label(text="Relighting …", icon="SORTTIME")
    if live.failure:
        _wrapped(layout, live.failure, "ERROR", context)
    lines = settings.stale.splitlines()
    if lines:
        box = layout.box()
        box.label(text="Needs a bake", icon="ERROR")
        for line in lines[:MOST_STALE]:
            _wrapped(box, line[:1].upper() + line[1:], "NONE", context)
        if len(lines) > MOST_STALE:
            box.label(text=f"and {len(lines) - MOST_STALE} more")


def _wrapped(layout: bpy.types.UILayout, text: str, icon: str, context: bpy.types.Context) -> None:
    """Text in as many lines as the region's width asks for."""
    width = max(int((context.region.width if context.region else 300) / 8 / context.preferences.view.ui_scale), 20)
    line = ""
    lines = []
    for word in text.split():
        if len(line) + len(word) + 1 > width and line:
            lines.append(line)
            line = ""
        line = f"{line} {word}".strip()
    column = layout.column(align=True)
    for i, part in enumerate([*lines, line]):
        column.label(text=part, icon=icon if i == 0 else ("NONE" if icon == "NONE" else "BLANK1"))


def overlay_is_on() -> bool:
    """True if the density overlay is shown."""
    from . import overlay

    return overlay.is_on()


class _InRender:
    bl_space_type = "PROPERTIES"
    bl_region_type = "WINDOW"
    bl_context = "render"


class _InSidebar:
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "Lightkiln"


class LIGHTKILN_PT_render(_InRender, _BakePanel, bpy.types.Panel):
    """The bake in the render properties."""

    bl_idname = "LIGHTKILN_PT_render"
    bl_options = {"DEFAULT_CLOSED"}


class LIGHTKILN_PT_render_settings(_InRender, _SettingsPanel, bpy.types.Panel):
    """Its settings."""

    bl_parent_id = "LIGHTKILN_PT_render"


class LIGHTKILN_PT_render_notes(_InRender, _NotesPanel, bpy.types.Panel):
    """Its notes."""

    bl_parent_id = "LIGHTKILN_PT_render"


class LIGHTKILN_PT_sidebar(_InSidebar, _BakePanel, bpy.types.Panel):
    """The bake in the sidebar."""

    bl_idname = "LIGHTKILN_PT_sidebar"


class LIGHTKILN_PT_sidebar_settings(_InSidebar, _SettingsPanel, bpy.types.Panel):
    """Its settings."""

    bl_parent_id = "LIGHTKILN_PT_sidebar"


class LIGHTKILN_PT_sidebar_notes(_InSidebar, _NotesPanel, bpy.types.Panel):
    """Its notes."""

    bl_parent_id = "LIGHTKILN_PT_sidebar"


class LIGHTKILN_PT_object(bpy.types.Panel):
    """How one object is baked."""

    bl_label = "Lightkiln"
    bl_space_type = "PROPERTIES"
    bl_region_type = "WINDOW"
    bl_context = "object"
    bl_options = {"DEFAULT_CLOSED"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Objects that have surfaces, and lamps."""
        kinds = {"MESH", "CURVE", "SURFACE", "FONT", "META", "LIGHT"}
        return context.object is not None and context.object.type in kinds

    def draw(self, context: bpy.types.Context) -> None:
        """Draws the object's settings."""
        layout = self.layout
        layout.use_property_split, layout.use_property_decorate = True, False
        settings = context.object.lightkiln
        if context.object.type == "LIGHT":
            layout.prop(settings, "group")
            return
        layout.prop(settings, "casts_shadow")
        layout.prop(settings, "group")
        if context.object.type != "MESH":
            layout.label(text="Only meshes get a lightmap", icon="INFO")
            layout.operator("lightkiln.make_copies")
            return
        layout.prop(settings, "exclude")
        column = layout.column()
        column.active = not settings.exclude
        column.prop(settings, "density")
        column.prop(settings, "uv_map", icon="GROUP_UVS")


CLASSES = (
    LIGHTKILN_PT_render,
    LIGHTKILN_PT_render_settings,
    LIGHTKILN_PT_render_notes,
    LIGHTKILN_PT_sidebar,
    LIGHTKILN_PT_sidebar_settings,
    LIGHTKILN_PT_sidebar_notes,
    LIGHTKILN_PT_object,
)


def register() -> None:
    """Registers the panels."""
    for cls in CLASSES:
        bpy.utils.register_class(cls)


def unregister() -> None:
    """Removes them."""
    for cls in reversed(CLASSES):
        bpy.utils.unregister_class(cls)
