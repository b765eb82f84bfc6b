"""The lightmap finds its way back: places and UV maps, instances, modifiers, and what the materials show."""

from __future__ import annotations

import math
from pathlib import Path

import bpy
import numpy as np
import pytest

from tests.blender.scenes_in_blender import bake, irradiance, lamp, material, pixels, place, quad

POWER = 100.0


def point_light(at: tuple[float, float, float]) -> bpy.types.Object:
    """A point lamp of POWER."""
    return lamp("POINT", at, energy=POWER, shadow_soft_size=0)


def lit_by_point(distance: float) -> float:
    """Irradiance right below such a lamp."""
    return POWER / (4 * math.pi * distance**2)


def test_every_face_of_a_cube_has_its_own_light() -> None:
    bpy.ops.mesh.primitive_cube_add(size=0.02, rotation=(0.3, 0.2, 0.1), scale=(1, 2, 1))
    cube = bpy.context.object
    position = (1.0, -2.0, 1.5)
    point_light(position)
    bake()
    lit = 0
    for face in cube.data.polygons:
        centre = cube.matrix_world @ face.center
        normal = (cube.matrix_world.to_3x3().inverted_safe().transposed() @ face.normal).normalized()
        way = np.array(position) - np.array(centre)
        cosine = max(float(np.dot(way, normal)) / float(np.linalg.norm(way)), 0.0)
        expected = lit_by_point(float(np.linalg.norm(way))) * cosine
        assert irradiance(cube, face.index) == pytest.approx(np.full(3, expected), rel=0.01, abs=1e-3)
        lit += expected > 0
    assert lit == 3


def test_objects_that_share_a_mesh_have_places_of_their_own() -> None:
    near = quad("Near")
    far = place("Far", near.data, (0.5, 0, 0))
    mirrored = place("Mirrored", near.data, (-0.3, 0, 0), scale=(-1, 2, 1))
    point_light((0, 0, 2))
    bake()
    assert near.data is far.data and near.data.users == 3
    for ob in (near, far, mirrored):
        d = math.hypot(2, ob.location.x)
        expected = lit_by_point(d) * 2 / d
        assert irradiance(ob) == pytest.approx(np.full(3, expected), rel=0.005), ob.name


def test_single_user_copies_only_where_meshes_are_shared() -> None:
    one = quad("One")
    two = place("Two", one.data, (0.5, 0, 0))
    lone = quad("Lone", at=(1, 0, 0))
    meshes = (one.data, lone.data)
    point_light((0, 0, 2))
    bpy.context.scene.lightkiln.shared = "SINGLE_USER"
    bake()
    own = {ob.name: ob.data.name for ob in (one, two, lone)}
    assert len(set(own.values())) == 3
    assert lone.data is meshes[1]


def test_instances_of_a_collection_have_places_of_their_own() -> None:
    collection = bpy.data.collections.new("Set")
    child = quad("Child", at=(0, 0, 0.5))
    collection.objects.link(child)
    bpy.context.scene.collection.objects.unlink(child)
    empties = [
        place(f"Empty {x}", None, (x, 0, 0), instance_type="COLLECTION", instance_collection=collection)
        for x in (0.0, 0.7)
    ]
    point_light((0, 0, 2.5))
    bake()
    (attribute,) = [k for k in empties[0].keys() if k.startswith("lightkiln_place")]  # noqa: SIM118
    assert attribute != "lightkiln_place"
    for empty in empties:
        d = math.hypot(2, empty.location.x)
        value = irradiance(child, carrier=empty, attribute=attribute)
        assert value == pytest.approx(np.full(3, lit_by_point(d) * 2 / d), rel=0.005), empty.name


def test_modifiers_carry_the_map_along() -> None:
    ob = quad("Rough", 0.2)
    subdivide = ob.modifiers.new("Subdivide", "SUBSURF")
    subdivide.subdivision_type, subdivide.levels, subdivide.render_levels = "SIMPLE", 0, 3
    off = ob.modifiers.new("Only in renders", "DISPLACE")
    off.show_viewport, off.mid_level, off.strength = False, 0.0, 0.5
    point_light((0, 0, 2))
    bake(density=50)
    # The displacement lifts the square by half a metre.
    assert irradiance(ob) == pytest.approx(np.full(3, lit_by_point(1.5)), rel=0.01)
    assert (subdivide.levels, off.show_viewport) == (0, False)


