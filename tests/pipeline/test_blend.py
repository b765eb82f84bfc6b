"""Scenes of Blender: a .blend through the add-on and the same scene as USD give the same lightmap.

Needs a Python with bpy: the one that tests/blender/run.py installs, or LIGHTKILN_BPY_PYTHON.
"""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

from batches import batch, states
from lightkiln_pipeline.glb.reader import GlbReader
from stages import bilinear, read_rgb

ROOT = Path(__file__).resolve().parents[2]
PYTHON = Path(os.environ.get("LIGHTKILN_BPY_PYTHON", ROOT / ".deps" / "bpy-5.0.1" / "bin" / "python"))
SCENE = """
import bpy, os, sys
bpy.ops.wm.read_factory_settings(use_empty=True)
bpy.ops.mesh.primitive_plane_add(size=4)
bpy.ops.mesh.primitive_cube_add(size=1, location=(0, 0, .5))
red = bpy.data.materials.new("Red")
red.use_nodes = True
red.node_tree.nodes["Principled BSDF"].inputs["Base Color"].default_value = (.8, .1, .1, 1)
bpy.context.object.data.materials.append(red)
def lamp(kind, place, turn, **values):
    light = bpy.data.lights.new(kind, kind)
    if hasattr(light, "use_soft_falloff"):
        light.use_soft_falloff = False
    for key, value in values.items():
        setattr(light, key, value)
    ob = bpy.data.objects.new(kind, light)
    ob.location, ob.rotation_euler = place, turn
    bpy.context.scene.collection.objects.link(ob)
lamp("SUN", (0, 0, 0), (.6, .2, 0), energy=3, angle=.05)
lamp("SPOT", (1, 0, 3), (0, 0, 0), energy=100, spot_size=1, spot_blend=.4, shadow_soft_size=.1)
lamp("AREA", (-1, 0, 2.5), (0, 0, 0), energy=50, shape="RECTANGLE", size=1, size_y=.5)
bpy.ops.wm.save_as_mainfile(filepath=sys.argv[-1] + "/room.blend")
bpy.ops.wm.usd_export(filepath=sys.argv[-1] + "/usd/room.usda")
os._exit(0)
"""
Array = npt.NDArray[np.float64]


def samples(lit: Path) -> tuple[Array, Array]:
    """Points with normals in the world, and the irradiance that the lightmap has there."""
    glb, page, keys, values = GlbReader(lit), read_rgb(lit.parent / "lightmap_0.exr"), [], []
    for node in glb.items("nodes"):
        for primitive in glb.items("meshes")[node["mesh"]]["primitives"] if "mesh" in node else []:
            attributes = primitive["attributes"]
            x, y, z, w = node.get("rotation", (0, 0, 0, 1))
            turn = np.array([x, y, z])
            own = glb.values(attributes["POSITION"]).astype(np.float64) * node.get("scale", (1, 1, 1))
            placed = own + 2 * np.cross(turn, np.cross(turn, own) + w * own) + node.get("translation", (0, 0, 0))
            uv = glb.values(attributes["TEXCOORD_1"]).astype(np.float64)
            for triangle in glb.values(primitive["indices"]).reshape(-1, 3):
                a, b, c = placed[triangle]
                normal = np.cross(b - a, c - a)
                for s, t in (
                    (s, t) for s in np.linspace(0.05, 0.9, 10) for t in np.linspace(0.05, 0.9, 10) if s + t < 0.97
                ):
                    weights = np.array([1 - s - t, s, t])
                    keys.append(np.concatenate([weights @ placed[triangle], normal / np.linalg.norm(normal)]))
                    u, v = weights @ uv[triangle]
                    values.append(bilinear(page, float(u), 1.0 - float(v)))
    return np.array(keys), np.array(values)


def test_blend_and_usd_of_one_scene_agree(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    if not PYTHON.is_file():
        pytest.skip("no Python with bpy: run tests/blender/run.py once, or set LIGHTKILN_BPY_PYTHON")
    made = subprocess.run(
        [PYTHON, "-c", SCENE, str(tmp_path)], capture_output=True, text=True, timeout=300, check=False
    )
    assert (tmp_path / "usd" / "room.usda").is_file(), made.stderr
    monkeypatch.setenv("LIGHTKILN_BPY_PYTHON", str(PYTHON))
    manifest = tmp_path / "batch.toml"
    manifest.write_text('[[assets]]\nscenes = ["room.blend", "usd/room.usda"]\ntexels_per_metre = 16\n')
    assert states(batch("run", manifest, "--json", "--keep-going")) == {"room": "baked", "usd/room": "baked"}
    points, first = samples(tmp_path / "lightmaps/room/room.lit.glb")
    others, second = samples(tmp_path / "lightmaps/usd/room/room.lit.glb")
    nearest = [int(((others - p) ** 2).sum(axis=1).argmin()) for p in points]
    assert np.abs(others[nearest] - points).max() < 1e-4
    lit = first.min(axis=1) > 0.05
    ratio = second[nearest][lit] / first[lit]
    assert ratio.mean() == pytest.approx(1, abs=0.01)
    assert np.median(np.abs(ratio - 1)) < 0.01
