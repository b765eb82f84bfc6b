"""The manifest of a batch: TOML → checked settings. Every fault is named with its line and remedy.

The models below are the schema; `lightkiln-batch schema` prints it as JSON Schema, and manifest.schema.json holds a
copy.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from ..errors import UsageError

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

_Positive = Annotated[float, Field(gt=0)]


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class UsdOptions(_Strict):
    """How USD scenes are read."""

    level: Annotated[int, Field(ge=0, le=6, description="Refinements of subdivision surfaces.")] = 1
    purposes: Annotated[list[Literal["default", "render", "proxy", "guide"]], Field(min_length=1)] = [
        "default",
        "render",
    ]
    time: Annotated[float | None, Field(description="Time code; the earliest if none is given.")] = None
    variants: Annotated[dict[str, str], Field(description='"/Prim{set}" = "variant".')] = {}
    sky_if_unlit: Annotated[float, Field(ge=0, description="Sky of a scene without light, W/(m²·sr).")] = 1.0
    layer: Annotated[Literal["usdc", "usda", "none"], Field(description="Kind of the layer with the result.")] = "usdc"


TextureFormat = Literal["tx", "exr", "hdr", "rgbm", "rgbd", "logluv", "ktx2", "bc6h"]


class TextureOptions(_Strict):
    """Further files that are made of every lightmap page."""

    formats: list[TextureFormat] = []
    range: Annotated[_Positive, Field(description="Largest value that RGBM holds.")] = 8.0
    ocio_config: Annotated[str | None, Field(description="OCIO configuration: a file or ocio://default.")] = None
    working_space: Annotated[str | None, Field(description="Colour space of the textures in that configuration.")] = (
        None
    )

    @model_validator(mode="after")
    def _both(self) -> TextureOptions:
        if self.ocio_config is not None and self.working_space is None:
            raise ValueError("ocio_config needs working_space: the name of the colour space to convert to")
        return self


class Settings(_Strict):
    """What can be set for an asset, or in a preset. What is not set is the baker's default."""

    error: Annotated[str | None, Field(pattern=r"^[0-9.]+%?$", description='Error to aim for, "2%" or "0.02".')] = None
    texels_per_metre: _Positive | None = None
    resolution: Annotated[int | None, Field(ge=16, le=16384)] = None
    uv: Annotated[Literal["auto", "keep", "pack"] | None, Field(description="Not for USD, which is always packed.")] = (
        None
    )
    unwrapper: Literal["xatlas", "fast"] | None = None
    padding: Annotated[int | None, Field(ge=0, le=64)] = None
    quantity: Literal["irradiance", "radiance", "radiosity"] | None = None
    groups: Annotated[bool, Field(description="Pages for every light group, and what `lightkiln relight` needs.")] = (
        False
    )
    light: Annotated[
        Literal["combined", "direct", "indirect"] | None,
        Field(description="All light, what comes straight from lamps, or the rest. Not with groups."),
    ] = None
    audit: Annotated[
        Literal["auto", "thorough", "off"] | None, Field(description="How much to spend on finding the error reached.")
    ] = None
    float_pages: Annotated[bool, Field(description="32-bit pages.")] = False
    light_units: Literal["photometric", "radiometric"] | None = None
    threads: Annotated[int | None, Field(ge=1)] = None
    tiles: Annotated[
        int, Field(ge=1, le=1024, description="Parts that a cluster or a farm gathers apart, each on any machine.")
    ] = 1
    retries: Annotated[int, Field(ge=0, le=10, description="Further attempts after a crash.")] = 1
    timeout: Annotated[_Positive | None, Field(description="Seconds after which an attempt ends.")] = None
    usd: UsdOptions = UsdOptions()
    textures: TextureOptions = TextureOptions()

    @model_validator(mode="after")
    def _one_kind_of_part(self) -> Settings:
        if self.groups and self.light not in (None, "combined"):
            raise ValueError("groups are parts of all light; leave out light, or set groups = false")
        return self


class AssetRule(Settings):
    """Scenes by glob, with a preset and settings of their own."""

    scenes: Annotated[list[str], Field(min_length=1, description="Globs relative to the manifest; ** for any depth.")]
    exclude: list[str] = []
    preset: str | None = None


