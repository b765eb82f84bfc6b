"""Runs the Node scripts of tests/web. The packages they need are where NODE_PATH or .deps/npm says."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
from pathlib import Path
from typing import Any

from baker import ROOT

WEB = ROOT / "tests" / "web"
PACKAGES = ROOT / ".deps" / "npm" / "node_modules"


def run_script(name: str, *arguments: str | Path) -> Any:
    """Runs a script and returns the JSON that it prints."""
    environment = {**os.environ, "NODE_PATH": os.environ.get("NODE_PATH", str(PACKAGES))}
    command = ["node", WEB / name, *arguments]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=300, env=environment)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def chromium() -> str | None:
    """The browser's program, if there is one."""
    names = ("chromium", "chromium-browser", "google-chrome")
    return os.environ.get("CHROMIUM") or next((p for p in map(shutil.which, names) if p), None)
