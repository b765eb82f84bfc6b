# SPDX-License-Identifier: GPL-3.0-or-later
"""Packs rectangles without turning them: sizes → lower left corners. Units are the caller's.

Based on: Jylänki, "A Thousand Ways to Pack the Bin", 2010: skyline, bottom left.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

Size = tuple[float, float]
Place = tuple[float, float]

# Above this many rectangles rows are nearly as dense and take linear time.
MOST_FOR_SKYLINE = 3000
# Steps by which a square grows until everything fits.
GROWTH = 1.03


def pack_square(sizes: Sequence[Size]) -> tuple[list[Place], float]:
    """Places in a square that is nearly as small as can be, and its side."""
    if not sizes:
        return [], 0.0
    side = max(math.sqrt(sum(w * h for w, h in sizes)), max(max(s) for s in sizes))
    while True:
        places = pack(sizes, side)
        if places is not None:
            return places, side
        side *= GROWTH


def pack(sizes: Sequence[Size], side: float) -> list[Place] | None:
    """Places in a square of the given side, or none if they do not fit."""
    limit = side * (1 + 1e-9)
    if any(w > limit or h > limit for w, h in sizes):
        return None
    order = sorted(range(len(sizes)), key=lambda i: (-sizes[i][1], -sizes[i][0], i))
    places = _rows(sizes, order, limit) if len(sizes) > MOST_FOR_SKYLINE else _skyline(sizes, order, limit)
    return places


def _rows(sizes: Sequence[Size], order: Sequence[int], side: float) -> list[Place] | None:
    places: list[Place] = [(0.0, 0.0)] * len(sizes)
    x = y = row = 0.0
    for i in order:
        width, height = sizes[i]
        if x + width > side:
            x, y, row = 0.0, y + row, 0.0
        if y + height > side:
            return None
        places[i] = (x, y)
        x, row = x + width, max(row, height)
    return places


def _skyline(sizes: Sequence[Size], order: Sequence[int], side: float) -> list[Place] | None:
    places: list[Place] = [(0.0, 0.0)] * len(sizes)
    # Steps of the skyline from left to right: where each starts, and its height.
    steps: list[Place] = [(0.0, 0.0)]
    for i in order:
        width, height = sizes[i]
        spot = _lowest(steps, width, height, side)
        if spot is None:
            return None
        first, x, y = spot
        places[i] = (x, y)
        steps = _raised(steps, first, x, x + width, y + height, side)
    return places


def _lowest(steps: list[Place], width: float, height: float, side: float) -> tuple[int, float, float] | None:
    """The step at which the rectangle's upper edge is lowest, and where the rectangle then lies."""
    best: tuple[int, float, float] | None = None
    for first, (x, _) in enumerate(steps):
        if x + width > side:
            break
        y, j = 0.0, first
        while j < len(steps) and steps[j][0] < x + width - 1e-12:
            y = max(y, steps[j][1])
            if best is not None and y >= best[2]:
                break
            j += 1
        if y + height <= side and (best is None or y < best[2]):
            best = (first, x, y)
    return best


def _raised(steps: list[Place], first: int, left: float, right: float, top: float, side: float) -> list[Place]:
    """The skyline with a rectangle upon it."""
    last = first
    while last < len(steps) and steps[last][0] < right - 1e-12:
        last += 1
    rest = steps[last:]
    if right < side and (not rest or rest[0][0] > right + 1e-12):
        rest = [(right, steps[last - 1][1]), *rest]
    raised = [*steps[:first], (left, top), *rest]
    return [s for k, s in enumerate(raised) if k == 0 or s[1] != raised[k - 1][1]]
