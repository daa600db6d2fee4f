"""Figures over many scenes with their standard errors, and what nodes called good say of their own errors."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from benchmarks.report import Figure, figure
from zeromethod.arrays import Float

SIGMAS = 3.0
_DRAWS = 400
"""Of the bootstrap: its standard error is then known to 4 %, 1 / sqrt(2 x draws)."""

Frame = tuple[bool, int, int, float, float, float]
"""Pressed; nodes, those beyond `SIGMAS`; their median sigma, mm; mean of error^2 and of (error / sigma)^2."""


def estimate(figure: Callable[..., Any], *columns: Any) -> tuple[float, float]:
    """A figure of columns with an entry for each independent scene, and its standard error.

    That is the scatter over draws of as many scenes with replacement: Efron 1979, doi:10.1214/aos/1176344552.
    """
    arrays = [np.asarray(column, dtype=float) for column in columns]
    count = len(arrays[0])
    if not count:
        return float("nan"), float("nan")
    picks = np.random.default_rng(0).integers(count, size=(_DRAWS, count))
    drawn = [figure(*(one[pick] for one in arrays)) for pick in picks]
    return float(figure(*arrays)), float(np.std(drawn)) if count > 1 else float("nan")


def rate(events: float, of: int) -> tuple[float, float]:
    """A share of independent cases and its standard error, which is not 0 where nothing happened.

    Wilson's interval at one sigma: Agresti & Coull 1998, doi:10.1080/00031305.1998.10480550.
    """
    near = (events + 0.5) / (of + 1)
    return events / of if of else float("nan"), float(np.sqrt(near * (1 - near) / (of + 1)))


def rms(values: ArrayLike) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(np.square(values))))


def ratio(parts: Float, wholes: Float) -> float:
    """Sum over sum."""
    return float(np.sum(parts) / max(np.sum(wholes), 1e-300))


def few_beyond(name: str, ratios: ArrayLike) -> Figure:
    """How many errors are beyond `SIGMAS`: at most 1.5 %, or one, of those that should be 0.3 %."""
    beyond, of = int(np.sum(np.abs(ratios) > SIGMAS)), np.size(ratios)
    most = max(round(0.015 * of), 1)
    return Figure(f"{name} beyond 3 sigma", f"{beyond} of {of}", f"<= {most}", beyond <= most)


def frame_of(error_mm: Float, sigma_mm: Float, *, pressed: bool) -> Frame:
    """What counts of a frame's nodes called good."""
    z = error_mm / sigma_mm
    beyond = int(np.count_nonzero(~(np.abs(z) <= SIGMAS)))
    squares = float(np.mean(error_mm**2)), float(np.mean(z**2))
    return pressed, len(z), beyond, float(np.median(sigma_mm)), *squares


def node_figures(scenes: Sequence[Sequence[Frame]], fair: Sequence[Sequence[Frame]]) -> list[Figure]:
    """Of the frames called good of scenes: nodes beyond their sigma; whether that is larger than errors are.

    fair: the scenes whose rig file tells the truth; sigma and nodes of a frame are theirs.
    """
    seen = [np.array(frames, dtype=float).T for frames in scenes if len(frames)]
    phases = [one[:, one[0] == phase] for one in seen for phase in (0, 1) if (one[0] == phase).any()]
    worst = max((float(np.median(one[2] / one[1])) for one in phases), default=float("nan"))
    nodes, beyond = ([one[row].sum() for one in seen] for row in (1, 2))
    honest = [
        one[:, one[0] > 0] for one in (np.array(f, dtype=float).T for f in fair if len(f)) if one[0].any()
    ]
    sigma = [np.median(one[3]) for one in honest]
    error = [rms(np.sqrt(one[4])) for one in honest]
    z = [rms(np.sqrt(one[5])) for one in honest]
    times = estimate(lambda s, e: np.median(s) / rms(e), sigma, error)
    valid = estimate(np.mean, [one[1].mean() for one in honest])
    return [
        figure("nodes called good beyond 3 sigma", *estimate(ratio, beyond, nodes), unit="%", most=0.01),
        figure(
            "nodes beyond 3 sigma, worst scene's median frame, untouched or pressed",
            worst,
            unit="%",
            most=0.03,
        ),
        figure("stated sigma of nodes, median, over rms error", *times, most=1.5),
        figure(
            "stated sigma of nodes, median",
            *_times(1e6, estimate(np.median, sigma)),
            unit="nm",
            most=1.3,
            of_other=True,
        ),
        figure("error of nodes, rms", *_times(1e6, estimate(rms, error)), unit="nm"),
        figure("error of nodes over sigma, rms", *estimate(rms, z)),
        figure("nodes valid in a frame called good", *valid, least=0.98, of_other=True),
    ]


def _times(factor: float, pair: tuple[float, float]) -> tuple[float, float]:
    return factor * pair[0], factor * pair[1]
