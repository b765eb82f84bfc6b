"""Finds the baker: LIGHTKILN_BIN, or the release build of this repository."""

from __future__ import annotations

import os
from pathlib import Path

_NAME = "lightkiln.exe" if os.name == "nt" else "lightkiln"
os.environ.setdefault("LIGHTKILN_BIN", str(Path(__file__).resolve().parents[2] / "target" / "release" / _NAME))
