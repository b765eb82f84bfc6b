"""The Khronos validator finds no error in any bundled scene, as it is and lit."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from baker import BUNDLED, SCENES
from conftest import BakeOnce
from node import run_script


def errors(path: Path) -> list[str]:
    """The validator's errors, each with its place in the file."""
    report: dict[str, Any] = run_script("validate.cjs", path)[str(path)]
    messages: list[dict[str, Any]] = report["issues"]["messages"]
    found = [f"{m['code']} at {m.get('pointer', '?')}: {m['message']}" for m in messages if m["severity"] == 0]
    assert len(found) == report["issues"]["numErrors"]
    return found


@pytest.mark.parametrize("scene", BUNDLED)
def test_bundled_scene_is_valid(scene: str) -> None:
    assert errors(SCENES / f"{scene}.glb") == []


@pytest.mark.parametrize("scene", BUNDLED)
def test_lit_glb_is_valid(scene: str, baked: BakeOnce) -> None:
    assert errors(baked(scene).lit_glb) == []


def test_the_check_sees_an_error(tmp_path: Path) -> None:
    broken = tmp_path / "broken.glb"
    broken.write_bytes((SCENES / "cornell_box.glb").read_bytes().replace(b'"scene":0', b'"scene":9'))
    assert errors(broken) != []
