"""Textures of a page: tiles, mip maps, decoded values, colour spaces."""

from __future__ import annotations

import base64
import json
import shutil
import struct
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import OpenImageIO as oiio
import pytest
import zstandard

from lightkiln_pipeline.batch.manifest import TextureOptions
from lightkiln_pipeline.errors import EnvironmentFault, PipelineError
from lightkiln_pipeline.textures import encodings
from lightkiln_pipeline.textures.export import check_formats, export_textures
from lightkiln_pipeline.textures.ktx2 import unpack_b10g11r11
from stages import read_rgb

ROOT = Path(__file__).resolve().parents[2]


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


def parsed(made: Path) -> dict[str, Any]:
    """What ktx-parse, which three.js brings, reads of a file; its levels unpacked."""
    reader = ROOT / ".deps/npm/node_modules/three/examples/jsm/libs/ktx-parse.module.js"
    if not (shutil.which("node") and reader.is_file()):
        pytest.skip("no Node or no three.js: tests/run.py installs it into .deps/npm")
    script = f"""
        import {{ read }} from {json.dumps(reader.as_uri())};
        import {{ readFileSync }} from "node:fs";
        const file = read(new Uint8Array(readFileSync(process.argv[1])));
        const levels = file.levels.map((l) => [Buffer.from(l.levelData).toString("base64"), l.uncompressedByteLength]);
        const sample = file.dataFormatDescriptor[0].samples.map((s) => [s.bitOffset, s.bitLength, s.channelType]);
        console.log(JSON.stringify({{ format: file.vkFormat, size: [file.pixelWidth, file.pixelHeight], levels, sample,
            scheme: file.supercompressionScheme, block: file.dataFormatDescriptor[0].texelBlockDimension,
            model: file.dataFormatDescriptor[0].colorModel, keys: Object.keys(file.keyValue) }}));
    """
    run = ["node", "--input-type=module", "-e", script, str(made)]
    done = subprocess.run(run, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 0, done.stderr
    found: dict[str, Any] = json.loads(done.stdout)
    levels = [(zstandard.ZstdDecompressor().decompress(base64.b64decode(data)), size) for data, size in found["levels"]]
    assert all(len(level) == size for level, size in levels)
    return {**found, "levels": [level for level, _ in levels]}


def test_ktx2_is_read_by_another_implementation(page: Path) -> None:
    """The header is read; the levels unpack to the page and its mean."""
    (made,) = export_textures(page, TextureOptions(formats=["ktx2"]))
    found = parsed(made)
    assert (found["format"], found["size"], found["scheme"]) == (122, [100, 60], 2)
    assert [s[0] for s in found["sample"]] == [0, 11, 22]
    assert "KTXorientation" in found["keys"]
    levels = [unpack_b10g11r11(np.frombuffer(level, "<u4")) for level in found["levels"]]
    assert len(levels) == 7
    wanted = read_rgb(page)
    assert levels[0].reshape(60, 100, 3) == pytest.approx(wanted, rel=0.017)
    assert levels[-1][0] == pytest.approx(wanted.mean(axis=(0, 1)), rel=0.05)


def test_bc6h_is_read_by_other_implementations(page: Path, tmp_path: Path) -> None:
    """The header is read; OpenImageIO decodes the blocks to the page and its mean."""
    pytest.importorskip("ispc_texcomp")
    (made,) = export_textures(page, TextureOptions(formats=["bc6h"]))
    assert made.name == "lightmap_0.bc6h.ktx2"
    found = parsed(made)
    assert (found["format"], found["size"], found["scheme"], found["model"]) == (131, [100, 60], 2, 133)
    assert found["block"][:2] == [3, 3] and found["sample"] == [[0, 127, 0x80]]
    assert len(found["levels"]) == 7
    wanted = read_rgb(page)
    error = np.abs(decoded_bc6h(found["levels"][0], 100, 60, tmp_path) - wanted) / wanted.max(axis=-1, keepdims=True)
    assert error.max() < 0.05 and np.sqrt(np.mean(error**2)) < 0.01
    last = decoded_bc6h(found["levels"][-1], 1, 1, tmp_path)
    assert last[0, 0] == pytest.approx(wanted.mean(axis=(0, 1)), rel=0.05)


def decoded_bc6h(blocks: bytes, width: int, height: int, folder: Path) -> npt.NDArray[np.float32]:
    """Blocks by OpenImageIO, which reads them in DDS files."""
    rows, columns = height + -height % 4, width + -width % 4
    header = struct.pack("<7I44x", 124, 0x81007, rows, columns, len(blocks), 0, 0)
    header += struct.pack("<2I4s5I5I", 32, 4, b"DX10", 0, 0, 0, 0, 0, 0x1000, 0, 0, 0, 0)
    unsigned_bc6h, picture = 95, 3
    path = folder / "blocks.dds"
    path.write_bytes(b"DDS " + header + struct.pack("<5I", unsigned_bc6h, picture, 0, 1, 0) + blocks)
    file = oiio.ImageInput.open(str(path))
    assert file is not None
    return np.asarray(file.read_image(oiio.FLOAT), np.float32)[:height, :width, :3]


def test_what_bc6h_needs_is_named(page: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "ispc_texcomp", None)
    with pytest.raises(EnvironmentFault, match=r"pip install 'lightkiln-pipeline\[bc6h\]'"):
        check_formats(TextureOptions(formats=["bc6h"]))
    check_formats(TextureOptions(formats=["ktx2"]))
