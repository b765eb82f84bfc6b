"""Every bundled scene bakes: finite and plausible irradiance, the same bits on one thread and on two."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from baker import BUNDLED, bake
from conftest import BakeOnce
from lightmap import read_page

# Mean irradiance over lit texels, W/m², with room for other texel densities: the lamp's 47 W over the walls of the
# Cornell box, sun and sky on the house, torches and dusk in the dungeon.
MEAN_RANGE = {"cornell_box": (0.2, 2.0), "house": (0.8, 5.0), "dungeon": (0.2, 8.0)}


@pytest.mark.parametrize("scene", BUNDLED)
def test_pages_are_finite_and_plausible(scene: str, baked: BakeOnce) -> None:
    pages = [read_page(p) for p in baked(scene).pages]
    assert pages
    for page in pages:
        assert np.isfinite(page).all()
        assert (page >= 0).all()
    green = np.concatenate([page[..., 1].ravel() for page in pages])
    low, high = MEAN_RANGE[scene]
    assert low < green[green > 0].mean() < high


@pytest.mark.parametrize("scene", BUNDLED)
def test_one_thread_gives_the_same_bits(scene: str, baked: BakeOnce, tmp_path: Path) -> None:
    two = baked(scene)
    one = bake(scene, tmp_path, "--threads", "1")
    assert [p.name for p in one.pages] == [p.name for p in two.pages]
    for a, b in zip(one.pages, two.pages, strict=True):
        assert (read_page(a) == read_page(b)).all(), a.name


def test_report_counts_what_was_baked(baked: BakeOnce) -> None:
    report = baked("cornell_box").report
    assert report["schema"].startswith("lightkiln-report/")
    assert report["scene"]["triangles"] == 30
    assert report["scene"]["lights"] == 1
    assert report["atlas"]["texels"] > 0
    assert {stage["stage"] for stage in report["stages"]} >= {"import", "solve", "gather"}
    folder = baked("cornell_box").folder
    assert all((folder / name).is_file() for name in report["outputs"])


def test_red_wall_colours_its_neighbours(baked: BakeOnce) -> None:
    """Light that bounced off the red wall is redder than what bounced off the green one."""
    page = read_page(baked("cornell_box").pages[0])
    lit = page[page[..., 1] > 0]
    redness = lit[:, 0] / lit[:, 1]
    assert redness.max() > 1.3 * redness.min()
