"""BC6H blocks: linear RGB → 16 bytes for 4 × 4 texels of unsigned half floats, which GPUs read as they are.

Made by Intel's ISPC Texture Compressor (ispc-texcomp), which is an optional dependency.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..errors import EnvironmentFault

Pixels = npt.NDArray[np.float32]

_SIDE = 4
_LARGEST = 65504.0
_BYTES_PER_TEXEL = 8


def check() -> None:
    """Raises EnvironmentFault if the compressor is missing."""
    try:
        import ispc_texcomp  # noqa: F401
    except ImportError as error:
        remedy = "pip install 'lightkiln-pipeline[bc6h]', with Python 3.11 or later"
        raise EnvironmentFault(f"the compressor for `bc6h` is missing: {remedy}, or choose another format") from error


def pack_bc6h(rgb: Pixels) -> bytes:
    """The blocks, row by row. What lacks for whole blocks repeats the last row and column."""
    check()
    import ispc_texcomp

    height, width = rgb.shape[:2]
    beyond = [(0, -height % _SIDE), (0, -width % _SIDE), (0, 0)]
    finite = np.clip(np.nan_to_num(rgb, nan=0.0, posinf=_LARGEST), 0.0, _LARGEST)
    whole = np.pad(finite, beyond, mode="edge")
    texels = np.ones((*whole.shape[:2], 4), np.float16)
    texels[..., :3] = whole
    rows, columns = texels.shape[:2]
    surface = ispc_texcomp.RGBASurface(texels.tobytes(), columns, rows, columns * _BYTES_PER_TEXEL)
    settings = ispc_texcomp.BC6HEncSettings.from_profile("slow")
    return bytes(ispc_texcomp.compress_blocks_bc6h(surface, settings))
