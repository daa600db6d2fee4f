"""Speed and accuracy of this system, the peers and the bounds, in one run on the same frames and threads.

displacement: time, error and noise over the Cramer-Rao bound. integration: slopes to depth. loop: the whole
circle. scaling: time and memory over the frame's size. why: open loop against null.
"""

from __future__ import annotations

import os
import platform
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from importlib.metadata import version
from typing import Any

import cv2

from benchmarks.against_peers import displacement, integration, loop, open_loop, scaling
from benchmarks.against_peers.methods import DIS_FAST, RESIDUAL
from benchmarks.report import figure

Figures = dict[str, Any]
OnStep = Callable[[str], None]

MOST_OF_BOUND, MOST_OF_DIS_FAST, MOST_LOOP_OF_DIS_FAST, MOST_READING_OF_DIS_FAST = 1.1, 0.2, 0.30, 0.55
"""The bars: noise and error of the residual over its bound; its time, the loop's and a reading's over that of
DIS fast."""

_LIBRARIES = ("zeromethod", "numpy", "scipy", "numba")


@dataclass(frozen=True)
class Part:
    """One part: how many steps it reports, and what fills its figures."""

    steps: Callable[[bool], int]
    measure: Callable[[Figures, OnStep, bool], None]


def _why(figures: Figures, on_step: OnStep, quick: bool) -> None:
    figures.update(open_loop.compare_open_loop(on_step, quick=quick))


PARTS: dict[str, Part] = {
    "displacement": Part(displacement.steps, displacement.measure),
    "integration": Part(integration.steps, integration.measure),
    "loop": Part(loop.steps, loop.measure),
    "scaling": Part(scaling.steps, scaling.measure),
    "why": Part(open_loop.steps, _why),
}


def steps(parts: Sequence[str], quick: bool) -> int:
    """How often `run_parts` reports a step."""
    return sum(PARTS[part].steps(quick) for part in parts)


def run_parts(figures: Figures, parts: Sequence[str], on_step: OnStep, quick: bool) -> None:
    """Fill `figures` with the host and these parts, so that what is measured stays when it is interrupted.

    The caller limits the threads (`limit_threads(1)`) for all parts alike.
    """
    figures.update(host=host(), quick=quick, parts=list(parts))
    for part in parts:
        PARTS[part].measure(figures.setdefault(part, {}), on_step, quick)


def host() -> Figures:
    """What the times depend on."""
    return {
        "machine": platform.machine(),
        "system": platform.system(),
        "cores": os.cpu_count(),
        "threads": cv2.getNumThreads(),
        "python": platform.python_version(),
        "opencv": cv2.__version__,
        "versions": {name: version(name) for name in _LIBRARIES},
    }


def bars(figures: Figures) -> list[Figures]:
    """Figures with a bar that were measured, as `benchmarks.report`'s. The loop's are for the full frame."""
    residual = figures.get("displacement", {}).get("methods", {}).get(RESIDUAL, {})
    near_null = residual.get("null", {})
    loop_figures = {} if figures.get("quick") else figures.get("loop", {})
    asked = (
        ("residual: noise over its bound", residual.get("noise_of_bound"), MOST_OF_BOUND),
        ("residual: rms error over its bound", residual.get("error_of_bound"), MOST_OF_BOUND),
        (f"residual: time over that of {DIS_FAST}", near_null.get("of_dis_fast"), MOST_OF_DIS_FAST),
        (
            f"loop, frame in to warp out: time over that of {DIS_FAST}",
            loop_figures.get("loop_of_dis_fast"),
            MOST_LOOP_OF_DIS_FAST,
        ),
        (
            f"reading, warp to surface and peak: time over that of {DIS_FAST}",
            loop_figures.get("read_of_dis_fast"),
            MOST_READING_OF_DIS_FAST,
        ),
    )
    return [asdict(figure(what, value, most=bar)) for what, value, bar in asked if value is not None]


__all__ = ["PARTS", "bars", "host", "run_parts", "steps"]
