# SPDX-License-Identifier: GPL-3.0-or-later
"""Where results go: a lightmap's image in Blender, packed or beside the .blend, and the lit GLB."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import bpy

from .errors import BakeError

LINEAR = "Linear Rec.709"
# What the baker calls its page.
PAGE = "lightmap_0.exr"


def check_folder(scene: bpy.types.Scene) -> None:
    """Raises BakeError, before anything is baked, if the results could not be kept."""
    settings = scene.lightkiln
    if settings.storage == "FILE" or settings.write_glb:
        check_writable(scene)


def check_writable(scene: bpy.types.Scene) -> None:
    """Raises BakeError if the output folder cannot take files."""
    settings = scene.lightkiln
    if settings.folder.startswith("//") and not bpy.data.filepath:
        raise BakeError(
            f"The output folder `{settings.folder}` is beside the .blend, which is not saved: "
            "save the file, choose another folder, or keep the lightmap in the .blend"
        )
    folder = output_folder(scene)
    existing = next(p for p in (folder, *folder.parents) if p.exists())
    if not existing.is_dir():
        raise BakeError(f"The output folder `{folder}` is a file: choose another folder")
    if not os.access(existing, os.W_OK) or _is_immutable(existing):
        raise BakeError(f"The folder `{existing}` cannot be written: choose another output folder")


def _is_immutable(folder: Path) -> bool:
    """True if the system refuses new files although the permissions would allow them."""
    probe = folder / f".lightkiln-{os.getpid()}"
    try:
        probe.touch()
        probe.unlink()
    except OSError:
        return True
    return False


def output_folder(scene: bpy.types.Scene) -> Path:
    """The folder of the scene's settings."""
    return Path(bpy.path.abspath(scene.lightkiln.folder))


def result_name(scene: bpy.types.Scene) -> str:
    """Name of the scene's files: of the .blend and the scene, so that neither of two overwrites the other's."""
    stem = Path(bpy.data.filepath).stem or "untitled"
    return bpy.path.clean_name(f"{stem}_{scene.name}")


def store_image(scene: bpy.types.Scene, exr: Path) -> bpy.types.Image:
    """Keeps the lightmap as the settings say. The image of an earlier bake shows the new one."""
    packed = scene.lightkiln.storage == "PACKED"
    path = exr
    if not packed:
        path = put(scene, exr, f"{result_name(scene)}.exr")
    image = scene.lightkiln.image
    if image is None:
        image = bpy.data.images.load(str(path))
        image.name = f"{scene.name} Lightmap"
    else:
        if image.packed_file:
            image.unpack(method="REMOVE")
        image.filepath = str(path)
        image.reload()
    image.colorspace_settings.name = LINEAR
    image.alpha_mode = "NONE"
    if packed:
        image.pack()
        image.filepath = f"//{result_name(scene)}.exr"
    elif bpy.data.filepath and scene.lightkiln.folder.startswith("//"):
        image.filepath = bpy.path.relpath(str(path))
    return image


def store_groups(scene: bpy.types.Scene, results: Path) -> str:
    """Keeps the light of all groups and returns its folder: a name beside the lightmap.

    For a lightmap that is packed it is a whole path, of a folder that lasts until Blender is closed.
    """
    settings = scene.lightkiln
    name = f"{result_name(scene)}.groups"
    packed = settings.storage == "PACKED"
    folder = Path(bpy.app.tempdir) / name if packed else output_folder(scene) / name
    folder.mkdir(parents=True, exist_ok=True)
    empty_groups(folder)
    # What relighting starts from comes last: without it the folder counts as empty.
    found = results.glob("solution.lk") if packed else (*results.glob("lightmap_0.*.exr"), *results.glob("solution.lk"))
    for file in found:
        shutil.copyfile(file, folder / file.name)
    return str(folder) if packed else name


def empty_groups(folder: Path) -> None:
    """Removes the light groups of an earlier bake."""
    for old in (*folder.glob("lightmap_0.*.exr"), *folder.glob("solution.lk")):
        old.unlink()


def store_glb(scene: bpy.types.Scene, glb: Path) -> Path:
    """Keeps the lit GLB in the output folder and returns its path."""
    return put(scene, glb, f"{result_name(scene)}.lit.glb")


def put(scene: bpy.types.Scene, source: Path, name: str) -> Path:
    """Copies a file into the output folder; it appears under its name only when it is whole."""
    folder = output_folder(scene)
    folder.mkdir(parents=True, exist_ok=True)
    target, partial = folder / name, folder / f".{name}.{os.getpid()}"
    try:
        shutil.copyfile(source, partial)
        partial.replace(target)
    finally:
        partial.unlink(missing_ok=True)
    return target
