# SPDX-License-Identifier: GPL-3.0-or-later
"""Operators: bake, cancel, and what can be done with a lightmap. All work headless and can be undone."""

from collections.abc import Callable
from pathlib import Path

import bpy

from . import apply, engine_export, live, receivers, relit, session
from .errors import BakeError, Cancelled


class LIGHTKILN_OT_bake(bpy.types.Operator):
    """Bake the light of the scene into a lightmap and show it"""

    bl_idname = "lightkiln.bake"
    bl_label = "Bake Lightmap"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """One bake at a time."""
        cls.poll_message_set("A bake is running")
        return session.running is None

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Asks before meshes are made single-user, then bakes while the user works on."""
        scene = context.scene
        if scene.lightkiln.shared == "SINGLE_USER":
            try:
                objects = receivers.candidates(scene, context.view_layer)
            except BakeError as error:
                self.report({"ERROR"}, str(error))
                return {"CANCELLED"}
            shared = receivers.shared_meshes(list(objects.values()))
            if shared:
                names = ", ".join(ob.name for ob in shared[:3]) + (" …" if len(shared) > 3 else "")
                return context.window_manager.invoke_confirm(
                    self,
                    event,
                    title="Make Meshes Single User?",
                    message=f"{len(shared)} objects get a mesh of their own: {names}",
                )
        return self.execute(context)

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Bakes: to the end without a window, else in the background."""
        live.stop()
        try:
            if bpy.app.background or not context.window_manager.windows:
                self.report({"INFO"}, session.run_blocking(context.scene, context.view_layer))
            else:
                session.start(context.scene, context.view_layer, progressive=True)
                session.run_in_window()
        except BakeError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        return {"FINISHED"}


class LIGHTKILN_OT_cancel(bpy.types.Operator):
    """End the bake that is running; nothing is changed"""

    bl_idname = "lightkiln.cancel"
    bl_label = "Cancel"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """There must be a bake."""
        return session.running is not None

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Asks the baker to end."""
        session.cancel()
        return {"FINISHED"}


class LIGHTKILN_OT_relight(bpy.types.Operator):
    """Show the lightmap in the light that lamps, world and emissive materials give now, without a bake"""

    bl_idname = "lightkiln.relight"
    bl_label = "Relight"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """There must be light groups of a bake, and no bake may be running."""
        cls.poll_message_set("Switch on Light Groups and bake")
        return session.running is None and relit.solution(context.scene) is not None

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Relights: to the end without a window, else in the background."""
        try:
            if bpy.app.background or not context.window_manager.windows:
                work = live.relight_blocking(context.scene, context.view_layer)
                if work.stale:
                    self.report({"WARNING"}, f"Needs a bake: {'; '.join(work.stale)}")
                else:
                    self.report({"INFO"}, "The lightmap shows the lights as they are")
            else:
                live.stop()
                live.begin(context.scene, context.view_layer, anyway=True)
        except Cancelled:
            return {"CANCELLED"}
        except BakeError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        return {"FINISHED"}


class LIGHTKILN_OT_report(bpy.types.Operator):
    """Show a message of a bake that ran in the background"""

    bl_idname = "lightkiln.report"
    bl_label = "Lightkiln"
    bl_options = {"INTERNAL"}

    message: bpy.props.StringProperty()

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Reports it."""
        self.report({"WARNING"}, self.message)
        return {"FINISHED"}


class _OnLightmap:
    """An operator on the lightmap that the scene has."""

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """The scene must have a lightmap, and no bake may be running."""
        settings = context.scene.lightkiln
        # The user may have deleted the image; what shows it can still be removed.
        return session.running is None and (settings.image is not None or settings.view != "ORIGINAL")


class LIGHTKILN_OT_view(_OnLightmap, bpy.types.Operator):
    """Choose what the viewport shows"""

    bl_idname = "lightkiln.view"
    bl_label = "Show"
    bl_options = {"REGISTER", "UNDO"}

    view: bpy.props.EnumProperty(
        items=[
            ("LIT", "Lit", "The surfaces in the light that was baked"),
            ("LIGHT", "Light Only", "The light alone, on grey surfaces"),
            ("ORIGINAL", "Original", "The original materials; the lightmap is kept"),
        ]
    )

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Shows it."""
        apply.set_view(context.scene, self.view)
        return {"FINISHED"}


