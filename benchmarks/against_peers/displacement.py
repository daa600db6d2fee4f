"""Displacement from one picture of the carriers (or several): time, error, noise over its bound.

All contenders read frames of the same planted scenes in the same rounds, each on one thread, in an order
that turns from round to round. Near null: a bump of 0.6 px. Large press: one of 40 px over 100 px, which
asks for the carrier's order; what comes out is one step, which the loop would repeat on a new picture.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.against_peers.bound import MARGIN_PX, bound_px, measured_window_power
from benchmarks.against_peers.frames import PERIOD_PX, SIGMA_GREY, Bump, noisy
from benchmarks.against_peers.methods import CONTENDERS, DIS_FAST, Contender, Displacement

Figures = dict[str, Any]
OnStep = Callable[[str], None]

NULL_BUMP, PRESS_BUMP = (0.6, 200.0), (40.0, 100.0)
"""(peak px, width px) of the scenes at 1280x1024; the widths go with the frame's size, and so the strain."""

FULL_ROWS = 1024

FEWEST_ROUNDS = 2
"""The first is not timed, and noise is a difference."""


@dataclass(frozen=True)
class Effort:
    """How much is measured."""

    shape: tuple[int, int]
    null_rounds: int
    press_rounds: int
    most_realisations: int


FULL = Effort((FULL_ROWS, 1280), 9, 4, 8)
QUICK = Effort((512, 640), 4, 3, 3)


def steps(quick: bool) -> int:
    """How often `measure` reports a step."""
    effort = QUICK if quick else FULL
    return 1 + len(CONTENDERS) + effort.null_rounds + effort.press_rounds


def measure(figures: Figures, on_step: OnStep, quick: bool) -> None:
    """Fill `figures` as they are measured: "methods" by name, with times in ms and errors in camera px."""
    effort = QUICK if quick else FULL
    rng = np.random.default_rng(0)
    rows, cols = effort.shape
    scale = rows / FULL_ROWS
    figures.update(
        frame_px=[cols, rows], sigma_grey=SIGMA_GREY, period_px=PERIOD_PX, press_px=PRESS_BUMP[0] * scale
    )
    methods: dict[str, Figures] = figures.setdefault("methods", {})
    contenders = [make(effort.shape) for make in CONTENDERS.values()]
    for contender in contenders:
        methods[contender.name] = {"frames_per_reading": len(contender.pattern.shots)}
    on_step("displacement")
    for name, (peak, width), rounds in (
        ("null", NULL_BUMP, effort.null_rounds),
        ("press", PRESS_BUMP, effort.press_rounds),
    ):
        scene = Scene(Bump(effort.shape, peak * (scale if name == "press" else 1), width * scale), contenders)
        try:
            for turn in range(rounds):
                scene.round(turn, rng)
                on_step(f"displacement, {name}")
        finally:  # interrupted, the rounds so far count
            if scene.rounds >= FEWEST_ROUNDS:
                for method, found in scene.figures().items():
                    methods[method][name] = found
    for contender in contenders:
        power = measured_window_power(contender, effort.shape, effort.most_realisations, rng)
        found, bound = methods[contender.name], bound_px(power.value, contender.pattern)
        found.update(
            window_sum_w2=power.value,
            window_sum_w2_error=power.error,
            bound_px=bound,
            noise_of_bound=found["null"]["noise_px"] / bound,
            error_of_bound=found["null"]["rms_error_px"] / bound,
        )
        on_step(f"impulse response: {contender.name}")


class Scene:
    """One planted bump, read by everyone in rounds of frames with new noise."""

    def __init__(self, bump: Bump, contenders: list[Contender]) -> None:
        self._bump, self._contenders = bump, contenders
        everywhere = bump.everywhere()
        patterns = {contender.pattern for contender in contenders}
        self._grey = {pattern: pattern.light_grey(everywhere) for pattern in patterns}
        self.rounds = 0
        self._ms: dict[str, list[float]] = {contender.name: [] for contender in contenders}
        self._tally = {contender.name: _Tally() for contender in contenders}

    def round(self, turn: int, rng: np.random.Generator) -> None:
        """Let everyone read frames of the same instant; the first round's times are those of cold caches."""
        frames = {pattern: noisy(grey, SIGMA_GREY, rng) for pattern, grey in self._grey.items()}
        first = turn % len(self._contenders)
        for contender in self._contenders[first:] + self._contenders[:first]:
            started = time.perf_counter()
            read = contender.read(frames[contender.pattern])
            self._ms[contender.name].append(1e3 * (time.perf_counter() - started))
            self._tally[contender.name].add(*_judged(contender, read, self._bump))
        self.rounds += 1

    def figures(self) -> dict[str, Figures]:
        """Figures by method; `FEWEST_ROUNDS` are needed."""
        ms = {name: np.array(values[1:]) for name, values in self._ms.items()}
        reference = float(np.median(ms[DIS_FAST]))
        return {
            name: {
                "ms": {"median": float(np.median(ms[name])), "p90": float(np.percentile(ms[name], 90))},
                "of_dis_fast": float(np.median(ms[name])) / reference,
                "rms_error_px": tally.rms_error,
                "median_error_px": tally.median_error,
                "noise_px": tally.noise,
                "valid_share": tally.valid_share,
            }
            for name, tally in self._tally.items()
        }


def _judged(
    contender: Contender, read: Displacement, bump: Bump
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(read, error), each (rows, cols, 2), of the lattice's points inside the margin."""
    skip = -(-(MARGIN_PX - contender.first_px) // contender.spacing_px)
    inside = (slice(skip, -skip), slice(skip, -skip))
    u, v = (place[inside] for place in contender.places(read))
    found = np.array(read[inside], np.float64)
    with np.errstate(invalid="ignore"):
        return found, found - bump.at(u, v)


class _Tally:
    """Running sums over rounds of what one method read and how wrong it was."""

    def __init__(self) -> None:
        self._count = 0
        self._mean: Any = 0.0
        self._square: Any = 0.0
        self._errors: list[float] = []
        self._medians: list[float] = []
        self._shares: list[float] = []

    def add(self, read: NDArray[np.float64], error: NDArray[np.float64]) -> None:
        """Take in one round (Welford's update, so that large displacements do not drown small noise)."""
        self._count += 1
        delta = read - self._mean
        self._mean = self._mean + delta / self._count
        self._square = self._square + delta * (read - self._mean)
        good = np.isfinite(error).all(axis=-1)
        self._shares.append(float(np.mean(good)))
        self._errors.append(float(np.mean(error[good] ** 2)) if good.any() else float("nan"))
        self._medians.append(float(np.median(np.abs(error[good]))) if good.any() else float("nan"))

    @property
    def rms_error(self) -> float:
        """Error per component, px rms over valid points and rounds."""
        return float(np.sqrt(np.mean(self._errors)))

    @property
    def median_error(self) -> float:
        """Median magnitude of the error per component, px."""
        return float(np.mean(self._medians))

    @property
    def noise(self) -> float:
        """Standard deviation per component from round to round, px rms over the points valid in all."""
        return float(np.sqrt(np.nanmean(self._square / (self._count - 1))))

    @property
    def valid_share(self) -> float:
        """Share of the points that the method itself calls valid."""
        return float(np.mean(self._shares))
