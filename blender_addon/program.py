# SPDX-License-Identifier: GPL-3.0-or-later
"""Finds the baker: the user's choice, the program in the add-on's bin/, or the one on the path; checks its version."""

from __future__ import annotations

import os
import re
import shutil
import stat
import subprocess
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import bpy

from .errors import BakeError

NAME = "lightkiln.exe" if os.name == "nt" else "lightkiln"
# Versions of the baker whose command line this add-on speaks.
SPOKEN = re.compile(r"lightkiln (0\.1\.\d+\S*)")
NO_WINDOW = getattr(subprocess, "CREATE_NO_WINDOW", 0)


@dataclass(frozen=True)
class Found:
    """The result of a search, for the preferences."""

    text: str
    usable: bool


def find() -> Path:
    """The baker to run. Raises BakeError if there is none, or if it is not one that the add-on understands."""
    from . import preferences

    chosen = preferences.override() or os.environ.get("LIGHTKILN_BIN", "")
    if chosen:
        path = Path(bpy.path.abspath(chosen))
        if not path.is_file():
            raise BakeError(f"The baker `{path}` does not exist: correct its path in the add-on's preferences")
    else:
        path = _bundled() or _on_path()
    fault = _fault(str(path), path.stat().st_mtime_ns)
    if fault:
        raise BakeError(fault)
    return path


def describe() -> Found:
    """What `find` would find, in words."""
    try:
        path = find()
    except BakeError as error:
        return Found(str(error), usable=False)
    return Found(str(path), usable=True)


def _bundled() -> Path | None:
    """The program that came with the add-on, made executable: installing from a zip loses the permission."""
    path = Path(__file__).parent / "bin" / NAME
    if not path.is_file():
        return None
    if os.access(path, os.X_OK):
        return path
    try:
        path.chmod(path.stat().st_mode | stat.S_IXUSR | stat.S_IXGRP | stat.S_IXOTH)
        return path
    except OSError:
        # The add-on may lie in a folder that the user cannot change; a copy can lie where extensions keep their files.
        folder = Path(bpy.utils.extension_path_user(__package__, path="bin", create=True))
        copy = folder / NAME
        if not copy.is_file() or copy.stat().st_size != path.stat().st_size:
            shutil.copyfile(path, copy)
        copy.chmod(0o755)
        return copy


def _on_path() -> Path:
    program = shutil.which(NAME)
    if program is None:
        raise BakeError(
            "There is no baker: install the zip for this platform, or choose a lightkiln program in the preferences"
        )
    return Path(program)


@lru_cache(maxsize=8)
def _fault(path: str, changed: int) -> str | None:
    """Why the program at `path`, last changed at `changed`, cannot be used; none if it can."""
    choose = "choose another one in the add-on's preferences"
    try:
        done = subprocess.run(
            [path, "--version"], capture_output=True, text=True, timeout=20, check=False, creationflags=NO_WINDOW
        )
    except (OSError, subprocess.SubprocessError) as error:
        return f"The baker `{path}` does not start ({error}): {choose}"
    if not SPOKEN.match(done.stdout.strip()):
        return f"`{path}` is `{done.stdout.strip()[:60]}`, not a baker of version 0.1: {choose}"
    return None
