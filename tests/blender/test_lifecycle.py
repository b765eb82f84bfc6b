"""A production file is safe: it stays as it was after removing, and keeps its lightmap through saving and loading."""

from __future__ import annotations

import importlib
import os
import subprocess
import sys
import time
import zipfile
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest

import blender_addon
from baker import ROOT, program
from blender_addon import session
from blender_addon.job import watched
from tests.blender.scenes_in_blender import bake, irradiance, lamp, material, pixels, place, quad


def room() -> tuple[bpy.types.Object, bpy.types.Object]:
    """A floor without slots, and a box with a material on the object and one on the mesh."""
    floor = quad("Floor", 2)
    bpy.ops.mesh.primitive_cube_add(size=0.5, location=(0, 0, 0.25))
    box = bpy.context.object
    box.data.materials.append(material("On the mesh", "ShaderNodeBsdfDiffuse"))
    box.data.materials.append(material("Below", "ShaderNodeBsdfPrincipled"))
    box.material_slots[1].link = "OBJECT"
    box.material_slots[1].material = material("On the object", "ShaderNodeBsdfDiffuse")
    lamp("POINT", (1, 1, 2), energy=100)
    return floor, box


def state_of_file() -> dict[str, Any]:
    """What an artist would notice if it changed."""
    data = bpy.data
    blocks = {
        name: sorted(block.name for block in getattr(data, name))
        for name in ("objects", "meshes", "materials", "node_groups", "images", "scenes", "cameras", "worlds")
    }
    slots = {
        ob.name: [(s.link, s.material.name if s.material else None) for s in ob.material_slots] for ob in data.objects
    }
    # Before 5.0 an add-on's settings count as a custom property as soon as they are looked at.
    properties = {ob.name: sorted(k for k in ob.keys() if k != "lightkiln") for ob in data.objects}  # noqa: SIM118
    maps = {m.name: [(u.name, u.active, u.active_render) for u in m.uv_layers] for m in data.meshes}
    marks = {m.name: sorted(m.keys()) for m in data.meshes}
    return {"blocks": blocks, "slots": slots, "properties": properties, "maps": maps, "marks": marks}


def test_removing_leaves_the_file_as_it_was() -> None:
    room()
    before = state_of_file()
    bake(density=8, error=10)
    assert state_of_file() != before
    assert bpy.ops.lightkiln.remove() == {"FINISHED"}
    assert state_of_file() == before


def test_undo_leaves_the_file_as_it_was() -> None:
    room()
    before = state_of_file()
    bpy.ops.ed.undo_push(message="Before")
    settings = bpy.context.scene.lightkiln
    settings.density, settings.error = 8, 10
    assert bpy.ops.lightkiln.bake("EXEC_DEFAULT", True) == {"FINISHED"}
    assert state_of_file() != before
    bpy.ops.ed.undo()
    assert state_of_file() == before


def test_views_show_and_hide() -> None:
    floor, box = room()
    bake(density=8, error=10)
    assert box.material_slots[0].material.name == "On the mesh Lightmap"
    bpy.ops.lightkiln.compare()
    assert [s.material.name for s in box.material_slots] == ["On the mesh", "On the object"]
    assert [s.link for s in box.material_slots] == ["DATA", "OBJECT"]
    bpy.ops.lightkiln.compare()
    assert box.material_slots[1].material.name == "On the object Lightmap"
    bpy.ops.lightkiln.view(view="LIGHT")
    group = next(t for t in bpy.data.node_groups if t.name == "Lightkiln")
    assert group.nodes["Light Only"].outputs[0].default_value == 1.0
    assert floor.data.materials[0] is None


def test_detached_materials_stay() -> None:
    _, box = room()
    bake(density=8, error=10)
    bpy.ops.lightkiln.detach()
    assert box.material_slots[0].material.name == "On the mesh Lightmap"
    assert bpy.context.scene.lightkiln.image is None
    assert "lightkiln_state" not in box
    assert not bpy.ops.lightkiln.remove.poll()


def test_baking_again_replaces_in_place() -> None:
    room()
    bake(density=8, error=10)
    image, once = bpy.context.scene.lightkiln.image, state_of_file()
    bright = pixels(image).mean()
    bpy.data.lights["Lamp"].energy = 200
    bake(density=8, error=10)
    assert bpy.context.scene.lightkiln.image == image
    assert state_of_file() == once
    assert pixels(image).mean() == pytest.approx(2 * bright, rel=0.02)


@pytest.mark.parametrize("storage", ["PACKED", "FILE"])
def test_a_saved_file_shows_its_lightmap(storage: str, tmp_path: Path) -> None:
    quad("Floor", 0.02)
    lamp("POINT", energy=100, shadow_soft_size=0)
    path = tmp_path / "house.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    settings = bpy.context.scene.lightkiln
    settings.storage, settings.folder = storage, "//lit"
    bake()
    before = irradiance(bpy.data.objects["Floor"])
    assert before.min() > 1
    bpy.ops.wm.save_mainfile()
    moved = tmp_path / "elsewhere"
    moved.mkdir()
    path.rename(moved / path.name)
    if storage == "FILE":
        (tmp_path / "lit").rename(moved / "lit")
        assert [p.name for p in (moved / "lit").iterdir()] == ["house_Scene.exr"]
    bpy.ops.wm.open_mainfile(filepath=str(moved / path.name))
    floor = bpy.data.objects["Floor"]
    assert irradiance(floor) == pytest.approx(before)
    bake()
    assert irradiance(floor) == pytest.approx(before)
    bpy.ops.lightkiln.remove()
    assert not floor.material_slots


