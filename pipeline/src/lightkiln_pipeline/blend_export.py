"""Runs inside a Python with `bpy`, as a script: exports a .blend through the add-on's exporter.

    python blend_export.py SCENE.blend TARGET.glb FOLDER_OF_THE_ADDON TEXELS_PER_METRE

Prints one JSON object with the page's side and the notes, or the error. TEXELS_PER_METRE 0: as the file says.
"""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path
from typing import Any


def _leave(answer: dict[str, Any]) -> None:
    """Ends at once: some versions of bpy hang when Python shuts down."""
    print(json.dumps({"lightkiln": answer}), flush=True)
    os._exit(0)


def main(scene: str, target: str, addon: str, density: str) -> None:
    """Exports one file."""
    sys.path.insert(0, addon)
    try:
        import blender_addon
        import bpy
        from blender_addon.bake import Bake
        from blender_addon.errors import BakeError
    except ImportError as error:
        print(error, file=sys.stderr, flush=True)
        os._exit(3)
    bpy.ops.wm.read_factory_settings(use_empty=True)
    blender_addon.register()
    try:
        bpy.ops.wm.open_mainfile(filepath=scene, load_ui=False)
        settings = bpy.context.scene.lightkiln
        if float(density) > 0:
            settings.density = float(density)
        bake = Bake(bpy.context.scene, bpy.context.view_layer, progressive=False)
        side = bake.export(Path(target))
    except (BakeError, RuntimeError) as error:
        _leave({"error": str(error).strip()})
    _leave({"side": side, "notes": [[note.place, note.message] for note in bake.notes]})


if __name__ == "__main__":
    main(*sys.argv[1:5])