def test_a_map_of_ones_own_is_kept() -> None:
    ob = quad("Mine")
    layer = ob.data.uv_layers.new(name="Mine")
    corners = [(0.5, 3.0), (0.9, 3.0), (0.9, 3.4), (0.5, 3.4)]
    for i, corner in enumerate(corners):
        layer.uv[i].vector = corner
    ob.lightkiln.uv_map = "Mine"
    point_light((0, 0, 2))
    bake()
    assert [layer.name for layer in ob.data.uv_layers] == ["Mine"]
    assert np.allclose([tuple(v.vector) for v in ob.data.uv_layers["Mine"].uv], corners)
    assert irradiance(ob) == pytest.approx(np.full(3, lit_by_point(2)), rel=0.005)


def test_density_is_what_was_asked_for() -> None:
    plain, fine = quad("Plain", 2), quad("Fine", 2, (5, 0, 0))
    fine.lightkiln.density = 32
    point_light((0, 0, 2))
    bake(density=8, error=10)
    side = bpy.context.scene.lightkiln.image.size[0]
    for ob, density in ((plain, 8), (fine, 32)):
        uv = np.array([tuple(v.vector) for v in ob.data.uv_layers["Lightmap"].uv])
        texels = (uv.max(axis=0) - uv.min(axis=0)) * ob["lightkiln_place"][0] * side
        assert texels == pytest.approx([2 * density] * 2, rel=0.02)


def test_the_resolution_limit_lowers_the_density_with_a_note() -> None:
    quad("Large", 100)
    point_light((0, 0, 2))
    settings = bpy.context.scene.lightkiln
    settings.resolution_limit = 64
    bake(density=16, error=20)
    assert max(settings.image.size) <= 64
    assert any("resolution limit" in note.message for note in settings.notes)


def test_excluded_and_unselected_objects_only_block_and_reflect() -> None:
    ground = quad("Ground", 0.02)
    roof = quad("Roof", 1, (0, 0, 1))
    roof.lightkiln.exclude = True
    quad("In the light", at=(3, 0, 0))
    point_light((0, 0, 2))
    bake(error=2)
    assert irradiance(ground).max() < 1e-3
    assert "lightkiln_place" not in roof
    roof.lightkiln.casts_shadow = False
    bake(error=2)
    assert irradiance(ground) == pytest.approx(np.full(3, lit_by_point(2)), rel=0.01)


def test_what_renders_do_not_show_is_not_baked() -> None:
    ground = quad("Ground")
    quad("Not rendered", 1, (0, 0, 1)).hide_render = True
    seen = quad("Hidden in the viewport", 1, (0, 0, 1.5))
    seen.hide_viewport = True
    quad("In the light", at=(3, 0, 0))
    point_light((0, 0, 2))
    bake(error=2)
    assert irradiance(ground).max() < 1e-3
    seen.hide_render = True
    bake(error=2)
    assert irradiance(ground).min() > 0.9 * lit_by_point(2)


def render(path: Path, samples: int = 64) -> np.ndarray:
    """What Cycles shows of the scene from above, linear."""
    scene = bpy.context.scene
    camera = bpy.data.cameras.new("Camera")
    camera.type, camera.ortho_scale = "ORTHO", 3.6
    scene.camera = place("Camera", camera, (0, 0, 10))
    scene.render.engine = "CYCLES"
    scene.cycles.device, scene.cycles.samples, scene.cycles.use_denoising = "CPU", samples, False
    scene.cycles.use_adaptive_sampling = False
    scene.render.resolution_x = scene.render.resolution_y = 48
    scene.view_settings.view_transform = "Raw"
    image = scene.render.image_settings
    if hasattr(image, "media_type"):
        image.media_type = "IMAGE"
    image.file_format, image.color_depth = "OPEN_EXR", "32"
    scene.render.filepath = str(path)
    bpy.ops.render.render(write_still=True)
    loaded = bpy.data.images.load(str(path))
    result = pixels(loaded)
    bpy.data.images.remove(loaded)
    return result