def test_the_lit_glb_lies_beside_the_lightmap(tmp_path: Path) -> None:
    room()
    settings = bpy.context.scene.lightkiln
    settings.write_glb = True
    bake(density=8, error=10)
    (glb,) = (tmp_path / "lightmaps").glob("*.lit.glb")
    assert glb.read_bytes()[:4] == b"glTF"


def test_a_cancelled_bake_changes_nothing() -> None:
    room()
    before = state_of_file()
    settings = bpy.context.scene.lightkiln
    settings.density, settings.error = 64, 0.1
    running = session.start(bpy.context.scene, bpy.context.view_layer)
    started = time.monotonic()
    for step in running.steps:
        assert step is None
        if running.bake.progress.stage not in {"prepare", "export"}:
            break
    session.stop()
    assert time.monotonic() - started < 20
    assert session.running is None
    assert state_of_file() == before


def test_the_baker_ends_when_its_parent_dies(tmp_path: Path) -> None:
    program_that_waits = [sys.executable, "-c", "import time; print('up', flush=True); time.sleep(60)"]
    child = subprocess.Popen(watched(program_that_waits), stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    assert child.stdin and child.stdout
    assert child.stdout.readline() == "up\n"
    # A dying process closes its pipes.
    child.stdin.close()
    assert child.wait(10) != 0
    assert child.stdout.read() == ""
    child.stdout.close()


def test_registering_a_hundred_times_leaks_nothing() -> None:
    def counts() -> tuple[int, int, int]:
        lists = ("load_pre", "depsgraph_update_post", "undo_post", "redo_post")
        handlers = sum(len(getattr(bpy.app.handlers, name)) for name in lists)
        return handlers, len(bpy.types.Panel.__subclasses__()), len(bpy.types.Scene.bl_rna.properties)

    before = counts()
    for _ in range(100):
        blender_addon.unregister()
        blender_addon.register()
    assert counts() == before
    blender_addon.unregister()
    assert not hasattr(bpy.types.Scene, "lightkiln")
    blender_addon.register()


def test_a_file_opens_clean_without_the_add_on(tmp_path: Path) -> None:
    room()
    bake(density=8, error=10)
    path = tmp_path / "file.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    blender_addon.unregister()
    try:
        bpy.ops.wm.open_mainfile(filepath=str(path))
        assert bpy.data.objects["Cube"].material_slots[0].material.name == "On the mesh Lightmap"
    finally:
        blender_addon.register()


def extension_tool() -> Path:
    """Blender's own tool for extensions."""
    found = Path(bpy.utils.system_resource("SCRIPTS")) / "addons_core/bl_pkg/cli/blender_ext.py"
    assert found.is_file()
    return found


def test_the_zip_is_valid_and_repairs_its_program(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    command = [
        sys.executable,
        str(ROOT / "blender_addon" / "build.py"),
        f"linux-x64={program()}",
        "--out",
        str(tmp_path),
    ]
    path = Path(subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip())
    tool = [sys.executable, str(extension_tool()), "validate", str(path)]
    done = subprocess.run(tool, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    names = zipfile.ZipFile(path).namelist()
    assert "bin/lightkiln" in names and "LICENSE" in names and "build.py" not in names
    folder = tmp_path / "lightkiln_installed"
    zipfile.ZipFile(path).extractall(folder)
    assert not os.access(folder / "bin" / "lightkiln", os.X_OK)
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.delenv("LIGHTKILN_BIN")
    installed = importlib.import_module("lightkiln_installed.program")

    found = installed.find()
    assert found == folder / "bin" / "lightkiln"
    assert os.access(found, os.X_OK)


def test_linked_duplicates_keep_their_mesh() -> None:
    floor, _ = room()
    place("Twin", floor.data, (3, 0, 0))
    before = state_of_file()
    bake(density=8, error=10)
    assert floor.data.users == 2
    places = [np.array(bpy.data.objects[n]["lightkiln_place"]) for n in ("Floor", "Twin")]
    assert not np.allclose(places[0], places[1])
    bpy.ops.lightkiln.remove()
    assert state_of_file() == before


def test_states_are_shown_and_the_first_lightmap_is_kept_when_cancelled() -> None:
    floor, _ = room()
    settings = bpy.context.scene.lightkiln
    settings.density, settings.error = 32, 0.5
    running = session.start(bpy.context.scene, bpy.context.view_layer, progressive=True)
    for _ in running.steps:
        if running.bake.shown:
            break
    assert settings.view == "LIT"
    coarse = pixels(settings.image).mean()
    assert coarse > 0
    session.stop()
    assert "lightkiln_place" in floor
    assert "Lightmap" in floor.data.uv_layers
    bake(density=32, error=2)
    assert pixels(settings.image).mean() == pytest.approx(coarse, rel=0.2)


def test_a_lightmap_whose_image_was_deleted_can_be_removed() -> None:
    room()
    before = state_of_file()
    bake(density=8, error=10)
    bpy.data.images.remove(bpy.context.scene.lightkiln.image)
    assert bpy.ops.lightkiln.remove() == {"FINISHED"}
    assert state_of_file() == before
