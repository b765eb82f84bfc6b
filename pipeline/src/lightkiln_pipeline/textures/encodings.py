"""Eight-bit encodings of bright pictures: linear values → RGBA bytes, and back as a shader decodes them.

| name   | decode, with r g b a in 0..1                                                     | largest value |
|--------|----------------------------------------------------------------------------------|---------------|
| RGBM   | rgb · a · range                                                                  | range         |
| RGBD   | rgb^2.2 / a, as Babylon.js has it                                                | 255           |
| LogLuv | Le = 255 b + a; Y = 2^((Le − 127) / 2); Z = Y / g; X = r Z; M⁻¹ (X, Y, Z), as in | 2^64          |
|        | Ward's logLuv with the matrix M below                                            |               |
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Pixels = npt.NDArray[np.float64]
Bytes = npt.NDArray[np.uint8]

LOG_LUV = np.array([[0.2209, 0.1138, 0.0102], [0.3390, 0.6780, 0.1130], [0.4184, 0.7319, 0.2969]])
"""Linear RGB → (X', Y, X + Y + Z)."""


def encode_rgbm(rgb: Pixels, largest: float) -> Bytes:
    """RGBM with the multiplier rounded up, so that nothing is clipped below `largest`."""
    scaled = np.clip(rgb / largest, 0.0, 1.0)
    multiplier = np.ceil(np.maximum(scaled.max(axis=-1), 1e-6) * 255.0) / 255.0
    return _bytes(np.concatenate([scaled / multiplier[..., None], multiplier[..., None]], axis=-1))


def decode_rgbm(rgba: Bytes, largest: float) -> Pixels:
    """The way back."""
    values = rgba / 255.0
    return np.asarray(values[..., :3] * values[..., 3:] * largest)


def encode_rgbd(rgb: Pixels) -> Bytes:
    """RGBD: values up to 255."""
    kept = np.clip(rgb, 0.0, 255.0)
    divisor = np.maximum(255.0 / np.maximum(kept.max(axis=-1), 1e-6), 1.0)
    divisor = np.clip(np.floor(divisor) / 255.0, 0.0, 1.0)
    return _bytes(np.concatenate([(kept * divisor[..., None]) ** (1 / 2.2), divisor[..., None]], axis=-1))


def decode_rgbd(rgba: Bytes) -> Pixels:
    """The way back."""
    values = rgba / 255.0
    return np.asarray(values[..., :3] ** 2.2 / np.maximum(values[..., 3:], 1e-6))


def encode_logluv(rgb: Pixels) -> Bytes:
    """LogLuv: a logarithm of the luminance in two bytes, the colour in the other two."""
    mixed = np.maximum(np.maximum(rgb, 0.0) @ LOG_LUV.T, 1e-6)
    luminance = 2.0 * np.log2(mixed[..., 1]) + 127.0
    whole = np.clip(np.floor(luminance), 0.0, 255.0)
    colour = mixed[..., :2] / mixed[..., 2:]
    return _bytes(np.stack([colour[..., 0], colour[..., 1], whole / 255.0, luminance - whole], axis=-1))


def decode_logluv(rgba: Bytes) -> Pixels:
    """The way back."""
    values = rgba / 255.0
    y = 2.0 ** ((values[..., 2] * 255.0 + values[..., 3] - 127.0) / 2.0)
    total = y / np.maximum(values[..., 1], 1e-6)
    mixed = np.stack([values[..., 0] * total, y, total], axis=-1)
    return np.maximum(mixed @ np.linalg.inv(LOG_LUV).T, 0.0)


def _bytes(values: Pixels) -> Bytes:
    return np.asarray(np.round(np.clip(values, 0.0, 1.0) * 255.0), np.uint8)