def test_the_applied_lightmap_renders_like_the_lit_scene(tmp_path: Path) -> None:
    floor = quad("Floor", 4)
    floor.data.materials.append(material("Red", "ShaderNodeBsdfDiffuse", Color=(0.7, 0.3, 0.2, 1)))
    bpy.ops.mesh.primitive_cube_add(size=0.6, location=(0.4, 0.2, 0.3))
    box = bpy.context.object
    box.data.materials.append(material("Green", "ShaderNodeBsdfDiffuse", Color=(0.2, 0.6, 0.2, 1)))
    twin = place("Twin", box.data, (-0.8, -0.5, 0.3), rotation_euler=(0, 0, 0.5))
    lamp("AREA", (0, 0, 2), energy=60, shape="DISK", size=1)
    truth = render(tmp_path / "truth.exr", 512)
    bake(density=24, error=1)
    assert twin.material_slots[0].material is not None
    for light in [ob for ob in bpy.context.scene.objects if ob.type == "LIGHT"]:
        bpy.data.objects.remove(light)
    shown = render(tmp_path / "shown.exr", 16)
    # Shadow edges are a texel wide in the one and a pixel in the other.
    ratio = shown.mean() / truth.mean()
    assert ratio == pytest.approx(1.0, abs=0.005)
    off = np.abs(shown - truth).max(axis=2) / truth.mean()
    assert np.median(off) < 0.02


def procedural(name: str, *, glows: bool) -> bpy.types.Material:
    """Red where generated X is below a half, black elsewhere: as reflectance, or as emission of 10."""
    made = material(name, "ShaderNodeBsdfPrincipled")
    tree = made.node_tree
    shader = next(n for n in tree.nodes if n.bl_idname == "ShaderNodeBsdfPrincipled")
    coordinate, split = tree.nodes.new("ShaderNodeTexCoord"), tree.nodes.new("ShaderNodeSeparateXYZ")
    ramp = tree.nodes.new("ShaderNodeValToRGB")
    ramp.color_ramp.interpolation = "CONSTANT"
    ramp.color_ramp.elements[0].color, ramp.color_ramp.elements[1].color = (1, 0, 0, 1), (0, 0, 0, 1)
    ramp.color_ramp.elements[1].position = 0.5
    tree.links.new(coordinate.outputs["Generated"], split.inputs[0])
    tree.links.new(split.outputs["X"], ramp.inputs[0])
    shader.inputs["Base Color"].default_value = (0, 0, 0, 1)
    if glows:
        tree.links.new(ramp.outputs["Color"], shader.inputs["Emission Color"])
        shader.inputs["Emission Strength"].default_value = 10
    else:
        tree.links.new(ramp.outputs["Color"], shader.inputs["Base Color"])
    return made


def test_procedural_emission_is_baked_to_a_texture() -> None:
    low, high = quad("Low", at=(-0.25, 0, -1)), quad("High", at=(0.25, 0, -1))
    panel = quad("Panel", 1, rotation_euler=(math.pi, 0, 0))
    panel.data.materials.append(procedural("Half a panel", glows=True))
    before = [len(getattr(bpy.data, name)) for name in ("scenes", "images", "meshes", "objects", "materials")]
    bake(error=2)
    bpy.ops.lightkiln.remove()
    after = [len(getattr(bpy.data, name)) for name in ("scenes", "images", "meshes", "objects", "materials")]
    assert after == before
    bake(error=2)
    # The left half of the square shines, so what lies below it gets more; nothing is green.
    left, right = irradiance(low), irradiance(high)
    squares = np.linspace(-0.5, 0.0, 201)[:-1] + 0.00125
    x, y = np.meshgrid(squares, np.linspace(-0.5, 0.5, 401)[:-1] + 0.00125)
    expected = [10 * (1 / ((x - at) ** 2 + y**2 + 1) ** 2).mean() * 0.5 for at in (-0.25, 0.25)]
    assert left[0] == pytest.approx(expected[0], rel=0.02)
    assert right[0] == pytest.approx(expected[1], rel=0.02)
    assert left[1] < 0.01 * left[0]
    assert any("baked to a texture" in note.message for note in bpy.context.scene.lightkiln.notes)


def test_procedural_colour_bounces() -> None:
    ceiling = quad("Ceiling", 0.02, (0, 0, 1), rotation_euler=(math.pi, 0, 0))
    ground = quad("Ground", 4)
    ground.data.materials.append(procedural("Half a ground", glows=False))
    lamp("SUN", energy=3, angle=0)
    ceiling.lightkiln.casts_shadow = False
    bake(density=8, error=2)
    value = irradiance(ceiling)
    # Half of the ground reflects all red light: at most half of what a full ground would send up.
    assert 0.3 * 3 < value[0] < 0.5 * 3
    assert value[1] < 0.02 * value[0]
