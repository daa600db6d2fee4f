"""What waits to be passed on to the process that writes."""

from __future__ import annotations

from dataclasses import dataclass, replace

from zeromethod.loop.step import Step
from zeromethod.surface import Peak, Surface


@dataclass(frozen=True, slots=True)
class Turn:
    """What waits of a turn. bytes: of its arrays, 0 without. late: there was no room for them to wait.

    lost: turns before it of which nothing at all was kept.
    """

    step: Step
    phase: str
    bytes: int
    late: bool
    lost: int


@dataclass(frozen=True, slots=True)
class Reading:
    """What waits of a reading. surface: None where its arrays are not kept."""

    step: Step
    surface: Surface | None
    peak: Peak
    read_ms: float
    bytes: int


def without_arrays(step: Step) -> Step:
    """A turn of which the tables alone are kept."""
    presented = tuple(replace(one, q=step.commanded.q) for one in step.presented)
    return replace(step, image=None, residual=None, measured=None, shown=None, presented=presented)
