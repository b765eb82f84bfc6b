"""Runs the baker as a user does: the built program, a scene, a folder for the results."""

from __future__ import annotations

import json
import os
import subprocess
from dataclasses import dataclass
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
SCENES = ROOT / "scenes"

# Flags that make each bundled scene a bake of seconds. The Cornell box has its own lightmap layout.
QUICK_FLAGS = {
    "cornell_box": ["--uv", "keep", "--resolution", "256"],
    "house": ["--texels-per-metre", "4"],
    "dungeon": ["--texels-per-metre", "3"],
}
BUNDLED = sorted(QUICK_FLAGS)


@dataclass(frozen=True)
class Bake:
    """The folder that a bake wrote."""

    folder: Path
    scene: str

    @property
    def pages(self) -> list[Path]:
        """The lightmap pages in order."""
        return sorted(self.folder.glob("lightmap_*.exr"), key=lambda p: int(p.stem.split("_")[1]))

    @property
    def lit_glb(self) -> Path:
        """The scene that shows its lightmap."""
        return self.folder / f"{self.scene}.lit.glb"

    @property
    def report(self) -> dict[str, Any]:
        """The report."""
        report: dict[str, Any] = json.loads((self.folder / "report.json").read_text())
        return report


def program() -> Path:
    """The baker: LIGHTKILN_BIN, or the release build."""
    name = "lightkiln.exe" if os.name == "nt" else "lightkiln"
    return Path(os.environ.get("LIGHTKILN_BIN", ROOT / "target" / "release" / name))


def run(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
    """Runs the baker to its end, whatever its exit code."""
    return subprocess.run([program(), *arguments], capture_output=True, text=True, check=False, timeout=900)


def bake(scene: str, folder: Path, *flags: str) -> Bake:
    """Bakes a bundled scene quickly. Fails the test, with the baker's message, if the baker fails."""
    done = run("bake", SCENES / f"{scene}.glb", "--out", folder, *QUICK_FLAGS[scene], *flags)
    assert done.returncode == 0, done.stderr
    return Bake(folder, scene)
