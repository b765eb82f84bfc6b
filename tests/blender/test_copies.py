"""Copies take the place of what cannot have a lightmap, and give it back."""

from __future__ import annotations

import math

import bpy
import numpy as np
import pytest

from tests.blender.scenes_in_blender import bake, irradiance, lamp, place, quad
from tests.blender.test_export import scatter
from tests.blender.test_lifecycle import state_of_file


def lit_from_above(x: float, y: float) -> float:
    """What a point lamp of 100 W at height 2 gives on the ground there."""
    squared = 4 + x * x + y * y
    return 100 / (4 * math.pi * squared) * 2 / math.sqrt(squared)


def test_instances_of_geometry_nodes_become_meshes_with_light() -> None:
    pebble = quad("Pebble", at=(0, 0, -5))
    field = quad("Field", 1)
    scatter(field, pebble)
    lamp("POINT", energy=100, shadow_soft_size=0)
    before = state_of_file()
    for ob in bpy.context.scene.objects:
        ob.select_set(ob == field)
    assert bpy.ops.lightkiln.make_copies() == {"FINISHED"}
    copies = [ob for ob in bpy.context.scene.objects if ob.name.startswith("Pebble Copy")]
    assert len(copies) == 4
    assert len({ob.data.name for ob in copies}) == 1
    bake()
    for ob in copies:
        expected = lit_from_above(*ob.matrix_world.translation[:2])
        assert irradiance(ob) == pytest.approx(np.full(3, expected), rel=0.005)
    bpy.ops.lightkiln.remove()
    assert bpy.ops.lightkiln.restore_originals() == {"FINISHED"}
    assert state_of_file() == before
    assert not field.hide_render


def test_repeated_faces_become_faces_of_their_own() -> None:
    ob = quad("Tile")
    array = ob.modifiers.new("Array", "ARRAY")
    array.use_relative_offset, array.use_constant_offset = False, True
    array.constant_offset_displace = (0.5, 0, 0)
    lamp("POINT", energy=100, shadow_soft_size=0)
    ob.select_set(True)
    bpy.ops.lightkiln.make_copies()
    copy = bpy.data.objects["Tile Copy"]
    bake()
    assert len(copy.data.polygons) == 2
    for face in copy.data.polygons:
        expected = lit_from_above(*face.center[:2])
        assert irradiance(copy, face.index) == pytest.approx(np.full(3, expected), rel=0.005)


def test_texts_become_meshes() -> None:
    text = bpy.data.curves.new("Text", "FONT")
    text.body = "Kiln"
    ob = place("Text", text)
    ob.select_set(True)
    assert bpy.ops.lightkiln.make_copies() == {"FINISHED"}
    assert bpy.data.objects["Text Copy"].type == "MESH"
    assert ob.hide_render
    bpy.ops.lightkiln.restore_originals()
    assert not ob.hide_render and "Text Copy" not in bpy.data.objects
