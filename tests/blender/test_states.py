"""What a bake shows before it is done, and which light it keeps."""

from __future__ import annotations

from collections.abc import Callable

import bpy
import numpy as np
import pytest

from blender_addon import session
from tests.blender.scenes_in_blender import bake, lamp, pixels, quad, world
from tests.blender.test_lifecycle import room, state_of_file


def bake_with_states(density: float, until: Callable[[session.Session], bool]) -> list[str]:
    """Bakes as in the window, until something is so, and ends it then. Returns the states that were shown."""
    settings = bpy.context.scene.lightkiln
    settings.density, settings.error = density, 0.5
    running = session.start(bpy.context.scene, bpy.context.view_layer, progressive=True)
    shown: list[str] = []
    for _ in running.steps:
        if running.bake.shown and running.bake.shown not in shown:
            shown.append(running.bake.shown)
        if until(running):
            session.stop()
            return shown
    session._end(running, "")
    return shown


def test_states_are_replaced_by_the_result() -> None:
    room()
    shown = bake_with_states(40, lambda _: False)
    assert shown and shown[0] == "preview"
    settings = bpy.context.scene.lightkiln
    assert settings.view == "LIT" and [image.name for image in bpy.data.images] == ["Scene Lightmap"]
    stepwise = pixels(settings.image)
    bpy.ops.lightkiln.remove()
    bake(density=40, error=0.5)
    assert (pixels(settings.image) == stepwise).all()


def test_cancelling_a_second_bake_brings_the_first_back() -> None:
    floor, _ = room()
    bake(density=8, error=10)
    settings = bpy.context.scene.lightkiln
    bpy.ops.lightkiln.view(view="LIGHT")
    image, before, names = settings.image, pixels(settings.image), state_of_file()
    where = tuple(floor["lightkiln_place"])
    corners = [tuple(c.vector) for c in floor.data.uv_layers["Lightmap"].uv]
    bpy.data.lights["Lamp"].energy = 300
    assert bake_with_states(48, lambda running: bool(running.bake.shown)) == ["preview"]
    assert settings.image == image and (pixels(image) == before).all()
    assert tuple(floor["lightkiln_place"]) == where and settings.view == "LIGHT"
    assert [tuple(c.vector) for c in floor.data.uv_layers["Lightmap"].uv] == corners
    assert state_of_file() == names


def test_states_are_shown_where_the_lightmap_is_in_a_folder() -> None:
    room()
    settings = bpy.context.scene.lightkiln
    settings.storage = "FILE"
    bake_with_states(40, lambda running: bool(running.bake.shown))
    assert settings.image.filepath.endswith("untitled_Scene.exr") and pixels(settings.image).max() > 0
    # What is kept is unfinished, and says so to nobody that would relight it.
    assert settings.solution == ""
    assert bpy.ops.lightkiln.remove() == {"FINISHED"}


def test_direct_and_indirect_light_add_up() -> None:
    quad("Floor", 1)
    quad("Wall", 1, (0.5, 0, 0.5), rotation_euler=(0, -1.5708, 0))
    lamp("POINT", (0, 0, 1), energy=20, shadow_soft_size=0)
    world((0.2, 0.3, 0.4), 1.0)
    settings = bpy.context.scene.lightkiln
    # Groups and a part of the light exclude each other; the part wins, as the panel shows.
    settings.groups = True
    pages = {}
    for part in ("direct", "indirect", "combined"):
        settings.light = part
        bake(density=16, error=2)
        pages[part] = pixels(settings.image).astype(np.float64)
        assert (settings.solution != "") == (part == "combined")
    assert pages["direct"] + pages["indirect"] == pytest.approx(pages["combined"], rel=2e-3, abs=1e-5)
    # Half a metre beside the lamp, on the wall: E = I / d², and the texture holds E / π.
    assert pages["direct"].max() == pytest.approx(20 / (4 * np.pi) / 0.5**2 / np.pi, rel=0.02)
    assert pages["indirect"].max() > 0.1
