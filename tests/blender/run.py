"""Runs the add-on's tests in the `bpy` module of one or more versions of Blender, which it installs.

    python3 tests/blender/run.py [VERSION...]        e.g. 4.2.23 4.5.15 5.0.1; 5.0.1 if none is given

In: Python 3.11 with pip, the baker in target/release (or in LIGHTKILN_BIN), and what `python3 tests/run.py` puts into
.deps/npm. Out: pytest's output per version; exit code 0 if all passed, 77 if `bpy` cannot be had on this machine.
Each version takes 1 GB in .deps/.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
NEWEST = "5.0.1"
SKIPPED = 77
# Libraries of the system that bpy links to, as Debian calls them.
LIBRARIES = "libgl1 libice6 libsm6 libx11-6 libxext6 libxfixes3 libxi6 libxkbcommon0 libxrender1 libxt6 libxxf86vm1"
# A test run takes a minute or two; one version of bpy may hang when it ends.
TIMEOUT = 1200


def environment(version: str) -> Path | None:
    """The Python of a virtual environment with that bpy, made on first use; none if it cannot be had."""
    folder = ROOT / ".deps" / f"bpy-{version}"
    python = folder / ("Scripts/python.exe" if os.name == "nt" else "bin/python")
    stamp = folder / ".installed"
    if not stamp.is_file():
        # Versions before 5.0 are built for the older NumPy.
        numpy = "numpy<2" if version.startswith("4.") else "numpy"
        subprocess.run([sys.executable, "-m", "venv", "--clear", "--without-pip", folder], check=True)
        pip = [sys.executable, "-m", "pip", "--python", str(python), "install", "--quiet"]
        if subprocess.run([*pip, f"bpy=={version}", numpy, "pytest==9.2.0"], check=False).returncode != 0:
            return None
        stamp.touch()
    return python if imports(python) or (install_libraries() and imports(python)) else None


def imports(python: Path) -> bool:
    """True if bpy starts there."""
    code = "import os, bpy; os._exit(0)"
    return subprocess.run([python, "-c", code], check=False, capture_output=True).returncode == 0


def install_libraries() -> bool:
    """Installs what bpy links to, where that is possible."""
    if not (shutil.which("apt-get") and hasattr(os, "geteuid") and os.geteuid() == 0):
        return False
    subprocess.run(["apt-get", "update", "--quiet"], check=False)
    command = ["apt-get", "install", "--yes", "--quiet", "--no-install-recommends", *LIBRARIES.split()]
    return subprocess.run(command, check=False).returncode == 0


def main() -> int:
    """Runs the tests in every version."""
    if sys.version_info[:2] != (3, 11):
        print(f"skipped: bpy needs Python 3.11, this is {sys.version.split()[0]}")
        return SKIPPED
    worst = 0
    for version in sys.argv[1:] or [NEWEST]:
        python = environment(version)
        if python is None:
            print(f"skipped: bpy {version} cannot be installed; on Debian it needs {LIBRARIES}")
            worst = worst or SKIPPED
            continue
        print(f"--- bpy {version}", flush=True)
        command = [
            str(python),
            "-m",
            "pytest",
            "-q",
            "-W",
            "ignore::DeprecationWarning",
            str(ROOT / "tests" / "blender"),
        ]
        worst = max(worst, subprocess.run(command, cwd=ROOT, check=False, timeout=TIMEOUT).returncode)
    return worst


if __name__ == "__main__":
    sys.exit(main())
