# SPDX-License-Identifier: GPL-3.0-or-later
"""A checker at true texel density over the lightmapped meshes, coloured by how the density compares with the setting.

One field of the checker is CHECK × CHECK texels. Blue: too few texels; green: as asked for; red: more than that.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import bpy
import gpu
import numpy as np
from gpu_extras.batch import batch_for_shader
from mathutils import Matrix

from .errors import BakeError
from .export.render_view import rendered_objects
from .receivers import candidates
from .unwrap import MAP

CHECK = 4
OPACITY = 0.85
_VERTEX = """void main() {
  texel = uv * texels;
  color = density_color;
  gl_Position = view_projection * vec4(position, 1.0);
  // Nearer by a hair than the surface itself.
  gl_Position.z -= 1e-4 * gl_Position.w;
}"""
_FRAGMENT = """void main() {
  vec2 field = floor(texel / check_size);
  float dark = mod(field.x + field.y, 2.0);
  fragment = vec4(color.rgb * mix(1.0, 0.55, dark), color.a);
}"""

Batch = tuple[gpu.types.GPUBatch, Matrix]
_handle: object | None = None
_batches: list[Batch] = []
_shader: gpu.types.GPUShader | None = None


def is_on() -> bool:
    """True if the overlay is shown."""
    return _handle is not None


def density_of(ob: bpy.types.Object, uv_map: str) -> float | None:
    """Texels per UV unit at the density that the object asks for; none if the map is missing or flat."""
    mesh = ob.data
    layer = mesh.uv_layers.get(uv_map)
    if layer is None or not mesh.polygons:
        return None
    mesh.calc_loop_triangles()
    loops = np.empty(3 * len(mesh.loop_triangles), np.int32)
    mesh.loop_triangles.foreach_get("loops", loops)
    uv = np.empty(2 * len(mesh.loops), np.float32)
    layer.uv.foreach_get("vector", uv)
    corners = uv.reshape(-1, 2)[loops].reshape(-1, 3, 2)
    a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    flat = float(np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum() / 2)
    scale = abs(ob.matrix_world.to_3x3().determinant()) ** (2 / 3)
    area = sum(p.area for p in mesh.polygons) * scale
    return math.sqrt(area / flat) if flat > 0 else None


def color_code(ratio: float) -> tuple[float, float, float, float]:
    """Blue for half the density and less, green for what is asked for, red for twice as much and more."""
    t = min(max(math.log2(max(ratio, 1e-6)), -1.0), 1.0)
    return (max(t, 0.0), 1.0 - abs(t), max(-t, 0.0), OPACITY)


def _build(scene: bpy.types.Scene, view_layer: bpy.types.ViewLayer) -> None:
    """Batches for every candidate that has a lightmap map. Texel size varies over a mesh, so colours go by triangle."""
    _batches.clear()
    visible = rendered_objects(view_layer)
    for ob in candidates(scene, view_layer).values():
        uv_map = ob.lightkiln.uv_map or MAP
        per_unit = density_of(ob, uv_map)
        if per_unit is None or ob not in visible:
            continue
        _batches.append((_batch(ob, uv_map, per_unit, scene), ob.matrix_world.copy()))


def _batch(ob: bpy.types.Object, uv_map: str, per_unit: float, scene: bpy.types.Scene) -> gpu.types.GPUBatch:
    mesh = ob.data
    loops = np.empty(3 * len(mesh.loop_triangles), np.int32)
    mesh.loop_triangles.foreach_get("loops", loops)
    vertices = np.empty(3 * len(mesh.loop_triangles), np.int32)
    mesh.loop_triangles.foreach_get("vertices", vertices)
    positions = np.empty(3 * len(mesh.vertices), np.float32)
    mesh.vertices.foreach_get("co", positions)
    positions = positions.reshape(-1, 3)[vertices]
    uv = np.empty(2 * len(mesh.loops), np.float32)
    mesh.uv_layers[uv_map].uv.foreach_get("vector", uv)
    uv = uv.reshape(-1, 2)[loops]
    texels = per_unit * (ob.lightkiln.density or scene.lightkiln.density)
    world = positions.reshape(-1, 3, 3) @ np.array(ob.matrix_world.to_3x3()).T
    crosses = np.cross(world[:, 1] - world[:, 0], world[:, 2] - world[:, 0])
    corners = uv.reshape(-1, 3, 2) * texels
    a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    in_texels = np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])
    density = np.sqrt(in_texels / np.maximum(np.linalg.norm(crosses, axis=1), 1e-12))
    colors = np.array([color_code(d / scene.lightkiln.density) for d in density.tolist()], np.float32)
    content = {"position": positions, "uv": uv * texels, "density_color": np.repeat(colors, 3, axis=0)}
    return batch_for_shader(_make_shader(), "TRIS", content)


def _make_shader() -> gpu.types.GPUShader:
    global _shader
    if _shader is None:
        info = gpu.types.GPUShaderCreateInfo()
        info.vertex_in(0, "VEC3", "position")
        info.vertex_in(1, "VEC2", "uv")
        info.vertex_in(2, "VEC4", "density_color")
        between = gpu.types.GPUStageInterfaceInfo("lightkiln_checker")
        between.smooth("VEC2", "texel")
        between.smooth("VEC4", "color")
        info.vertex_out(between)
        info.push_constant("MAT4", "view_projection")
        info.push_constant("FLOAT", "texels")
        info.push_constant("FLOAT", "check_size")
        info.fragment_out(0, "VEC4", "fragment")
        info.vertex_source(_VERTEX)
        info.fragment_source(_FRAGMENT)
        _shader = gpu.shader.create_from_info(info)
    return _shader


def _draw() -> None:
    shader = _make_shader()
    view = bpy.context.region_data.perspective_matrix
    gpu.state.depth_test_set("LESS_EQUAL")
    gpu.state.blend_set("ALPHA")
    shader.bind()
    shader.uniform_float("texels", 1.0)
    shader.uniform_float("check_size", float(CHECK))
    for batch, matrix in _batches:
        shader.uniform_float("view_projection", view @ matrix)
        batch.draw(shader)
    gpu.state.depth_test_set("NONE")
    gpu.state.blend_set("NONE")


def _redraw() -> None:
    for window in bpy.context.window_manager.windows:
        for area in window.screen.areas:
            area.tag_redraw()


def _show(context: bpy.types.Context) -> None:
    global _handle
    _build(context.scene, context.view_layer)
    add: Callable[..., object] = bpy.types.SpaceView3D.draw_handler_add
    _handle = add(_draw, (), "WINDOW", "POST_VIEW")


def _hide() -> None:
    global _handle
    if _handle is not None:
        bpy.types.SpaceView3D.draw_handler_remove(_handle, "WINDOW")
    _handle = None
    _batches.clear()


class LIGHTKILN_OT_checker(bpy.types.Operator):
    """Show a checker of 4 × 4 texels at true size. Green: the density that is set; blue: less; red: more"""

    bl_idname = "lightkiln.checker"
    bl_label = "Show Texel Density"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """There must be a window to draw in."""
        return not bpy.app.background

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Switches the overlay on or off; switching it on reads the meshes anew."""
        if is_on():
            _hide()
        else:
            try:
                _show(context)
            except BakeError as error:
                self.report({"ERROR"}, str(error))
                return {"CANCELLED"}
            if not _batches:
                self.report({"WARNING"}, "No object has a lightmap UV map yet: bake once, or choose maps of your own")
        _redraw()
        return {"FINISHED"}


@bpy.app.handlers.persistent
def _before_load(_path: object) -> None:
    _hide()


def register() -> None:
    """Registers the operator."""
    bpy.utils.register_class(LIGHTKILN_OT_checker)
    bpy.app.handlers.load_pre.append(_before_load)


def unregister() -> None:
    """Hides the overlay and removes the operator."""
    global _shader
    _hide()
    _shader = None
    bpy.app.handlers.load_pre.remove(_before_load)
    bpy.utils.unregister_class(LIGHTKILN_OT_checker)
