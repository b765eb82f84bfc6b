"""Runs the batch's commands on a small show: manifests, scenes, JSON lines."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

from stages import FLOOR, write_stage

ROOT = Path(__file__).resolve().parents[2]
MANIFEST = """
out = "baked"
jobs = 2
[[assets]]
scenes = ["*.usda", "kit/*.glb"]
error = "10%"
texels_per_metre = 20
"""
LAMP = """
def SphereLight "Lamp" {
    float inputs:intensity = 100
    double3 xformOp:translate = (0, 2, 0)
    uniform token[] xformOpOrder = ["xformOp:translate"]
}
"""


def command(*arguments: str | Path) -> list[str]:
    """The batch's command line."""
    return [sys.executable, "-c", "from lightkiln_pipeline.batch.cli import main; main()", *map(str, arguments)]


def batch(*arguments: str | Path, expect: int = 0) -> list[dict[str, Any]]:
    """Runs to the end; the JSON lines."""
    done = subprocess.run(command(*arguments), capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == expect, done.stderr
    return [json.loads(line) for line in done.stdout.splitlines() if line.startswith("{")]


def states(events: list[dict[str, Any]]) -> dict[str, str]:
    """The last state of every asset."""
    return {e["name"]: e["state"] for e in events if e["event"] == "asset"}


def write_show(folder: Path) -> Path:
    """A manifest with three USD scenes, two of which share a layer, and a GLB."""
    write_stage(folder / "shared" / "floor.usda", FLOOR)
    for name in ("one", "two"):
        write_stage(folder / f"{name}.usda", f'def Xform "F" (references = @./shared/floor.usda@) {{ }}\n{LAMP}')
    write_stage(folder / "three.usda", FLOOR + LAMP)
    (folder / "kit").mkdir()
    (folder / "kit" / "box.glb").write_bytes((ROOT / "scenes/kaykit/box_small.gltf.glb").read_bytes())
    path = folder / "batch.toml"
    path.write_text(MANIFEST)
    return path


ALL = {"one", "two", "three", "kit/box"}


def openjd(folder: Path, *arguments: str | Path) -> str:
    """Runs Open Job Description's command line with the batch's command on its path, made in `folder`; what it says."""
    launcher = folder / "bin" / "lightkiln-batch"
    launcher.parent.mkdir(exist_ok=True)
    launcher.write_text(f"#!{sys.executable}\nfrom lightkiln_pipeline.batch.cli import main\nmain()\n")
    launcher.chmod(0o755)
    environment = {**os.environ, "PATH": f"{launcher.parent}{os.pathsep}{os.environ['PATH']}"}
    words = [sys.executable, "-m", "openjd", *map(str, arguments)]
    done = subprocess.run(words, capture_output=True, text=True, env=environment, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout
