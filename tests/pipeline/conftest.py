"""Finds the package's source and the baker: LIGHTKILN_BIN, or the release build of this repository."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from batches import write_show

_ROOT = Path(__file__).resolve().parents[2]
_NAME = "lightkiln.exe" if os.name == "nt" else "lightkiln"
os.environ.setdefault("LIGHTKILN_BIN", str(_ROOT / "target" / "release" / _NAME))
# For the processes that tests start; pytest itself has it from pipeline/pyproject.toml.
_PATHS = [str(_ROOT / "pipeline" / "src"), *filter(None, [os.environ.get("PYTHONPATH")])]
os.environ["PYTHONPATH"] = os.pathsep.join(_PATHS)


@pytest.fixture
def show(tmp_path: Path) -> Path:
    """A manifest with small scenes."""
    return write_show(tmp_path)
