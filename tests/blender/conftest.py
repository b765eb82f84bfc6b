"""Runs the add-on inside the `bpy` module: one empty file per test, with the add-on registered."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from pathlib import Path

import bpy
import pytest

import blender_addon
from baker import program


@pytest.fixture(autouse=True)
def empty_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[bpy.types.Scene]:
    """An empty file, and the add-on with the baker that was built."""
    monkeypatch.setenv("LIGHTKILN_BIN", str(program()))
    bpy.ops.wm.read_factory_settings(use_empty=True)
    blender_addon.register()
    scene = bpy.context.scene
    scene.lightkiln.storage = "PACKED"
    scene.lightkiln.folder = str(tmp_path / "lightmaps")
    yield scene
    blender_addon.unregister()


def pytest_unconfigure() -> None:
    """Leaves at once: some versions of bpy hang when Python shuts down."""
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(_status)


_status = 1


def pytest_sessionfinish(exitstatus: int) -> None:
    """Remembers how the tests ended."""
    global _status
    _status = int(exitstatus)
