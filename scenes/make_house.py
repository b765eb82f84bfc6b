"""Puts a sun, a sky and a camera into house.glb and gives it its real size.

    python3 scenes/make_house.py IN.glb [OUT.glb]

IN is the model as credited in house.txt, or an output of this script: running it twice changes nothing. Geometry,
materials and both texture coordinate sets stay as they are.
"""

from __future__ import annotations

import math
import sys
from pathlib import Path

from glb import EXTENSION, Glb, Json, look_along, point_along

METRES_PER_UNIT = 40.0  # the model is half a unit across: 20 m of ground, a car of 1.8 m in height
SUN_ELEVATION, SUN_AZIMUTH = math.radians(38.0), math.radians(-55.0)  # azimuth from +Z towards +X
SUN = {"name": "Sun", "type": "sun", "irradiance": [4.6, 4.1, 3.4], "angle": 0.00918}
SKY = {"gradient": {"zenith": [0.22, 0.36, 0.70], "horizon": [0.55, 0.66, 0.82], "ground": [0.08, 0.08, 0.07]}}


def is_added(node: Json) -> bool:
    """True for a node that this script adds."""
    return "camera" in node or EXTENSION in node.get("extensions", {})


def forget_additions(glb: Glb) -> None:
    """Removes what an earlier run added. The nodes it added are the last ones."""
    document = glb.json
    while is_added(document["nodes"][-1]):
        last = len(document["nodes"]) - 1
        document["nodes"].pop()
        for scene in document["scenes"]:
            scene["nodes"] = [n for n in scene["nodes"] if n != last]
    document.get("extensions", {}).pop(EXTENSION, None)
    document.pop("cameras", None)


def main() -> None:
    """Reads, lights and writes the scene."""
    source = Path(sys.argv[1])
    out = Path(sys.argv[2]) if len(sys.argv) > 2 else Path(__file__).with_name("house.glb")
    glb = Glb.read(source)
    forget_additions(glb)

    for index in glb.json["scenes"][0]["nodes"]:
        glb.json["nodes"][index]["scale"] = [METRES_PER_UNIT] * 3
    glb.json["asset"]["copyright"] = "House Scene, CC-BY 4.0, see house.txt"

    to_sun = (
        math.cos(SUN_ELEVATION) * math.sin(SUN_AZIMUTH),
        math.sin(SUN_ELEVATION),
        math.cos(SUN_ELEVATION) * math.cos(SUN_AZIMUTH),
    )
    glb.add_light(SUN, {"name": "Sun", "rotation": point_along((-to_sun[0], -to_sun[1], -to_sun[2]))})
    glb.set_environment(SKY)
    camera = {"type": "perspective", "perspective": {"aspectRatio": 1.5, "yfov": 0.66, "znear": 0.1, "zfar": 200.0}}
    glb.add_root(
        {
            "name": "Camera",
            "camera": glb.append("cameras", camera),
            "translation": [14.5, 10.0, 17.5],
            "rotation": look_along((-14.5, -8.2, -17.5)),
        }
    )
    glb.write(out)


if __name__ == "__main__":
    main()
