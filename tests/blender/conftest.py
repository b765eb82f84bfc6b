"""Runs the add-on inside the `bpy` module: one empty file per test, with the add-on registered."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "tests" / "python")]

import bpy  # noqa: E402 (Blender's modules want the path as it will be)

import blender_addon  # noqa: E402
from baker import program  # noqa: E402


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
