"""What can go wrong: faults that stop the work on a scene, and notes on what was left out.

PipelineError            exit code 1: the scene, or what was asked of it
├─ UsageError            exit code 2: arguments or manifest cannot be understood
└─ EnvironmentFault      exit code 3: programs, folders, disk
"""

from __future__ import annotations

from dataclasses import dataclass


class PipelineError(Exception):
    """The scene cannot be processed; the message says why and what to do."""

    exit_code = 1


class UsageError(PipelineError):
    """The arguments or the manifest cannot be understood."""

    exit_code = 2


class EnvironmentFault(PipelineError):
    """Something outside the scene is missing: a program, a folder, space."""

    exit_code = 3


@dataclass(frozen=True, order=True)
class Note:
    """Something that was left out or replaced while the work went on."""

    place: str
    """Prim path or file that it is about."""
    message: str
    """The fault, what was done instead, and the remedy."""

    def __str__(self) -> str:
        """One line for people."""
        return f"{self.place}: {self.message}"


class Notes:
    """Collects notes, each once, in the order in which they come up."""

    def __init__(self) -> None:
        """No notes yet."""
        self._notes: dict[Note, None] = {}

    def add(self, place: object, message: str) -> None:
        """Adds a note about `place`."""
        self._notes[Note(str(place), message)] = None

    def list(self) -> list[Note]:
        """All notes, first come first."""
        return list(self._notes)
