"""Writes KTX 2.0: linear RGB with its mip maps → B10G11R11 unsigned floats or BC6H, supercompressed with Zstandard.

Based on: KTX File Format Specification 2.0 and Khronos Data Format Specification 1.3 (Khronos Group). No library on
PyPI writes this format without a toolchain. B10G11R11 keeps 6 bits of mantissa (5 for blue): 1.6 % steps, up to 64512.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import zstandard

from .bc6h import pack_bc6h

Pixels = npt.NDArray[np.float32]

_IDENTIFIER = b"\xabKTX 20\xbb\r\n\x1a\n"
_ZSTANDARD = 2
_HEADER, _LEVEL = 80, 24


@dataclass(frozen=True)
class Encoding:
    """How texels are stored."""

    vulkan: int
    """Number of the format in Vulkan."""
    type_size: int
    """Bytes that change places with the order of bytes."""
    model: int
    """Colour model of the data format descriptor."""
    block: int
    """Texels along the sides of a block."""
    block_bytes: int
    samples: tuple[tuple[int, int, int], ...]
    """First bit, bits, channel."""
    pack: Callable[[Pixels], bytes]


def write_ktx2(levels: Sequence[Pixels], metadata: dict[str, str], encoding: Encoding) -> bytes:
    """A file with the levels, largest first, each half as large as the one before; row 0 is the top."""
    descriptor = _descriptor(encoding)
    pairs = b"".join(_pair(key, metadata[key]) for key in sorted(metadata))
    packed = [encoding.pack(level) for level in levels]
    compressor = zstandard.ZstdCompressor(level=19)
    stored = [compressor.compress(data) for data in packed]

    descriptor_at = _HEADER + _LEVEL * len(levels)
    pairs_at = descriptor_at + len(descriptor)
    # The smallest level stands first, so that a viewer can show something early.
    offset = pairs_at + len(pairs)
    index: list[tuple[int, int, int]] = [(0, 0, 0)] * len(levels)
    for number in reversed(range(len(levels))):
        index[number] = (offset, len(stored[number]), len(packed[number]))
        offset += len(stored[number])

    height, width = levels[0].shape[:2]
    sizes = (width, height, 0, 0, 1, len(levels), _ZSTANDARD)
    header = struct.pack("<9I", encoding.vulkan, encoding.type_size, *sizes)
    header += struct.pack("<4I2Q", descriptor_at, len(descriptor), pairs_at, len(pairs), 0, 0)
    header += b"".join(struct.pack("<3Q", *entry) for entry in index)
    return _IDENTIFIER + header + descriptor + pairs + b"".join(reversed(stored))


def pack_b10g11r11(rgb: Pixels) -> npt.NDArray[np.uint32]:
    """One word per texel: red in the low 11 bits, green in the next 11, blue in the high 10."""
    # These floats are halves without sign and with fewer bits of mantissa; adding half a step rounds to nearest.
    half = np.clip(np.nan_to_num(rgb), 0.0, 64512.0).astype(np.float16).view(np.uint16).astype(np.uint32)
    red = np.minimum((half[..., 0] + 8) >> 4, 0x7BF)
    green = np.minimum((half[..., 1] + 8) >> 4, 0x7BF)
    blue = np.minimum((half[..., 2] + 16) >> 5, 0x3DF)
    return np.asarray(red | (green << 11) | (blue << 22), "<u4")


def unpack_b10g11r11(words: npt.NDArray[np.uint32]) -> Pixels:
    """The way back."""
    halves = [(words & 0x7FF) << 4, ((words >> 11) & 0x7FF) << 4, (words >> 22) << 5]
    return np.stack([h.astype(np.uint16).view(np.float16) for h in halves], axis=-1).astype(np.float32)


B10G11R11 = Encoding(
    122, 4, 1, 1, 4, ((0, 11, 0), (11, 11, 1), (22, 10, 2)), lambda level: pack_b10g11r11(level).tobytes()
)
BC6H = Encoding(131, 1, 133, 4, 16, ((0, 128, 0),), pack_bc6h)


def _descriptor(encoding: Encoding) -> bytes:
    """The data format descriptor: BT.709, linear, unsigned floats."""
    samples = b""
    for offset, bits, channel in encoding.samples:
        is_float = 0x80
        samples += struct.pack("<HBBIIf", offset, bits - 1, channel | is_float, 0, 0, 1.0)
    primaries_bt709, transfer_linear, side = 1, 1, encoding.block - 1
    size = 24 + len(samples)
    block = struct.pack("<IHH", 0, 2, size)
    block += struct.pack("<4B4B", encoding.model, primaries_bt709, transfer_linear, 0, side, side, 0, 0)
    block += struct.pack("<8B", encoding.block_bytes, *[0] * 7)
    return struct.pack("<I", 4 + size) + block + samples


def _pair(key: str, value: str) -> bytes:
    data = key.encode() + b"\0" + value.encode() + b"\0"
    return struct.pack("<I", len(data)) + data + b"\0" * (-len(data) % 4)
