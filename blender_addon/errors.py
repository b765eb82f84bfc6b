# SPDX-License-Identifier: GPL-3.0-or-later
"""What can go wrong in a bake, in words for the artist: each names the object and the remedy."""

from __future__ import annotations

from dataclasses import dataclass


class BakeError(Exception):
    """The bake cannot go on; the message says why and what to do. The file is as it was."""


class Cancelled(Exception):
    """The user ended the bake."""


@dataclass(frozen=True)
class Note:
    """Something that was skipped or approximated: where, what, and what to do about it."""

    place: str
    message: str
    # APPROXIMATED: a material or lamp is not read exactly. WARNING: something else that the artist should know.
    kind: str = "WARNING"
