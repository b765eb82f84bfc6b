# SPDX-License-Identifier: GPL-3.0-or-later
"""What to do about a changed scene: its light as it was baked and as it is now → factors per light group, and what only
a bake can bring. Knows nothing of Blender."""

from __future__ import annotations

from dataclasses import dataclass

from .light_state import OTHERS, LightState, Source

Rgb = tuple[float, float, float]
UNCHANGED: Rgb = (1.0, 1.0, 1.0)
OFF: Rgb = (0.0, 0.0, 0.0)
# Relative difference that is rounding.
TOLERANCE = 1e-4


@dataclass(frozen=True)
class Plan:
    """Factors of all groups, and sentences on what needs a bake."""

    factors: dict[str, Rgb]
    stale: list[str]

    @property
    def changes_light(self) -> bool:
        """True if any light is not as it was baked."""
        return any(factor != UNCHANGED for factor in self.factors.values())

    def settings(self) -> list[str]:
        """What the baker is told to set; it wants at least one change."""
        changed = {group: f for group, f in self.factors.items() if f != UNCHANGED}
        listed = changed or dict(list(self.factors.items())[:1])
        return [f"{group}={','.join(f'{c:.6g}' for c in factor)}" for group, factor in listed.items()]


def plan(baked: LightState, now: LightState) -> Plan:
    """How to bring the lightmap of `baked` as near to `now` as relighting can."""
    stale: list[str] = []
    wanted: dict[str, list[tuple[Source, Rgb]]] = {}
    pairs, added = _matched(baked.sources, now.sources)
    for before, after in pairs:
        factor = _factor(before, after, stale)
        if before.group:
            wanted.setdefault(before.group, []).append((before, factor))
    stale += [f"{_called(s)} is new" for s in added if max(s.strength) > 0]
    factors: dict[str, Rgb] = {}
    for group, members in wanted.items():
        first = members[0][1]
        if all(_same(factor, first) for _, factor in members):
            factors[group] = first
        else:
            factors[group] = UNCHANGED
            names = ", ".join(sorted({s.name for s, _ in members})[:3])
            remedy = "join lamps in groups, there are more than 32" if group == OTHERS else "give each its own"
            stale.append(f"{names} share the light group `{group}` and changed differently: {remedy}")
    return Plan(factors, stale + _other_changes(baked, now))


def _matched(before: list[Source], after: list[Source]) -> tuple[list[tuple[Source, Source | None]], list[Source]]:
    """Pairs of a source and what has become of it; then those that are new. Renamed ones are found by what they are."""
    left = list(after)
    pairs: list[tuple[Source, Source | None]] = []
    for source in before:
        same = [s for s in left if s.kind == source.kind and s.name == source.name]
        # One material may shine in several groups; one that gave no light may have any.
        found = next((s for s in same if s.group == source.group), same[0] if same else None)
        if found:
            left.remove(found)
        pairs.append((source, found))
    for i, (source, found) in enumerate(pairs):
        if found is None:
            renamed = next((s for s in left if _what(s) == _what(source)), None)
            if renamed:
                left.remove(renamed)
                pairs[i] = (source, renamed)
    return pairs, left


def _what(source: Source) -> tuple[object, ...]:
    return (source.kind, source.place, source.shape, tuple(f"{c:.4g}" for c in source.strength))


def _factor(before: Source, after: Source | None, stale: list[str]) -> Rgb:
    """By what the light of a source is multiplied."""
    if after is None:
        return OFF
    if after.shape != before.shape:
        stale.append(f"{_called(after)} has another shape, kind or picture")
        return UNCHANGED
    if after.place != before.place:
        stale.append(f"{_called(after)} was moved")
    ratios = [a / b if b > 0 else 1.0 for b, a in zip(before.strength, after.strength, strict=True)]
    if any(b <= 0 < a for b, a in zip(before.strength, after.strength, strict=True)):
        what = "light" if max(before.strength) <= 0 else "light of one of its colours"
        stale.append(f"{_called(after)} gave no {what} when it was baked")
    elif not before.group and max(after.strength) > 0 and not _same(_rgb(ratios), UNCHANGED):
        stale.append(f"{_called(after)} gave no light when it was baked")
    if min(ratios) < 0:
        stale.append(f"{_called(after)} takes light away, which counts as none")
    factor = _rgb([max(ratio, 0.0) for ratio in ratios])
    return UNCHANGED if _same(factor, UNCHANGED) else factor


def _rgb(values: list[float]) -> Rgb:
    return (values[0], values[1], values[2])


def _same(a: Rgb, b: Rgb) -> bool:
    return all(abs(x - y) <= TOLERANCE * max(abs(x), abs(y)) for x, y in zip(a, b, strict=True))


def _called(source: Source) -> str:
    words = {"lamp": "the lamp", "material": "the emission of", "world": "the world"}
    return f"{words[source.kind]} `{source.name}`"


def _other_changes(baked: LightState, now: LightState) -> list[str]:
    """Objects and materials that are not as they were."""
    stale: list[str] = []
    gone = {name: state for name, state in baked.objects.items() if name not in now.objects}
    for name, state in now.objects.items():
        before = baked.objects.get(name)
        if before is None:
            renamed = next((n for n, s in gone.items() if s == state), None)
            if renamed is None:
                stale.append(f"the object `{name}` is new")
            else:
                del gone[renamed]
        elif before[0] != state[0]:
            stale.append(f"the object `{name}` was moved")
        elif before[1] != state[1]:
            stale.append(f"the object `{name}` was edited")
    stale += [f"the object `{name}` is gone" for name in gone]
    for name, look in now.looks.items():
        if baked.looks.get(name, look) != look:
            stale.append(f"the material `{name}` reflects differently")
    return stale
