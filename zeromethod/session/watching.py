"""A run's watch camera: the approaching object that it sees is added to every step, and arms the loop."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import closing, contextmanager
from dataclasses import replace

from zeromethod.approach import Approach, Watch
from zeromethod.clock import Clock
from zeromethod.devices.watch_camera import watch_opener
from zeromethod.loop.loop import Loop
from zeromethod.loop.step import Step
from zeromethod.rig.model import Rig

_SAID = tuple(
    f"{of}{name}" for name in ("x_mm", "y_mm", "diameter_mm", "speed_mm_s") for of in ("", "sigma_")
)


def approach_rows(seen: Iterable[tuple[int, Approach | None]], start_ns: int) -> list[dict[str, float]]:
    """One row per approach that armed the loop: when it was armed, and what was expected last; s of the run.

    seen: time of each step, and what the watch camera saw in it. start_ns: time of the first step.
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


@contextmanager
def watching(rig: Rig, clock: Clock, loop: Loop) -> Iterator[Callable[[Step], Step]]:
    """A function that adds the watch camera's result to a step, and arms or disarms the loop for the next.

    Without a watch camera, steps stay as they are. Raises InputError where it cannot be opened or sees
    nothing.
    """
    if rig.watch is None:
        yield lambda step: step
        return
    with closing(Watch(rig, clock, watch_opener(rig, clock))) as watch:

        def seen(step: Step) -> Step:
            approach = watch.look()
            loop.coming = approach.words if approach.armed else ""
            return replace(step, approach=approach, notes=step.notes + watch.note())

        yield seen
