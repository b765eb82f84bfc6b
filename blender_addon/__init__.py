# SPDX-License-Identifier: GPL-3.0-or-later
"""Lightkiln for Blender: bakes lightmaps with the lightkiln program and shows them on the objects."""

from . import copies, live, operators, overlay, panels, preferences, properties, session

_MODULES = (preferences, properties, session, live, operators, copies, overlay, panels)


def register() -> None:
    """Registers everything."""
    for module in _MODULES:
        module.register()


def unregister() -> None:
    """Removes everything, the last first."""
    for module in reversed(_MODULES):
        module.unregister()
