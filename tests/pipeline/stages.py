"""Small USD stages for tests, and what bakes make of them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import OpenImageIO as oiio

from lightkiln_pipeline import program
from lightkiln_pipeline.usd.convert import Conversion, UsdSettings, convert
from lightkiln_pipeline.usd.lightmap_uv import read_lit

HEADER = '#usda 1.0\n(\n    defaultPrim = "World"\n    metersPerUnit = {metres}\n    upAxis = "{up}"\n)\n'
# Five centimetres of black floor, so that what is measured is direct light at a point.
FLOOR = """
def Mesh "Floor" {
    uniform token subdivisionScheme = "none"
    int[] faceVertexCounts = [4]
    int[] faceVertexIndices = [0, 1, 2, 3]
    point3f[] points = [(-.025, 0, .025), (.025, 0, .025), (.025, 0, -.025), (-.025, 0, -.025)]
    color3f[] primvars:displayColor = [(0, 0, 0)]
}
"""


def write_stage(path: Path, body: str, *, metres: float = 1.0, up: str = "Y") -> Path:
    """A stage with prims inside /World. USD wants a line for every brace; tests may do without."""
    body = body.replace("{ ", "{\n").replace(" }", "\n}")
    text = HEADER.format(metres=metres, up=up) + f'def Xform "World" {{\n{body}\n}}\n'
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")
    return path


@dataclass(frozen=True)
class Baked:
    """A converted and baked stage."""

    folder: Path
    conversion: Conversion
    report: dict[str, Any]

    @property
    def messages(self) -> str:
        """All notes of the conversion."""
        return "\n".join(map(str, self.conversion.notes))

    def page(self, number: int = 0) -> npt.NDArray[np.float32]:
        """A lightmap page."""
        return read_rgb(self.folder / f"lightmap_{number}.exr")


def read_rgb(path: Path) -> npt.NDArray[np.float32]:
    """The first three channels of a picture."""
    buffer = oiio.ImageBuf(str(path))
    assert not buffer.has_error, buffer.geterror()
    pixels = np.asarray(buffer.get_pixels(oiio.FLOAT), np.float32)
    return pixels.reshape(buffer.spec().height, buffer.spec().width, -1)[..., :3]


def bake_stage(stage: Path, *options: str, settings: UsdSettings | None = None) -> Baked:
    """Converts and bakes a stage beside itself."""
    folder = stage.parent / f"{stage.stem}.baked"
    glb = stage.with_suffix(".glb")
    conversion = convert(stage, glb, settings or UsdSettings(light_units="radiometric"))
    done = program.bake(glb, folder, ["--uv", "pack", "--force", "--float", *options], lambda _: None)
    return Baked(folder, conversion, done.report)


def bilinear(page: npt.NDArray[np.float32], u: float, v: float) -> npt.NDArray[np.float64]:
    """The page at a coordinate with v upwards, as a renderer's linear filter gives it."""
    height, width = page.shape[:2]
    x, y = u * width - 0.5, (1.0 - v) * height - 0.5
    i, k = int(np.clip(x, 0, width - 2)), int(np.clip(y, 0, height - 2))
    s, t = x - i, y - k
    block = page[k : k + 2, i : i + 2].astype(np.float64)
    return np.asarray(
        (block[0, 0] * (1 - s) + block[0, 1] * s) * (1 - t) + (block[1, 0] * (1 - s) + block[1, 1] * s) * t
    )


def middle_of(baked: Baked, prim: str) -> npt.NDArray[np.float64]:
    """The lightmap in the middle of a prim's corners."""
    mesh = next(m for m in read_lit(next(baked.folder.glob("*.lit.glb"))).meshes if m.prim == prim)
    (page, (_, uv)), *_ = mesh.pages.items()
    u, v = uv.mean(axis=0)
    return bilinear(read_rgb(baked.folder / page), float(u), float(v))


def irradiance(
    folder: Path, body: str, *options: str, settings: UsdSettings | None = None, metres: float = 1.0, up: str = "Y"
) -> npt.NDArray[np.float64]:
    """Irradiance per channel in the middle of the floor under lights, W/m²."""
    stage = write_stage(folder / "scene.usda", FLOOR + body, metres=metres, up=up)
    return middle_of(bake_stage(stage, "--texels-per-metre", "100", *options, settings=settings), "/World/Floor")
