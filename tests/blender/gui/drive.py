"""Runs inside a Blender with a window: clicks Bake, waits, cancels, bakes again, relights, looks at what is shown.

    blender --factory-startup --enable-event-simulate --python drive.py -- OUT

Out: OUT_*.png of every step, "GUI PASS" or "GUI FAIL" on the standard output, exit code 0 or 1.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
import traceback
from collections.abc import Callable, Generator, Iterator

import bpy

OUT = sys.argv[sys.argv.index("--") + 1]
ADDON = "bl_ext.user_default.lightkiln"
# Longest step of a bake in Blender's main thread, seconds.
longest = 0.0


def build_scene() -> None:
    """A small room with furniture, fine enough that its bake can be watched."""
    bpy.ops.mesh.primitive_plane_add(size=8)
    bpy.context.object.name = "Floor"
    bpy.ops.mesh.primitive_plane_add(size=8, location=(0, 4, 2), rotation=(1.5708, 0, 0))
    bpy.context.object.name = "Wall"
    for i in range(6):
        bpy.ops.mesh.primitive_monkey_add(size=1, location=(i % 3 * 1.6 - 1.6, i // 3 * 1.8 - 0.5, 0.8))
    bpy.data.objects["Light"].data.energy = 600
    screen = bpy.data.materials.new("Screen")
    screen.use_nodes = True
    shader = screen.node_tree.nodes["Principled BSDF"].inputs
    shader["Emission Color"].default_value, shader["Emission Strength"].default_value = (0.1, 0.3, 1, 1), 4
    bpy.ops.mesh.primitive_plane_add(size=1.5, location=(-2, 3.9, 1.5), rotation=(1.5708, 0, 0))
    bpy.context.object.name = "Panel"
    bpy.context.object.data.materials.append(screen)
    settings = bpy.context.scene.lightkiln
    settings.storage, settings.density, settings.error = "PACKED", 48, 1
    # A first bake that is cancelled keeps the state that it shows; this one shall leave nothing.
    settings.progressive = False


def shot(name: str) -> None:
    """A picture of the whole screen. Blender's own screenshots are black under software rendering."""
    subprocess.run(["import", "-window", "root", f"{OUT}_{name}.png"], check=True)


def click(x: float, y: float) -> Iterator[float]:
    """Presses the left button there."""
    window = bpy.context.window_manager.windows[0]
    for kind, value in (("MOUSEMOVE", "NOTHING"), ("LEFTMOUSE", "PRESS"), ("LEFTMOUSE", "RELEASE")):
        window.event_simulate(type=kind, value=value, x=int(x), y=int(y))
        yield 0.2


def view_area() -> tuple[bpy.types.Area, bpy.types.Region]:
    """The 3D view and its sidebar."""
    screen = bpy.context.window_manager.windows[0].screen
    area = next(a for a in screen.areas if a.type == "VIEW_3D")
    return area, next(r for r in area.regions if r.type == "UI")


def press_top_button(session: object, *, until_running: bool) -> Iterator[float]:
    """Clicks down the sidebar until the bake starts, or ends."""
    _, region = view_area()
    scale = bpy.context.preferences.system.ui_scale
    for down in range(40, 170, 10):
        yield from click(region.x + region.width / 2 - 10, region.y + region.height - down * scale)
        yield 0.3
        running = getattr(session, "running", None)
        if (running is not None) == until_running:
            return
    raise AssertionError("no button reacted")


def timed(steps: Callable[[object], Generator[None, None, None]]) -> Callable[[object], Generator[None, None, None]]:
    """The same steps, with the longest one's time noted."""

    def run(bake: object) -> Generator[None, None, None]:
        global longest
        inner = steps(bake)
        while True:
            started = time.monotonic()
            try:
                next(inner)
            except StopIteration:
                return
            finally:
                longest = max(longest, time.monotonic() - started)
            yield

    return run


def wait_for_relight(before: str) -> Iterator[float]:
    """Waits until the lightmap is in other light."""
    live = sys.modules[f"{ADDON}.live"]
    started = time.monotonic()
    while bpy.context.scene.lightkiln.relit == before or live.running is not None:
        assert live.failure == "", live.failure
        assert time.monotonic() - started < 20, "the lightmap was not relit"
        yield 0.05
    print(f"relit within {time.monotonic() - started:.1f} s", flush=True)
    yield 2.0


