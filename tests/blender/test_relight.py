"""Light that is changed after a bake shows without another one, and what cannot be relit is named."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import bpy
import numpy as np
import pytest

from blender_addon import live, relit
from blender_addon.light_state import LightState, Source
from blender_addon.relight_plan import plan
from tests.blender.scenes_in_blender import irradiance, lamp, material, pixels, place, quad, world
from tests.blender.test_lifecycle import state_of_file


def screen(color: tuple[float, float, float], strength: float) -> bpy.types.Material:
    """An emissive material."""
    return material("Screen", "ShaderNodeEmission", Color=(*color, 1), Strength=strength)


def stage() -> tuple[bpy.types.Object, bpy.types.Object]:
    """A floor under a lamp, a screen and a dim sky. Returns floor and lamp."""
    floor = quad("Floor", 1)
    floor.data.materials.append(material("Grey", "ShaderNodeBsdfPrincipled", Base_Color=(0.5, 0.5, 0.5, 1)))
    key = lamp("POINT", (0.2, 0, 1), energy=10, color=(1, 0.8, 0.6), shadow_soft_size=0.05)
    key.name = key.data.name = "Key"
    panel = quad("Panel", 0.3, (0, 0.6, 0.5), rotation_euler=(math.pi / 2, 0, 0))
    panel.data.materials.append(screen((0.2, 0.4, 1), 3))
    panel.lightkiln.exclude = True
    world((0.1, 0.2, 0.3), 0.5)
    return floor, key


def bake() -> None:
    """A quick bake with light groups."""
    settings = bpy.context.scene.lightkiln
    settings.groups, settings.density, settings.error = True, 12, 5
    assert bpy.ops.lightkiln.bake() == {"FINISHED"}


def shown() -> np.ndarray:
    """The lightmap."""
    return pixels(bpy.context.scene.lightkiln.image).astype(np.float64)


def relight() -> str:
    """Relights and returns what needs a bake."""
    assert bpy.ops.lightkiln.relight() == {"FINISHED"}
    return str(bpy.context.scene.lightkiln.stale)


def expect_same_as_a_bake() -> None:
    """What was relit is what a new bake of the changed scene gives."""
    ours = shown()
    bake()
    truth = shown()
    assert np.abs(ours - truth).mean() < 0.02 * truth.mean()


def brighter(key: bpy.types.Object) -> None:
    key.data.energy = 25


def redder(key: bpy.types.Object) -> None:
    key.data.color = (1, 0.2, 0.1)


def warmer(key: bpy.types.Object) -> None:
    if not hasattr(key.data, "use_temperature"):
        pytest.skip("this Blender has no lamp temperature")
    key.data.use_temperature, key.data.temperature, key.data.exposure = True, 3000, 1.5


def off(key: bpy.types.Object) -> None:
    key.hide_render = True


def other_screen(_key: bpy.types.Object) -> None:
    shader = bpy.data.materials["Screen"].node_tree.nodes["Emission"]
    shader.inputs["Strength"].default_value = 9
    shader.inputs["Color"].default_value = (0.8, 0.1, 0.3, 1)


def other_sky(_key: bpy.types.Object) -> None:
    background = bpy.context.scene.world.node_tree.nodes["Background"]
    background.inputs["Strength"].default_value = 2
    background.inputs["Color"].default_value = (0.3, 0.2, 0.1, 1)


@pytest.mark.parametrize("change", [brighter, redder, warmer, off, other_screen, other_sky])
def test_changed_light_is_shown_as_a_bake_would(change: Callable[[bpy.types.Object], None]) -> None:
    _, key = stage()
    bake()
    before, image = shown(), bpy.context.scene.lightkiln.image
    change(key)
    assert relight() == ""
    assert bpy.context.scene.lightkiln.image == image
    assert np.abs(shown() - before).mean() > 0.02 * before.mean()
    expect_same_as_a_bake()


def test_changes_are_relative_to_the_bake_and_can_be_taken_back() -> None:
    _, key = stage()
    bake()
    before = shown()
    for energy in (20, 5, 10):
        key.data.energy = energy
        relight()
    assert shown() == pytest.approx(before, rel=2e-3, abs=1e-6)


def test_what_cannot_be_relit_is_named() -> None:
    floor, key = stage()
    bake()
    key.location.x += 0.3
    floor.data.materials[0].node_tree.nodes["Principled BSDF"].inputs["Base Color"].default_value = (1, 1, 1, 1)
    quad("Newcomer", 0.1, (0.3, 0.3, 0.3))
    lamp("SUN", energy=1).name = "Sun"
    bpy.data.objects["Panel"].scale.x = 2
    stale = relight()
    for expected in ("`Key` was moved", "`Newcomer` is new", "`Sun` is new", "`Panel` was moved", "`Grey` reflects"):
        assert expected in stale
    bake()
    assert bpy.context.scene.lightkiln.stale == ""


def test_renaming_is_no_change() -> None:
    floor, key = stage()
    bake()
    before = shown()
    floor.name, key.name = "Ground", "Bulb"
    assert relight() == ""
    assert shown() == pytest.approx(before, rel=2e-3, abs=1e-6)


def test_lamps_of_one_group_change_together() -> None:
    _, key = stage()
    fill = lamp("POINT", (-0.3, 0, 1), energy=4, shadow_soft_size=0)
    fill.name = "Fill"
    key.lightkiln.group = fill.lightkiln.group = "Ceiling"
    bake()
    key.data.energy *= 2
    assert "share the light group `Ceiling`" in relight()
    fill.data.energy *= 2
    assert relight() == ""
    expect_same_as_a_bake()


def test_emission_is_edited_in_the_lit_material() -> None:
    floor, _ = stage()
    glow = floor.data.materials[0].node_tree.nodes["Principled BSDF"].inputs
    glow["Emission Color"].default_value, glow["Emission Strength"].default_value = (1, 0, 0, 1), 1
    bake()
    lit = floor.material_slots[0].material
    assert lit.name == "Grey Lightmap"
    stand_in = next(n for n in lit.node_tree.nodes if n.get("lightkiln_for"))
    stand_in.inputs["Emission Strength"].default_value = 4
    bpy.context.view_layer.update()
    assert glow["Emission Strength"].default_value == 4
    assert relight() == ""
    glow["Emission Color"].default_value = (0, 1, 0, 1)
    bpy.context.view_layer.update()
    assert tuple(stand_in.inputs["Emission Color"].default_value) == (0, 1, 0, 1)
    assert "gave no light of one of its colours" in relight()


def checkered_sky() -> tuple[bpy.types.Node, bpy.types.Node]:
    """A sky that must be rendered. Returns its background and its pattern."""
    tree = world((1, 1, 1), 1.0).node_tree
    background, checker = tree.nodes["Background"], tree.nodes.new("ShaderNodeTexChecker")
    tree.links.new(checker.outputs["Color"], background.inputs["Color"])
    return background, checker


def test_the_strength_of_a_picture_is_relit_and_another_picture_is_not() -> None:
    floor = quad("Floor", 1)
    background, checker = checkered_sky()
    glow = material("Glow", "ShaderNodeEmission", Strength=2.0)
    tree, image = glow.node_tree, bpy.data.images.new("Picture", 4, 4)
    image.generated_type = "COLOR_GRID"
    picture = tree.nodes.new("ShaderNodeTexImage")
    picture.image = image
    tree.links.new(picture.outputs["Color"], tree.nodes["Emission"].inputs["Color"])
    panel = quad("Panel", 0.3, (0, 0.6, 0.5), rotation_euler=(math.pi / 2, 0, 0))
    panel.data.materials.append(glow)
    bake()
    before = irradiance(floor)
    background.inputs["Strength"].default_value = 3
    tree.nodes["Emission"].inputs["Strength"].default_value = 6
    assert relight() == ""
    assert irradiance(floor) == pytest.approx(3 * before, rel=3e-3)
    checker.inputs["Scale"].default_value = 9
    picture.image = bpy.data.images.new("Other picture", 4, 4)
    stale = relight()
    assert "the world `World` has another" in stale and "the emission of `Glow` has another" in stale


def test_too_many_lamps_share_a_group() -> None:
    floor = quad("Floor", 1)
    lamps = [lamp("POINT", (0.02 * i, 0, 1), energy=1, shadow_soft_size=0) for i in range(34)]
    bake()
    before = irradiance(floor)
    lamps[0].data.energy = 20
    assert relight() == ""
    assert irradiance(floor).min() > 1.3 * before.max()
    lamps[33].data.energy = 20
    assert "share the light group `others`" in relight()


def test_a_lightmap_without_groups_cannot_be_relit() -> None:
    stage()
    settings = bpy.context.scene.lightkiln
    settings.density, settings.error = 8, 10
    bpy.ops.lightkiln.bake()
    assert not bpy.ops.lightkiln.relight.poll()
    bake()
    assert bpy.ops.lightkiln.relight.poll()
    bpy.ops.lightkiln.remove()
    assert not bpy.ops.lightkiln.relight.poll()


def test_groups_lie_beside_the_lightmap_and_survive_saving(tmp_path: Path) -> None:
    stage()
    path = tmp_path / "house.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    settings = bpy.context.scene.lightkiln
    settings.storage, settings.folder = "FILE", "//lit"
    bake()
    assert settings.solution == "house_Scene.groups"
    names = {p.name for p in (tmp_path / "lit" / "house_Scene.groups").iterdir()}
    assert names >= {
        "solution.lk",
        "lightmap_0.Key.exr",
        "lightmap_0.environment.exr",
        "lightmap_0.material_Screen.exr",
    }
    (tmp_path / "other").mkdir()
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "other" / "house.blend"), relative_remap=True)
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "other" / "house.blend"))
    bpy.data.lights["Key"].energy = 30
    assert relight() == ""
    expect_same_as_a_bake()
    # A bake without groups takes away those of the one before.
    settings = bpy.context.scene.lightkiln
    settings.folder, settings.groups = "//../lit", False
    assert bpy.ops.lightkiln.bake() == {"FINISHED"}
    assert settings.solution == "" and not relit.solution(bpy.context.scene)


def test_groups_of_another_bake_are_not_used() -> None:
    _, key = stage()
    bake()
    folder = relit.solution(bpy.context.scene)
    assert folder is not None
    key.location.z = 2
    old = (folder / "solution.lk").read_bytes()
    bake()
    (folder / "solution.lk").write_bytes(old)
    assert not bpy.ops.lightkiln.relight.poll()


def test_a_relight_that_fails_leaves_the_lightmap(tmp_path: Path) -> None:
    _, key = stage()
    bake()
    before, names = shown(), state_of_file()
    folder = relit.solution(bpy.context.scene)
    assert folder is not None
    good = (folder / "solution.lk").read_bytes()
    middle = len(good) // 2
    (folder / "solution.lk").write_bytes(good[:middle] + bytes(len(good) - middle))
    bpy.context.scene.lightkiln.solution_stamp = relit._stamp(folder / "solution.lk")
    key.data.energy = 30
    with pytest.raises(RuntimeError, match=r"solution\.lk"):
        bpy.ops.lightkiln.relight()
    assert live.running is None
    assert (shown() == before).all() and state_of_file() == names


def test_relighting_needs_the_baker(monkeypatch: pytest.MonkeyPatch) -> None:
    stage()
    bake()
    before = shown()
    monkeypatch.setenv("LIGHTKILN_BIN", "/nowhere/lightkiln")
    with pytest.raises(RuntimeError, match="preferences"):
        bpy.ops.lightkiln.relight()
    assert (shown() == before).all()


def test_lamps_in_instanced_collections_are_relit() -> None:
    quad("Floor", 1)
    inside = lamp("POINT", (0, 0, 1), energy=10, shadow_soft_size=0)
    collection = bpy.data.collections.new("Lamp post")
    collection.objects.link(inside)
    bpy.context.scene.collection.objects.unlink(inside)
    for x in (-0.2, 0.2):
        place(f"Post {x}", None, (x, 0, 0), instance_type="COLLECTION", instance_collection=collection)
    bake()
    before = irradiance(bpy.data.objects["Floor"])
    inside.data.energy = 20
    assert relight() == ""
    assert irradiance(bpy.data.objects["Floor"]) == pytest.approx(2 * before, rel=2e-3)
    row = bpy.data.collections.new("Row")
    for x in (-0.2, 0.2):
        row.objects.link(bpy.data.objects[f"Post {x}"])
        bpy.context.scene.collection.objects.unlink(bpy.data.objects[f"Post {x}"])
    place("Street", None, instance_type="COLLECTION", instance_collection=row)
    bake()
    assert irradiance(bpy.data.objects["Floor"]) == pytest.approx(2 * before, rel=2e-3)
    inside.data.energy = 10
    assert relight() == ""
    assert irradiance(bpy.data.objects["Floor"]) == pytest.approx(before, rel=2e-3)
    bpy.data.objects["Post 0.2"].location.y = 0.3
    assert "was moved" in relight()


def test_plans_name_what_gave_no_light() -> None:
    dark = Source("lamp", "Off", "", (0.0, 0.0, 0.0), "here", "round")
    red = Source("lamp", "Red", "Red", (2.0, 0.0, 0.0), "here", "round")
    baked = LightState([dark, red], {}, {})
    now = LightState(
        [
            Source("lamp", "Off", "", (1.0, 1.0, 1.0), "here", "round"),
            Source("lamp", "Red", "", (1.0, 1.0, 0.0), "here", "round"),
        ],
        {},
        {},
    )
    below = Source("lamp", "Red", "Red", (-1.0, 0.0, 0.0), "here", "round")
    taken = plan(baked, LightState([dark, below], {}, {}))
    assert taken.factors["Red"] == (0.0, 1.0, 1.0) and "takes light away" in taken.stale[0]
    made = plan(LightState.from_text(baked.to_text()), now)
    assert made.factors["Red"][0] == 0.5
    assert any("`Off` gave no light" in line for line in made.stale)
    assert any("`Red` gave no light of one" in line for line in made.stale)
