"""Textures of a page: tiles, mip maps, decoded values, colour spaces."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest

from lightkiln_pipeline.batch.manifest import TextureOptions
from lightkiln_pipeline.errors import PipelineError
from lightkiln_pipeline.textures import encodings
from lightkiln_pipeline.textures.export import export_textures
from stages import read_rgb


@pytest.fixture
def page(tmp_path: Path) -> Path:
    """A page of 100 × 60 texels from 0.004 to 7, with colour."""
    rows, columns = np.mgrid[0:60, 0:100]
    value = 0.004 * (7 / 0.004) ** (columns / 99)
    rgb = np.stack([value, value * (0.3 + 0.7 * rows / 59), value * 0.5], axis=-1).astype(np.float32)
    spec = oiio.ImageSpec(100, 60, 3, oiio.HALF)
    picture = oiio.ImageBuf(spec)
    picture.set_pixels(spec.roi, rgb)
    path = tmp_path / "lightmap_0.exr"
    assert picture.write(str(path))
    return path


@pytest.mark.parametrize("kind", ["tx", "exr"])
def test_mipmapped_textures_are_tiled_halves(page: Path, kind: str) -> None:
    (made,) = export_textures(page, TextureOptions(formats=[kind]))  # type: ignore[list-item]
    file = oiio.ImageInput.open(str(made))
    assert file is not None
    spec = file.spec()
    assert file.format_name() == "openexr"
    assert (spec.tile_width, spec.tile_height, str(spec.format)) == (64, 64, "half")
    levels = 0
    while file.seek_subimage(0, levels):
        levels += 1
    assert levels == 7
    assert read_rgb(made) == pytest.approx(read_rgb(page), rel=1e-3)


def test_radiance_hdr_keeps_the_brightest_channel(page: Path) -> None:
    (made,) = export_textures(page, TextureOptions(formats=["hdr"]))
    brightest = read_rgb(page).max(axis=-1)
    assert read_rgb(made).max(axis=-1) == pytest.approx(brightest, rel=0.01)


@pytest.mark.parametrize(("kind", "decode", "tolerance"), [
    ("rgbm", lambda b: encodings.decode_rgbm(b, 8.0), 0.06),
    ("rgbd", encodings.decode_rgbd, 0.03),
    ("logluv", encodings.decode_logluv, 0.05),
])  # fmt: skip
def test_documented_decode_gives_the_page_back(page: Path, kind: str, decode, tolerance: float) -> None:  # type: ignore[no-untyped-def]
    (made,) = export_textures(page, TextureOptions(formats=[kind], range=8.0))  # type: ignore[list-item]
    file = oiio.ImageInput.open(str(made), _raw())
    assert file is not None
    stored = np.asarray(file.read_image(oiio.UINT8))
    wanted = read_rgb(page)
    bright = wanted.max(axis=-1) > 0.1
    # Relative to the brightest channel, which is what eight bits are shared out by.
    error = np.abs(decode(stored) - wanted).max(axis=-1) / wanted.max(axis=-1)
    assert error[bright].max() < tolerance


def _raw() -> oiio.ImageSpec:
    """Reads alpha as it is stored."""
    config = oiio.ImageSpec()
    config.attribute("oiio:UnassociatedAlpha", 1)
    return config


def test_working_space_is_that_of_the_configuration(page: Path) -> None:
    options = TextureOptions(formats=["exr"], ocio_config="ocio://default", working_space="ACEScg")
    (made,) = export_textures(page, options)
    to_acescg = np.array(
        [[0.613097, 0.339523, 0.047379], [0.070194, 0.916354, 0.013452], [0.020616, 0.109570, 0.869815]]
    )
    assert read_rgb(made) == pytest.approx(read_rgb(page) @ to_acescg.T, rel=2e-3)


def test_unknown_spaces_are_named(page: Path) -> None:
    options = TextureOptions(formats=["exr"], ocio_config="ocio://default", working_space="Nowhere")
    with pytest.raises(PipelineError, match="no colour space `Nowhere`"):
        export_textures(page, options)