def relight_live() -> Iterator[float]:
    """Changes lights as an artist does, and watches the lightmap follow."""
    settings = bpy.context.scene.lightkiln
    relight_type = sys.modules[f"{ADDON}.relight"].Relight
    relight_type.steps = timed(relight_type.steps)
    before = settings.relit
    lamp = bpy.data.objects["Light"].data
    lamp.energy, lamp.color = 150, (1, 0.4, 0.1)
    yield from wait_for_relight(before)
    shot("relit_lamp")
    # The artist edits the material that is seen, which is the lit copy.
    before = settings.relit
    lit = bpy.data.objects["Panel"].material_slots[0].material
    shown = next(n for n in lit.node_tree.nodes if n.get("lightkiln_for"))
    shown.inputs["Emission Strength"].default_value = 20
    yield from wait_for_relight(before)
    shot("relit_emission")
    original = bpy.data.materials["Screen"].node_tree.nodes["Principled BSDF"]
    assert original.inputs["Emission Strength"].default_value == 20
    bpy.data.objects["Light"].location.x += 1
    started = time.monotonic()
    while "`Light` was moved" not in settings.stale:
        assert time.monotonic() - started < 20, "the panel does not say that the lamp was moved"
        yield 0.1
    yield 2.0
    shot("needs_a_bake")
    # What is undone is relit, too.
    before = settings.relit
    bpy.ops.ed.undo_push(message="Before")
    bpy.data.objects["Light"].data.energy = 5000
    yield from wait_for_relight(before)
    bpy.ops.ed.undo_push(message="Brighter")
    bright = bpy.context.scene.lightkiln.relit
    bpy.ops.ed.undo()
    assert bpy.data.objects["Light"].data.energy == 150
    live = sys.modules[f"{ADDON}.live"]
    yield 2.0
    while live.running is not None or live._last:
        yield 0.1
    assert bpy.context.scene.lightkiln.relit == before != bright
    yield 2.0
    shot("undone")
    print(f"the longest step was {1000 * longest:.0f} ms by then", flush=True)


def steps() -> Iterator[float]:
    """The walk through the add-on; yields seconds to wait."""
    yield 1.0
    bpy.ops.preferences.addon_enable(module=ADDON)
    session = sys.modules[f"{ADDON}.session"]
    bpy.data.objects.remove(bpy.data.objects["Cube"])
    build_scene()
    area, _ = view_area()
    area.spaces[0].show_region_ui = True
    yield 1.0
    area, region = view_area()
    region.active_panel_category = "Lightkiln"
    area.spaces[0].shading.type = "MATERIAL"
    area.tag_redraw()
    yield 3.0
    shot("panel")

    yield from press_top_button(session, until_running=True)
    for _ in range(100):
        if session.running is None or session.running.bake.progress.stage == "gather":
            break
        yield 0.1
    assert session.running is not None, "the bake ended before it could be cancelled"
    shot("running")
    bpy.ops.lightkiln.cancel()
    started = time.monotonic()
    while session.running is not None:
        yield 0.1
    print(f"cancelled within {time.monotonic() - started:.1f} s", flush=True)
    assert bpy.context.scene.lightkiln.image is None
    yield 0.5
    shot("cancelled")

    settings = bpy.context.scene.lightkiln
    settings.error, settings.groups, settings.progressive = 4, True, True
    bake_type = sys.modules[f"{ADDON}.bake"].Bake
    bake_type.steps = timed(bake_type.steps)
    yield from press_top_button(session, until_running=True)
    states: list[str] = []
    while session.running is not None:
        state = session.running.bake.shown
        if state and state not in states:
            states.append(state)
            yield 1.0
            shot(f"state_{state}")
        yield 0.1
    print(f"states shown: {states}", flush=True)
    assert states and states[0] == "preview"
    print(f"the longest step took {1000 * longest:.0f} ms", flush=True)
    assert session.failure == "", session.failure
    assert bpy.context.scene.lightkiln.view == "LIT"
    yield 4.0
    shot("lit")
    yield from relight_live()
    bpy.ops.lightkiln.view(view="LIGHT")
    yield 3.0
    shot("light_only")
    bpy.ops.lightkiln.checker()
    yield 2.0
    shot("density")
    bpy.ops.lightkiln.checker()
    bpy.ops.ed.undo_push(message="Looked")
    bpy.ops.lightkiln.remove()
    yield 1.0
    for side in (a for a in bpy.context.window_manager.windows[0].screen.areas if a.type == "PROPERTIES"):
        side.spaces[0].context = "OBJECT"
    yield 1.0
    shot("removed")
    assert "lightkiln_state" not in bpy.data.objects["Floor"]
    print("GUI PASS", flush=True)


bpy.context.preferences.view.show_splash = False
walk = steps()


def tick() -> float:
    """Takes the next step."""
    try:
        return next(walk)
    except StopIteration:
        os._exit(0)
    except BaseException:
        traceback.print_exc()
        shot("failed")
        print("GUI FAIL", flush=True)
        os._exit(1)


bpy.app.timers.register(tick, first_interval=1.0)
