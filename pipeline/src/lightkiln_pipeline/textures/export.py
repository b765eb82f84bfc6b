"""Further files of a lightmap page: an EXR of the baker → what renderers and engines read, beside it.

`tx` and `exr` are tiled, mip-mapped half-float OpenEXR; `hdr` is Radiance; the others are PNG (see encodings.py).
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt
import OpenImageIO as oiio

from .. import __version__
from ..batch.manifest import TextureOptions
from ..errors import PipelineError
from . import bc6h
from .encodings import encode_logluv, encode_rgbd, encode_rgbm
from .ktx2 import B10G11R11, BC6H, write_ktx2

# What the baker writes, by the name that OCIO's own configurations have for it.
_SOURCE_SPACES = ("lin_rec709", "Linear Rec.709 (sRGB)", "lin_rec709_scene")


def export_textures(page: Path, options: TextureOptions) -> list[Path]:
    """Writes the formats that are asked for; returns the files. Raises PipelineError if one cannot be written."""
    source = oiio.ImageBuf(str(page))
    if source.has_error:
        raise PipelineError(f"{page}: {source.geterror()}")
    source = oiio.ImageBufAlgo.channels(source, ("R", "G", "B"))
    if options.working_space is not None:
        source = _converted(source, options.ocio_config or "ocio://default", options.working_space)
    written = []
    for kind in options.formats:
        target = page.with_name(f"{page.stem}{_SUFFIXES[kind]}")
        if kind in ("tx", "exr"):
            _write_mipmapped(source, target)
        elif kind == "hdr":
            _save(source, target)
        elif kind in _KTX2:
            target.write_bytes(write_ktx2(_mip_levels(source), _metadata(source), _KTX2[kind]))
        else:
            _write_encoded(source, target, kind, options.range)
        written.append(target)
    return written


_SUFFIXES = {
    "tx": ".tx",
    "exr": ".mip.exr",
    "hdr": ".hdr",
    "rgbm": ".rgbm.png",
    "rgbd": ".rgbd.png",
    "logluv": ".logluv.png",
    "ktx2": ".ktx2",
    "bc6h": ".bc6h.ktx2",
}
_KTX2 = {"ktx2": B10G11R11, "bc6h": BC6H}


def check_formats(options: TextureOptions) -> None:
    """Raises EnvironmentFault if a format needs something that this machine lacks."""
    if "bc6h" in options.formats:
        bc6h.check()


def _converted(source: oiio.ImageBuf, config: str, space: str) -> oiio.ImageBuf:
    """The picture in another colour space."""
    known = oiio.ColorConfig(config)
    fault = known.geterror()
    if fault:
        raise PipelineError(f"{config}: the OCIO configuration cannot be read: {fault}; correct ocio_config")
    origin = next((name for name in _SOURCE_SPACES if known.getColorSpaceIndex(name) >= 0), None)
    if origin is None:
        raise PipelineError(f"{config}: the OCIO configuration has no linear Rec.709, in which lightmaps are baked")
    if known.getColorSpaceIndex(space) < 0:
        raise PipelineError(f"{config}: the OCIO configuration has no colour space `{space}`; correct working_space")
    out = oiio.ImageBufAlgo.colorconvert(source, origin, space, colorconfig=config)
    if out.has_error:
        raise PipelineError(f"{config}: {out.geterror()}")
    out.specmod().attribute("lightkiln:colorSpace", space)
    return out


def _write_mipmapped(source: oiio.ImageBuf, target: Path) -> None:
    """Tiles of 64 × 64, half floats, clamped, down to one texel."""
    config = oiio.ImageSpec()
    config.set_format(oiio.HALF)
    config.tile_width = config.tile_height = 64
    config.tile_depth = 1
    for key, value in {
        "maketx:fileformatname": "openexr",
        "maketx:filtername": "box",
        "maketx:fixnan": "box3",
        "wrapmodes": "clamp,clamp",
        "compression": "zip",
    }.items():
        config.attribute(key, value)
    if not oiio.ImageBufAlgo.make_texture(oiio.MakeTxTexture, source, str(target), config):
        raise PipelineError(f"{target}: {oiio.geterror() or 'it cannot be written'}")


def _mip_levels(source: oiio.ImageBuf) -> list[npt.NDArray[np.float32]]:
    """The picture and its halves, down to one texel."""
    levels = [np.asarray(source.get_pixels(oiio.FLOAT), np.float32)]
    while max(levels[-1].shape[:2]) > 1:
        height, width = (max(1, n // 2) for n in levels[-1].shape[:2])
        smaller = oiio.ImageBufAlgo.resize(source, "box", roi=oiio.ROI(0, width, 0, height, 0, 1, 0, 3))
        levels.append(np.asarray(smaller.get_pixels(oiio.FLOAT), np.float32).reshape(height, width, 3))
    return levels


def _metadata(source: oiio.ImageBuf) -> dict[str, str]:
    """What the page says of itself, and which way its rows run."""
    pairs = {"KTXorientation": "rd", "KTXwriter": f"lightkiln-pipeline {__version__}"}
    for key in ("quantity", "unit", "uvSet"):
        value = source.spec().get_string_attribute(f"lightkiln:{key}")
        if value:
            pairs[f"lightkiln:{key}"] = value
    return pairs


def _write_encoded(source: oiio.ImageBuf, target: Path, kind: str, largest: float) -> None:
    rgb = np.asarray(source.get_pixels(oiio.FLOAT), np.float64)
    encoded = {"rgbm": lambda: encode_rgbm(rgb, largest), "rgbd": lambda: encode_rgbd(rgb)}.get(
        kind, lambda: encode_logluv(rgb)
    )()
    spec = oiio.ImageSpec(rgb.shape[1], rgb.shape[0], 4, oiio.UINT8)
    # The four channels are numbers: nothing may multiply them by alpha or encode them again.
    spec.attribute("oiio:UnassociatedAlpha", 1)
    spec.attribute("oiio:ColorSpace", "data")
    picture = oiio.ImageBuf(spec)
    picture.set_pixels(spec.roi, np.ascontiguousarray(encoded))
    _save(picture, target)


def _save(picture: oiio.ImageBuf, target: Path) -> None:
    if not picture.write(str(target)):
        raise PipelineError(f"{target}: {picture.geterror()}")
