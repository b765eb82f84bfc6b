"""Writes cornell_box.glb: the measured Cornell box, ten times its real size (5.5 m, a room rather than a model).

    python3 scenes/make_cornell.py [OUT.glb]

Reflectances are the measured spectra under D65 in linear Rec.709; the lamp is a one-sided rectangle in the
LIGHTKILN_scene extension with the measured emission as radiance, W/(m²·sr). TEXCOORD_1 is a lightmap layout of all
objects on one page, whose charts lie on whole texels at 512².
"""

from __future__ import annotations

import math
import sys
from dataclasses import dataclass
from pathlib import Path

import cornell_data as data
from colorimetry import Rgb, Spectrum, emission_to_rec709, piecewise_linear, reflectance_to_rec709
from glb import Geometry, Glb, Vector, point_along

METRES_PER_UNIT = 0.01  # the data are millimetres; the box is ten times its real size
PAGE_TEXELS = 512
GUTTER_TEXELS = 3


@dataclass
class Chart:
    """A planar quadrilateral with its place on the lightmap page."""

    corners: list[Vector]
    normal: Vector
    plane: list[tuple[float, float]]  # corners in metres along the chart's own axes, from 0
    width: float
    height: float
    origin: tuple[int, int] = (0, 0)

    def texels(self, texels_per_metre: float) -> tuple[int, int]:
        """Width and height in whole texels."""
        return math.ceil(self.width * texels_per_metre), math.ceil(self.height * texels_per_metre)


def to_gltf(p: data.Point) -> Vector:
    """Into glTF's frame, centred, so that the box opens towards +Z and the red wall is on the left."""
    x, y, z = p
    return (278.0 - x) * METRES_PER_UNIT, y * METRES_PER_UNIT, (279.6 - z) * METRES_PER_UNIT


def subtract(a: Vector, b: Vector) -> Vector:
    """a - b."""
    return tuple(x - y for x, y in zip(a, b, strict=True))


def dot(a: Vector, b: Vector) -> float:
    """Scalar product."""
    return sum(x * y for x, y in zip(a, b, strict=True))


def unit(a: Vector) -> Vector:
    """a with length 1."""
    length = math.sqrt(dot(a, a))
    return tuple(x / length for x in a)


def cross(a: Vector, b: Vector) -> Vector:
    """Vector product."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def make_chart(quad: data.Quad) -> Chart:
    """The quadrilateral with its normal (towards the room) and its corners in its own plane."""
    corners = [to_gltf(p) for p in quad]
    along = unit(subtract(corners[1], corners[0]))
    normal = unit(cross(along, subtract(corners[2], corners[1])))
    across = cross(normal, along)
    flat = [(dot(subtract(c, corners[0]), along), dot(subtract(c, corners[0]), across)) for c in corners]
    low = min(u for u, _ in flat), min(v for _, v in flat)
    plane = [(u - low[0], v - low[1]) for u, v in flat]
    return Chart(corners, normal, plane, max(u for u, _ in plane), max(v for _, v in plane))


def place(charts: list[Chart], texels_per_metre: float) -> bool:
    """Places the charts on shelves, highest first; false if the page is too small."""
    x, y, shelf = GUTTER_TEXELS, GUTTER_TEXELS, 0
    for chart in sorted(charts, key=lambda c: -c.height):
        width, height = chart.texels(texels_per_metre)
        if x + width + GUTTER_TEXELS > PAGE_TEXELS:
            x, y, shelf = GUTTER_TEXELS, y + shelf + GUTTER_TEXELS, 0
        chart.origin = x, y
        x += width + GUTTER_TEXELS
        shelf = max(shelf, height)
        if y + height + GUTTER_TEXELS > PAGE_TEXELS:
            return False
    return True


def pack(charts: list[Chart]) -> float:
    """Places the charts at the highest density that fits; returns it in texels per metre."""
    density = 40.0
    while not place(charts, density):
        density -= 0.25
    return density


def to_geometry(charts: list[Chart], texels_per_metre: float) -> Geometry:
    """Two triangles per chart."""
    geometry = Geometry([], [], [[], []], [])
    for chart in charts:
        first = len(geometry.positions)
        geometry.positions += chart.corners
        geometry.normals += [chart.normal] * 4
        geometry.texcoords[0] += [(u / chart.width, v / chart.height) for u, v in chart.plane]
        x, y = chart.origin
        geometry.texcoords[1] += [
            ((x + u * texels_per_metre) / PAGE_TEXELS, (y + v * texels_per_metre) / PAGE_TEXELS) for u, v in chart.plane
        ]
        geometry.indices += [first + i for i in (0, 1, 2, 0, 2, 3)]
    return geometry


def measured(table: str) -> Spectrum:
    """A reflectance spectrum from its table."""
    values = [float(word) for word in table.split()]
    return piecewise_linear({data.FIRST_WAVELENGTH + data.WAVELENGTH_STEP * i: v for i, v in enumerate(values)})


def add_material(glb: Glb, name: str, reflectance: Rgb) -> int:
    """A Lambertian material that reflects on both sides."""
    color = [round(c, 6) for c in reflectance] + [1.0]
    surface = {"baseColorFactor": color, "metallicFactor": 0.0, "roughnessFactor": 1.0}
    return glb.append("materials", {"name": name, "pbrMetallicRoughness": surface, "doubleSided": True})


def add_lamp(glb: Glb) -> None:
    """The lamp, a millimetre below the ceiling."""
    corners = [to_gltf(p) for p in data.LAMP_CORNERS]
    low, high = ([f(c[k] for c in corners) for k in range(3)] for f in (min, max))
    radiance = [round(c, 6) for c in emission_to_rec709(piecewise_linear(data.LAMP))]
    glb.add_light(
        {"name": "Lamp", "type": "rect", "radiance": radiance, "size": [high[0] - low[0], high[2] - low[2]]},
        {
            "name": "Lamp",
            "translation": [(low[0] + high[0]) / 2, low[1] - 0.001, (low[2] + high[2]) / 2],
            "rotation": point_along((0.0, -1.0, 0.0)),
        },
    )


def main() -> None:
    """Builds and writes the scene."""
    out = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).with_name("cornell_box.glb")
    glb = Glb.new("lightkiln scenes/make_cornell.py", "Measured by the Cornell Program of Computer Graphics")
    spectra = {"white": data.WHITE, "green": data.GREEN, "red": data.RED}
    materials = {name: add_material(glb, name, reflectance_to_rec709(measured(t))) for name, t in spectra.items()}

    objects = [(name, color, [make_chart(q) for q in quads]) for name, color, quads in data.OBJECTS]
    density = pack([chart for _, _, charts in objects for chart in charts])
    for name, color, charts in objects:
        primitive = glb.add_primitive(to_geometry(charts, density), materials[color])
        mesh = glb.append("meshes", {"name": name, "primitives": [primitive]})
        glb.add_root({"name": name, "mesh": mesh})

    add_lamp(glb)
    fov = 2 * math.atan(data.CAMERA_FILM_OVER_FOCAL_LENGTH / 2)
    camera = {"type": "perspective", "perspective": {"aspectRatio": 1.0, "yfov": fov, "znear": 0.1, "zfar": 100.0}}
    glb.add_root(
        {
            "name": "Camera",
            "camera": glb.append("cameras", camera),
            "translation": list(to_gltf(data.CAMERA_POSITION)),
        }
    )
    glb.write(out)
    print(f"{out}: {density:g} texels/m on {PAGE_TEXELS}²")


if __name__ == "__main__":
    main()