class Manifest(_Strict):
    """A batch."""

    out: Annotated[str, Field(min_length=1, description="Folder for the results, relative to the manifest.")] = (
        "lightmaps"
    )
    jobs: Annotated[int, Field(ge=1, le=256, description="Assets at a time.")] = 1
    presets: dict[str, Settings] = {}
    assets: Annotated[list[AssetRule], Field(min_length=1)]

    @model_validator(mode="after")
    def _presets_exist(self) -> Manifest:
        for rule in self.assets:
            if rule.preset is not None and rule.preset not in self.presets:
                known = ", ".join(sorted(self.presets)) or "none"
                raise ValueError(f"preset `{rule.preset}` does not exist; those that do: {known}")
        return self

    def settings(self, rule: AssetRule) -> Settings:
        """The rule's settings over those of its preset."""
        base = self.presets[rule.preset].model_dump(exclude_unset=True) if rule.preset else {}
        own = rule.model_dump(exclude_unset=True, exclude={"scenes", "exclude", "preset"})
        merged = {**base, **own}
        for nested in ("usd", "textures"):
            if nested in base or nested in own:
                merged[nested] = {**base.get(nested, {}), **own.get(nested, {})}
        return Settings.model_validate(merged)


def load_manifest(path: Path) -> Manifest:
    """Reads a manifest. Raises UsageError with every fault, its line and its remedy."""
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise UsageError(f"{path}: the manifest cannot be read: {error}") from error
    try:
        data = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise UsageError(f"{path}: not valid TOML: {error}; correct the line") from error
    try:
        return Manifest.model_validate(data)
    except ValidationError as error:
        faults = [_fault(text, dict(e)) for e in error.errors()]
        raise UsageError("\n".join(f"{path}:{line}: {message}" for line, message in faults)) from error


def _fault(text: str, error: dict[str, Any]) -> tuple[int, str]:
    place = tuple(error["loc"])
    name = ".".join(str(p) for p in place) or "manifest"
    line = line_of(text, place)
    if error["type"] == "extra_forbidden":
        return line, f"unknown key `{place[-1]}`; remove it or use one of: {', '.join(_known_keys(place[:-1]))}"
    if error["type"] == "missing":
        return line, f"`{name}` is missing; add it"
    message = str(error["msg"]).removeprefix("Value error, ")
    return line, f"`{name}`: {message[0].lower()}{message[1:]}; it is {error['input']!r}" if place else message


def _known_keys(place: tuple[str | int, ...]) -> list[str]:
    """Keys that a table may have."""
    models: dict[str, type[BaseModel]] = {"usd": UsdOptions, "textures": TextureOptions, "presets": Settings}
    names = [p for p in place if isinstance(p, str)]
    if not names:
        model: type[BaseModel] = Manifest
    elif names[-1] in ("usd", "textures"):
        model = models[names[-1]]
    else:
        model = Settings if names[0] == "presets" else AssetRule
    return sorted(model.model_fields)


def line_of(text: str, place: tuple[str | int, ...]) -> int:
    """The line, from 1, where the value at `place` stands: its key, else the nearest table around it."""
    tables: dict[tuple[str, ...], int] = {}
    current: tuple[str | int, ...] = ()
    best, depth = 1, -1
    for number, line in enumerate(text.splitlines(), 1):
        header = re.match(r"\s*(\[\[?)\s*([^\]]+?)\s*\]\]?", line)
        assigned = re.match(r"\s*([\w\-]+|\"[^\"]*\"|'[^']*')(\s*\.\s*[\w\-\"']+)*\s*=", line)
        if header and not assigned:
            current = _table(header.group(1) == "[[", _parts(header.group(2)), tables)
            found = current
        elif assigned:
            found = current + tuple(_parts(line.split("=", 1)[0]))
        else:
            continue
        shared = 0
        while shared < min(len(found), len(place)) and found[shared] == place[shared]:
            shared += 1
        if shared == len(found) and shared > depth:
            best, depth = number, shared
    return best


def _parts(key: str) -> list[str]:
    return [a or b or c for a, b, c in re.findall(r"\"([^\"]*)\"|'([^']*)'|([\w\-]+)", key)]


def _table(is_array: bool, parts: list[str], counts: dict[tuple[str, ...], int]) -> tuple[str | int, ...]:
    """The place of a table, with the number of the array entry that it is in."""
    if is_array:
        counts[tuple(parts)] = counts.get(tuple(parts), -1) + 1
    place: list[str | int] = []
    for i, part in enumerate(parts):
        place.append(part)
        if tuple(parts[: i + 1]) in counts:
            place.append(counts[tuple(parts[: i + 1])])
    return tuple(place)
