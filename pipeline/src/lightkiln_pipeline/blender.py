"""Scenes of Blender: a .blend file → the GLB that the add-on's exporter makes of it, by a Python that has `bpy`.

That Python is named in LIGHTKILN_BPY_PYTHON, else it is this one. The add-on's folder is named in LIGHTKILN_ADDON,
else it lies beside this package's source. The .blend is read and never saved.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

from .errors import EnvironmentFault, Note, PipelineError

_SCRIPT = Path(__file__).with_name("blend_export.py")
# Exit code of the script if bpy or the add-on cannot be loaded.
NO_BLENDER = 3
_SECONDS = 3600


@dataclass(frozen=True)
class BlendExport:
    """A .blend that was exported."""

    side: int
    """Width and height of the lightmap's page, texels; its coordinates are in TEXCOORD_1."""
    notes: list[Note]


def export_blend(scene: Path, glb: Path, texels_per_metre: float | None) -> BlendExport:
    """Writes the GLB, and the picture of the world beside it. Raises PipelineError with Blender's reason."""
    python = os.environ.get("LIGHTKILN_BPY_PYTHON", sys.executable)
    command = [python, str(_SCRIPT), str(scene), str(glb), str(addon_folder().parent), str(texels_per_metre or 0)]
    try:
        done = subprocess.run(command, capture_output=True, text=True, encoding="utf-8", timeout=_SECONDS, check=False)
    except (OSError, subprocess.TimeoutExpired) as error:
        raise EnvironmentFault(f"Blender's Python `{python}` cannot be used: {error}") from error
    answer = next((line for line in reversed(done.stdout.splitlines()) if line.startswith('{"lightkiln"')), None)
    if done.returncode == NO_BLENDER:
        words = (done.stderr.strip().splitlines() or ["no reason given"])[-1]
        remedy = "pip install bpy, or name a Python that has it in LIGHTKILN_BPY_PYTHON"
        raise EnvironmentFault(f".blend files need Blender as a module: {words}; {remedy}")
    if answer is None:
        words = (done.stderr.strip().splitlines() or [f"exit code {done.returncode}"])[-1]
        raise PipelineError(f"Blender could not export it: {words}")
    result = json.loads(answer)["lightkiln"]
    if "error" in result:
        raise PipelineError(str(result["error"]))
    return BlendExport(int(result["side"]), [Note(str(place), str(text)) for place, text in result["notes"]])


def addon_folder() -> Path:
    """The add-on's folder. Raises EnvironmentFault if it is not there."""
    named = os.environ.get("LIGHTKILN_ADDON")
    folder = Path(named) if named else Path(__file__).resolve().parents[3] / "blender_addon"
    if not (folder / "blender_manifest.toml").is_file():
        raise EnvironmentFault(f"the Blender add-on is not at {folder}; name its folder in LIGHTKILN_ADDON")
    return folder
