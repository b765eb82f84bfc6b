"""Reads lightmap pages. In: an EXR file. Out: irradiance as float32 arrays of shape (height, width, 3)."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt
import OpenEXR

Page = npt.NDArray[np.float32]


def read_page(path: Path) -> Page:
    """The RGB of a page in the file's own quantity; row 0 is the top, where v = 0."""
    with OpenEXR.File(str(path)) as file:
        pixels = file.channels()["RGB"].pixels
        return np.asarray(pixels, dtype=np.float32)[..., :3]


def bilinear(page: Page, u: float, v: float) -> npt.NDArray[np.float64]:
    """The page at a texture coordinate, as a renderer's linear filter gives it."""
    height, width = page.shape[:2]
    x = min(max(u * width - 0.5, 0.0), width - 1.001)
    y = min(max(v * height - 0.5, 0.0), height - 1.001)
    i, k = int(x), int(y)
    s, t = x - i, y - k
    block = page[k : k + 2, i : i + 2].astype(np.float64)
    top = block[0, 0] * (1 - s) + block[0, 1] * s
    bottom = block[1, 0] * (1 - s) + block[1, 1] * s
    return np.asarray(top * (1 - t) + bottom * t)
