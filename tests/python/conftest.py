"""Fixtures: one bake of each bundled scene per test run."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from baker import Bake, bake

BakeOnce = Callable[[str], Bake]


@pytest.fixture(scope="session")
def baked(tmp_path_factory: pytest.TempPathFactory) -> BakeOnce:
    """Bakes a bundled scene on first use, on two threads."""
    bakes: dict[str, Bake] = {}

    def get(scene: str) -> Bake:
        if scene not in bakes:
            folder: Path = tmp_path_factory.mktemp(scene)
            bakes[scene] = bake(scene, folder, "--threads", "2", "--force")
        return bakes[scene]

    return get
