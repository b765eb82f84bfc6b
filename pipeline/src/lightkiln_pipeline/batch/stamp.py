"""Marks finished results: a folder's stamp says what was baked, from what, and how it went.

A stamp is written last and removed first, so that a folder with a stamp is whole whenever the batch is killed.
"""

from __future__ import annotations

import json
import os
import shutil
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

NAME = "batch.json"
_SCHEMA = "lightkiln-batch-asset/1"


@dataclass
class Stamp:
    """What is known of a finished asset."""

    key: str
    scene: str
    baker: str
    seconds: float
    files: dict[str, int]
    """Result files with their sizes in bytes."""
    notes: list[list[str]] = field(default_factory=list)
    """Place and message."""
    facts: dict[str, Any] = field(default_factory=dict)
    """Figures for the report."""


def read_stamp(folder: Path) -> Stamp | None:
    """The folder's stamp, none without one or if it cannot be read."""
    try:
        data = json.loads((folder / NAME).read_text(encoding="utf-8"))
        if data.pop("schema") != _SCHEMA:
            return None
        return Stamp(**data)
    except (OSError, ValueError, TypeError, KeyError):
        return None


def is_current(folder: Path, key: str) -> bool:
    """True if the folder holds whole results of that key."""
    stamp = read_stamp(folder)
    if stamp is None or stamp.key != key:
        return False
    try:
        return all((folder / name).stat().st_size == size for name, size in stamp.files.items())
    except OSError:
        return False


def publish(work: Path, folder: Path, stamp: Stamp) -> None:
    """Moves the files of `work` into `folder`, in place of older results, and stamps it."""
    folder.mkdir(parents=True, exist_ok=True)
    old = read_stamp(folder)
    (folder / NAME).unlink(missing_ok=True)
    stamp.files = {}
    for path in sorted(p for p in work.rglob("*") if p.is_file()):
        name = path.relative_to(work).as_posix()
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        stamp.files[name] = path.stat().st_size
        path.replace(folder / name)
    for name in set(old.files if old else {}) - set(stamp.files):
        (folder / name).unlink(missing_ok=True)
    shutil.rmtree(work, ignore_errors=True)
    write_atomically(folder / NAME, json.dumps({"schema": _SCHEMA, **asdict(stamp)}, indent=1, ensure_ascii=False))


def write_atomically(path: Path, text: str) -> None:
    """Writes a text file that appears whole."""
    partial = path.with_name(f".{path.name}.{os.getpid()}")
    partial.write_text(text, encoding="utf-8")
    partial.replace(path)
