"""A browser shows the lit GLB right: what three.js draws is reflectance / π · E, with E from the EXR."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from conftest import BakeOnce
from glb import Glb
from lightmap import read_page
from node import chromium, run_script
from points import comparable_points

TOLERANCE = 0.03
POINTS = 24
# Points are compared where the brightest channel has at least this share of the page's range.
DIMMEST_SHARE = 0.1


def test_three_shows_reflectance_times_irradiance(baked: BakeOnce, tmp_path: Path) -> None:
    browser = chromium()
    if browser is None:
        pytest.fail("no Chromium: install it (`apt-get install chromium`) or name its program in CHROMIUM")
    bake = baked("cornell_box")
    page = read_page(bake.pages[0])
    lit = Glb.read(bake.lit_glb)

    candidates = comparable_points(lit, page, DIMMEST_SHARE * float(page.max()))
    points = candidates[:: max(1, len(candidates) // POINTS)]
    assert len(points) >= 10, "too few places to compare"
    probes = tmp_path / "probes.json"
    probes.write_text(json.dumps([{"point": p.position.tolist(), "normal": p.normal.tolist()} for p in points]))

    shown: dict[str, Any] = run_script("measure.cjs", browser, bake.lit_glb, probes, tmp_path)
    assert shown["lightmapped"] == 7, "every object of the Cornell box has a lightmap"
    measured = np.array(shown["radiance"])
    expected = np.array([p.reflectance * p.irradiance / np.pi for p in points])
    # The GLB's own lightmap has 8 bits per channel, so a value may be off by half a step.
    lightmaps = [
        m["extensions"]["MOZ_lightmap"] for m in lit.json["materials"] if "MOZ_lightmap" in m.get("extensions", {})
    ]
    half_step = 0.5 / 255 * max(lightmap["intensity"] for lightmap in lightmaps)
    allowed = TOLERANCE * expected + np.array([p.reflectance for p in points]) * half_step / np.pi
    off = np.abs(measured - expected) > allowed
    assert not off.any(), f"measured {measured[off]}, expected {expected[off]}"
