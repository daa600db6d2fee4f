"""A run's watch camera: what comes goes into every step, and arms the loop."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import replace

from zeromethod.approach import Approach, Watch
from zeromethod.clock import Clock
from zeromethod.devices.watch import watch_opener
from zeromethod.loop.loop import Loop
from zeromethod.loop.step import Step
from zeromethod.rig.model import Rig

_SAID = tuple(
    f"{of}{name}" for name in ("x_mm", "y_mm", "diameter_mm", "speed_mm_s") for of in ("", "sigma_")
)


def approach_rows(seen: Iterable[tuple[int, Approach | None]], start_ns: int) -> list[dict[str, float]]:
    """One row per approach that armed the loop: since when, and what was expected last; s of the run.

    seen: time of each step, and what its watch camera saw. start_ns: time of the first step.
    """
    rows: list[dict[str, float]] = []
    armed = False
    for time_ns, one in seen:
        before, armed = armed, one is not None and one.armed
        if not armed or one is None:
            continue
        if not before:
            rows.append({"armed_s": 1e-9 * (time_ns - start_ns)})
        seen_s = 1e-9 * (one.time_ns - start_ns)
        rows[-1] |= {"contact_s": seen_s + one.contact_s, "sigma_contact_s": one.sigma_contact_s}
        rows[-1] |= {name: getattr(one, name) for name in _SAID}
    return rows


class Watching:
    """Asks the watch camera once per step; does nothing for a rig without one."""

    def __init__(self, watch: Watch | None, loop: Loop) -> None:
        self._watch, self._loop = watch, loop

    def seen(self, step: Step) -> Step:
        """The step with what comes; the loop is armed for the next one, or is so no more."""
        if self._watch is None:
            return step
        approach = self._watch.look()
        self._loop.coming = approach.words if approach.armed else ""
        return replace(step, approach=approach, notes=step.notes + self._watch.note())


@contextmanager
def watching(rig: Rig, clock: Clock, loop: Loop) -> Iterator[Watching]:
    """The watch camera that a rig has, open. Raises InputError where it cannot be opened or sees nothing."""
    if rig.watch is None:
        yield Watching(None, loop)
        return
    watch = Watch(rig, clock, watch_opener(rig, clock))
    try:
        yield Watching(watch, loop)
    finally:
        watch.close()
