# SPDX-License-Identifier: GPL-3.0-or-later
"""Packs the extension: add-on files and a baker → one zip that Blender installs from disk.

    python3 blender_addon/build.py linux-x64=target/release/lightkiln windows-x64=lightkiln.exe --out dist

In: for every platform a baker built for it. Out: DIR/lightkiln-VERSION-PLATFORM.zip each, with the baker in bin/ and
the platform in the manifest. The same input gives the same bytes. Standard library only.
"""

from __future__ import annotations

import argparse
import tomllib
import zipfile
from pathlib import Path

HERE = Path(__file__).resolve().parent
PLATFORMS = ("linux-x64", "linux-arm64", "windows-x64", "windows-arm64", "macos-x64", "macos-arm64")
# Zip files cannot say when they were made if the same input is to give the same bytes.
EPOCH = (1980, 1, 1, 0, 0, 0)


def sources() -> list[Path]:
    """The add-on's own files."""
    kinds = {".py", ".toml", ""}
    files = [p for p in sorted(HERE.rglob("*")) if p.is_file() and p.suffix in kinds]
    return [p for p in files if "__pycache__" not in p.parts and p != Path(__file__).resolve() and "bin" not in p.parts]


def manifest(platform: str) -> str:
    """The manifest for one platform."""
    text = (HERE / "blender_manifest.toml").read_text()
    first_table = text.index("\n[permissions]")
    return f'{text[:first_table]}platforms = ["{platform}"]\n{text[first_table:]}'


def pack(platform: str, baker: Path, folder: Path) -> Path:
    """Writes the zip of one platform and returns its path."""
    version = tomllib.loads(manifest(platform))["version"]
    path = folder / f"lightkiln-{version}-{platform}.zip"
    program = "lightkiln.exe" if platform.startswith("windows") else "lightkiln"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=6) as archive:

        def add(name: str, data: bytes, mode: int) -> None:
            entry = zipfile.ZipInfo(name, EPOCH)
            entry.external_attr = mode << 16
            entry.compress_type = zipfile.ZIP_DEFLATED
            archive.writestr(entry, data)

        for source in sources():
            name = source.relative_to(HERE).as_posix()
            data = manifest(platform).encode() if name == "blender_manifest.toml" else source.read_bytes()
            add(name, data, 0o644)
        add(f"bin/{program}", baker.read_bytes(), 0o755)
    return path


def platform_and_baker(text: str) -> tuple[str, Path]:
    """Reads PLATFORM=FILE."""
    platform, _, file = text.partition("=")
    if platform not in PLATFORMS:
        raise argparse.ArgumentTypeError(f"`{platform}` is no platform; choose one of {', '.join(PLATFORMS)}")
    if not Path(file).is_file():
        raise argparse.ArgumentTypeError(f"`{file}` does not exist; build the baker with `cargo build --release`")
    return platform, Path(file)


def main() -> None:
    """Packs every platform asked for."""
    parser = argparse.ArgumentParser(description="Packs the Blender extension, one zip per platform.")
    parser.add_argument("bakers", nargs="+", type=platform_and_baker, metavar="PLATFORM=BAKER")
    parser.add_argument("--out", type=Path, default=HERE.parent / "dist", help="folder for the zips")
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    for platform, baker in arguments.bakers:
        print(pack(platform, baker, arguments.out))


if __name__ == "__main__":
    main()
