# SPDX-License-Identifier: GPL-3.0-or-later
"""The add-on's preferences: which baker runs."""

import bpy

from . import program


class LIGHTKILN_AP_preferences(bpy.types.AddonPreferences):
    """Preferences of the add-on."""

    bl_idname = __package__

    binary: bpy.props.StringProperty(
        name="Baker",
        description="Another lightkiln program to bake with. Empty: the one that came with the add-on",
        subtype="FILE_PATH",
    )

    def draw(self, context: bpy.types.Context) -> None:
        """Draws the path and what is found there."""
        layout = self.layout
        layout.prop(self, "binary")
        found = program.describe()
        layout.label(text=found.text, icon="CHECKMARK" if found.usable else "ERROR")


def override() -> str:
    """The path that the user chose, or nothing."""
    addon = bpy.context.preferences.addons.get(__package__)
    return addon.preferences.binary if addon else ""


def register() -> None:
    """Registers the preferences."""
    bpy.utils.register_class(LIGHTKILN_AP_preferences)


def unregister() -> None:
    """Removes the preferences."""
    bpy.utils.unregister_class(LIGHTKILN_AP_preferences)
