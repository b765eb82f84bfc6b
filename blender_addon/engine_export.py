# SPDX-License-Identifier: GPL-3.0-or-later
"""The scene with its lightmap for engines, as it is now: a lit GLB, or a USD with a layer over it, and the page as EXR.

Files go to the output folder. Nothing is baked, and the scene stays as it is.
"""

from __future__ import annotations

import importlib
import importlib.util
import shutil
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import bpy

from .apply import STATE, lit_objects, original_materials, set_view
from .errors import BakeError, Note
from .export.color_bake import baked_colors, wishes
from .export.snapshot import Snapshot, take
from .export.surfaces import read_surface
from .export.textures import read_pixels
from .export.write import Writer
from .places import Page, Place, Receiver
from .result_files import check_writable, output_folder, put, result_name

WHITE = (1.0, 1.0, 1.0)


def has_usd() -> bool:
    """True if this Blender can write USD and change it."""
    if not bpy.app.build_options.usd:
        return False
    if importlib.util.find_spec("pxr") is None:
        # Blender as a Python module has its packages in a folder of its own, which Python does not know.
        version = f"python{sys.version_info.major}.{sys.version_info.minor}"
        packages = Path(bpy.utils.resource_path("LOCAL")) / "python" / "lib" / version / "site-packages"
        if not (packages / "pxr").is_dir():
            return False
        sys.path.append(str(packages))
    return True


def write_glb(scene: bpy.types.Scene, layer: bpy.types.ViewLayer) -> tuple[list[Path], list[Note]]:
    """Writes the lit GLB and the page. Returns the files, and what could not be said exactly."""
    exr = _write_page(scene)
    image = scene.lightkiln.image
    with _originals(scene), _temporary() as folder:
        snapshot = take(scene, layer)
        page, lit = _laid_out(snapshot, image)
        writer = Writer(snapshot, page, lit)
        with baked_colors(wishes(page, lit, writer)) as baked:
            writer.collect(scene.world, folder, baked.colors)
        writer.embed_sky(folder)
        writer.show_lightmap(read_pixels(image), exr.name)
        writer.finish(folder / "scene.glb")
        return [put(scene, folder / "scene.glb", f"{result_name(scene)}.lit.glb"), exr], [*writer.notes, *baked.notes]


def write_usd(scene: bpy.types.Scene, layer: bpy.types.ViewLayer) -> list[Path]:
    """Writes the scene as Blender writes it, the lightmap's layer over it, and the page."""
    if not has_usd():
        raise BakeError(
            "This Blender has no USD, or no Python module for it: use one from blender.org, or export a lit GLB"
        )
    usd_layer = importlib.import_module(f"{__package__}.export.usd_layer")
    exr = _write_page(scene)
    name = result_name(scene)
    with _originals(scene), _temporary() as folder:
        source, target = folder / f"{name}.usdc", folder / f"{name}.lightmap.usda"
        known = {ob.name: _usd_object(ob, usd_layer) for ob in lit_objects(scene)}
        wanted = {
            "rename_uvmaps": False,
            "export_animation": False,
            "evaluation_mode": "RENDER",
            "export_custom_properties": True,
            "author_blender_name": True,
            "custom_properties_namespace": "userProperties",
            "use_instancing": False,
            "export_subdivision": "TESSELLATE",
            "export_textures_mode": "NEW",
            "relative_paths": True,
        }
        options = bpy.ops.wm.usd_export.get_rna_type().properties.keys()
        with bpy.context.temp_override(scene=scene, view_layer=layer):
            bpy.ops.wm.usd_export(filepath=str(source), **{k: v for k, v in wanted.items() if k in options})
        if usd_layer.write_layer(source, target, f"./{exr.name}", known.get) == 0:
            raise BakeError("No object of the USD shows the lightmap: make instanced objects real, or bake again")
        files = [put(scene, source, source.name), put(scene, target, target.name), exr]
        textures = folder / "textures"
        if textures.is_dir():
            shutil.copytree(textures, output_folder(scene) / "textures", dirs_exist_ok=True)
        return files


def _usd_object(ob: bpy.types.Object, usd_layer: object) -> object:
    """What the layer must know of an object."""
    bases = [read_surface(material).base for material in original_materials(ob)]
    plain = {base.factor if base.is_constant() else WHITE for base in bases}
    color = plain.pop() if len(plain) == 1 else WHITE
    state = ob[STATE]
    kind = getattr(usd_layer, "LitObject")  # noqa: B009 (the module is there only with USD)
    return kind(state["uv_map"], state["attribute"], color)


def _laid_out(snapshot: Snapshot, image: bpy.types.Image) -> tuple[Page, list[Receiver]]:
    """The page as it is shown: every instance that has a place."""
    by_uid = {ob.session_uid: ob for ob in bpy.data.objects}
    lit: list[Receiver] = []
    places = {}
    for instance in snapshot.instances:
        uid, parent, _ = instance.key
        ob, carrier = by_uid[uid], by_uid[parent or uid]
        state = ob.get(STATE)
        if not instance.addressable or state is None or state["attribute"] not in carrier:
            continue
        if state["uv_map"] in snapshot.meshes[instance.mesh].uv_maps:
            x, y, u, v = carrier[state["attribute"]]
            places[instance.key] = Place((x, y, u, v))
            lit.append(Receiver(instance, state["uv_map"], 0.0))
    if not lit:
        raise BakeError("No object that is rendered shows the lightmap: bake again")
    return Page(image.size[0], places, 1.0), lit


def _write_page(scene: bpy.types.Scene) -> Path:
    """The lightmap as an EXR in the output folder."""
    check_writable(scene)
    image, name = scene.lightkiln.image, f"{result_name(scene)}.exr"
    with _temporary() as folder:
        if image.packed_file:
            file = folder / name
            file.write_bytes(bytes(image.packed_file.data))
        else:
            file = Path(bpy.path.abspath(image.filepath))
            if not file.is_file():
                raise BakeError(f"The lightmap's file `{file}` is missing: bring it back, or bake again")
        target = output_folder(scene) / name
        return target if target.is_file() and file.samefile(target) else put(scene, file, name)


@contextmanager
def _originals(scene: bpy.types.Scene) -> Iterator[None]:
    """The scene with its own materials inside the block."""
    shown = scene.lightkiln.view
    set_view(scene, "ORIGINAL")
    try:
        yield
    finally:
        if shown != "ORIGINAL":
            set_view(scene, shown)


@contextmanager
def _temporary() -> Iterator[Path]:
    folder = Path(tempfile.mkdtemp(prefix="lightkiln-", dir=bpy.app.tempdir or None))
    try:
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)