class LIGHTKILN_OT_compare(_OnLightmap, bpy.types.Operator):
    """Switch between the lightmap and the original materials"""

    bl_idname = "lightkiln.compare"
    bl_label = "Compare"
    bl_options = {"REGISTER", "UNDO"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Switches."""
        apply.set_view(context.scene, "LIT" if context.scene.lightkiln.view == "ORIGINAL" else "ORIGINAL")
        return {"FINISHED"}


class LIGHTKILN_OT_remove(_OnLightmap, bpy.types.Operator):
    """Remove the lightmap, its materials and the UV maps that were made for it; files on disk stay"""

    bl_idname = "lightkiln.remove"
    bl_label = "Remove Lightmap"
    bl_options = {"REGISTER", "UNDO"}

    keep_maps: bpy.props.BoolProperty(name="Keep UV Maps", default=False)

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Removes it."""
        apply.remove(context.scene, keep_maps=self.keep_maps)
        relit.forget(context.scene)
        context.scene.lightkiln.summary = ""
        return {"FINISHED"}


class LIGHTKILN_OT_detach(_OnLightmap, bpy.types.Operator):
    """Turn the lit materials into ordinary ones that the add-on no longer manages"""

    bl_idname = "lightkiln.detach"
    bl_label = "Detach"
    bl_options = {"REGISTER", "UNDO"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Detaches them."""
        apply.detach(context.scene)
        relit.forget(context.scene)
        context.scene.lightkiln.summary = ""
        return {"FINISHED"}


class LIGHTKILN_OT_export_glb(_OnLightmap, bpy.types.Operator):
    """Write the scene with its lightmap as a glTF file for engines, and the lightmap as an EXR, to the output folder"""

    bl_idname = "lightkiln.export_glb"
    bl_label = "Export Lit GLB"

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Writes them."""
        return _exported(self, context, lambda scene, layer: engine_export.write_glb(scene, layer)[0])


class LIGHTKILN_OT_export_usd(_OnLightmap, bpy.types.Operator):
    """Write the scene as USD with a layer that shows its lightmap, and the lightmap as an EXR, to the output folder"""

    bl_idname = "lightkiln.export_usd"
    bl_label = "Export USD"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """This Blender must have USD."""
        if not engine_export.has_usd():
            cls.poll_message_set("This Blender has no USD, or no Python module for it")
            return False
        return super().poll(context)

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Writes them."""
        return _exported(self, context, engine_export.write_usd)


def _exported(
    operator: bpy.types.Operator,
    context: bpy.types.Context,
    write: Callable[[bpy.types.Scene, bpy.types.ViewLayer], list[Path]],
) -> set[str]:
    """Writes files and reports them."""
    if context.scene.lightkiln.image is None:
        operator.report({"ERROR"}, "The lightmap's image was deleted: bake again")
        return {"CANCELLED"}
    try:
        files = write(context.scene, context.view_layer)
    except (BakeError, OSError) as error:
        operator.report({"ERROR"}, str(error))
        return {"CANCELLED"}
    operator.report({"INFO"}, f"Wrote {', '.join(file.name for file in files)} to {files[0].parent}")
    return {"FINISHED"}


CLASSES = (
    LIGHTKILN_OT_export_glb,
    LIGHTKILN_OT_export_usd,
    LIGHTKILN_OT_bake,
    LIGHTKILN_OT_cancel,
    LIGHTKILN_OT_relight,
    LIGHTKILN_OT_report,
    LIGHTKILN_OT_view,
    LIGHTKILN_OT_compare,
    LIGHTKILN_OT_remove,
    LIGHTKILN_OT_detach,
)


def register() -> None:
    """Registers the operators."""
    for cls in CLASSES:
        bpy.utils.register_class(cls)


def unregister() -> None:
    """Removes them."""
    for cls in reversed(CLASSES):
        bpy.utils.unregister_class(cls)
