# SPDX-License-Identifier: GPL-3.0-or-later
"""From Blender's evaluated scene to a GLB with LIGHTKILN_scene, which the baker reads."""
