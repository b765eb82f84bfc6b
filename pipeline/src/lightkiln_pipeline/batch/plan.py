"""From manifest to tasks: globs → assets with their settings, output folders and cache keys."""

from __future__ import annotations

import hashlib
import json
import unicodedata
from collections import defaultdict
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from .. import __version__
from ..errors import UsageError
from .dependencies import KINDS, scene_files
from .manifest import Manifest, Settings


@dataclass(frozen=True)
class Asset:
    """A scene with what is wanted of it."""

    name: str
    """Its path relative to the manifest, without suffix, with forward slashes: unique in the batch."""
    scene: Path
    folder: Path
    """Where its results go."""
    settings: Settings
    fault: str = ""
    """Why it cannot be baked at all, or empty."""


@dataclass(frozen=True)
class Plan:
    """A batch, resolved."""

    root: Path
    """The folder of the manifest."""
    out: Path
    assets: list[Asset]


def make_plan(manifest: Manifest, path: Path) -> Plan:
    """Resolves globs. A later rule wins over an earlier one for the same scene.

    Raises UsageError if a rule matches nothing.
    """
    root = path.resolve().parent
    out = (root / manifest.out).resolve()
    chosen: dict[Path, Settings] = {}
    for number, rule in enumerate(manifest.assets):
        settings = manifest.settings(rule)
        excluded = {p for pattern in rule.exclude for p in _matches(root, pattern)}
        found = [p for pattern in rule.scenes for p in _matches(root, pattern) if p not in excluded]
        scenes = [p for p in found if p.suffix.lower() in KINDS and out not in p.resolve().parents]
        if not scenes:
            message = f"assets.{number}.scenes: {rule.scenes} match no scene ({' '.join(KINDS)})"
            raise UsageError(f"{path}: {message}; correct the globs, which are relative to the manifest")
        chosen |= dict.fromkeys(scenes, settings)
    return Plan(root, out, _assets(root, out, chosen))


def _matches(root: Path, pattern: str) -> list[Path]:
    """Files that match, in a fixed order. A pattern without wildcards may lead anywhere."""
    if not any(c in pattern for c in "*?["):
        path = root / pattern
        return [path] if path.is_file() else []
    base, rest = root, Path(pattern)
    if rest.is_absolute():
        base, rest = Path(rest.anchor), rest.relative_to(rest.anchor)
    while rest.parts and rest.parts[0] == "..":
        base, rest = base.parent, Path(*rest.parts[1:])
    return sorted(p for p in base.glob(rest.as_posix()) if p.is_file())


def _assets(root: Path, out: Path, chosen: dict[Path, Settings]) -> list[Asset]:
    """Assets with folders of their own; those whose folders would be the same are at fault."""
    names = {scene: _name(root, scene) for scene in chosen}
    # Two names that a file system may take for one: it may ignore case, or the way that accents are written.
    same: dict[str, list[Path]] = defaultdict(list)
    for scene, name in names.items():
        same[unicodedata.normalize("NFC", name).casefold()].append(scene)
    assets = []
    for scene, settings in sorted(chosen.items()):
        others = [p for p in same[unicodedata.normalize("NFC", names[scene]).casefold()] if p != scene]
        fault = ""
        if others:
            fault = f"its results would go to the same folder as those of {others[0]}; rename or exclude one of them"
        assets.append(Asset(names[scene], scene, out / names[scene], settings, fault))
    return assets


def _name(root: Path, scene: Path) -> str:
    try:
        relative = scene.relative_to(root)
    except ValueError:
        # Outside of the manifest's folder: its own folder's name keeps most of these apart.
        relative = Path(scene.parent.name) / scene.name
    stem = relative.name
    for suffix in (*KINDS, ".gltf"):
        stem = stem[: -len(suffix)] if stem.lower().endswith(suffix) else stem
    return (relative.parent / stem).as_posix()


@cache
def _file_hash(path: Path) -> str:
    with path.open("rb") as file:
        return (
            hashlib.file_digest(file, "sha256").hexdigest() if hasattr(hashlib, "file_digest") else _digest(file.read())
        )


def _digest(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()


def forget_files() -> None:
    """Files may have changed since they were hashed."""
    _file_hash.cache_clear()


def cache_key(asset: Asset, baker: str) -> str:
    """A hash of all that the result depends on: contents of files, settings, versions; not of times or of places."""
    files = scene_files(asset.scene)
    content: dict[str, Any] = {
        "files": [[path.name, _file_hash(path)] for path in files],
        "settings": _relevant(asset.settings),
        "baker": baker,
        "pipeline": __version__,
    }
    return _digest(json.dumps(content, sort_keys=True).encode())


def _relevant(settings: Settings) -> dict[str, Any]:
    """Settings that change the result."""
    return settings.model_dump(mode="json", exclude={"threads", "tiles", "retries", "timeout"})
