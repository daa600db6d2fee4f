"""Decoding of fringes against plain arctangent and unwrapping, on the same frames of planted benches.

Fringes of ladders of three to five periods, the LCD drawn without its inverse response (gamma 2.2), 8 bits,
a mirror that covers a part of a dark image: raw, linearised by the inverse response, whole and cropped to the
mirror. "ours" is `measure_rest`, "plain" gives every pixel a place and none a reason. Errors are rms
over the pixels of the mirror that ours calls valid. Times are of the processor, each the least of some calls
in turn, after a first one. Images of less than 100 x 100 px have no bar in time: plain then takes less than
what ours needs for any image, and that is given. plain: numpy in double precision, as one writes it; "fast":
single precision, a product of matrices per set.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from benchmarks.fringe_bench import PANEL, FringeBench, linearised
from benchmarks.peers.hierarchical_unwrapping import places
from benchmarks.report import Figure, Report, benchmark, start
from zeromethod.arrays import Float, Image, Mask
from zeromethod.decoding.measuring import measure_rest

LADDERS = ((2133.0, 256.0, 30.0), (2133.0, 492.0, 121.0, 30.0), (2133.0, 640.0, 192.0, 58.0, 17.0))
LIT = (0.02, 0.23, 0.6, 1.0)
SHIFTS = (3, 4, 5, 6)
MOST_TIME = 10.0
SMALL_PX = 100
LEAST_VALID = 0.99


@dataclass(frozen=True)
class Row:
    """One set of frames; errors in LCD px, times in s of the processor."""

    name: str
    shape: tuple[int, int]
    ours_px: float
    plain_px: float
    valid: float
    outside: float
    error_over_sigma: float
    ours_s: float
    plain_s: float
    fast_s: float

    @property
    def ratio(self) -> float:
        """Our time over plain's."""
        return self.ours_s / self.plain_s

    @property
    def small(self) -> bool:
        """Whether the image has less than `SMALL_PX` squared."""
        return self.shape[0] * self.shape[1] < SMALL_PX**2


def _timed(count: int, *calls: Callable[[], Any]) -> tuple[list[float], list[Any]]:
    """Least time and result of every call, called in turn."""
    results = [call() for call in calls]
    taken = [[math.inf] for _ in calls]
    for _ in range(count):
        for times, call in zip(taken, calls, strict=True):
            begun = time.process_time()
            call()
            times.append(time.process_time() - begun)
    return [min(times) for times in taken], results


def _measured(name: str, bench: FringeBench, frames: Image, truth: Float, mirror: Mask, calls: int) -> Row:
    periods = bench.periods_px
    times, (found, plain, _) = _timed(
        calls,
        lambda: measure_rest(frames, bench.sequence, size_px=PANEL),
        lambda: places(frames, periods),
        lambda: places(frames, periods, np.float32),
    )
    rest = found.rest_map
    both = rest.valid & mirror
    off, plain_off = (rest.lcd_px - truth)[both], (plain - truth)[both]
    return Row(
        name,
        rest.valid.shape,
        float(np.sqrt(np.mean(off**2))),
        float(np.sqrt(np.mean(plain_off**2))),
        float(both.sum() / mirror.sum()),
        float(np.mean(rest.valid & ~mirror)),
        float(np.std(off / rest.sigma_px[both])),
        *times,
    )


def benches(quick: bool) -> Iterator[FringeBench]:
    """Every ladder with every share of lit image, and with every number of shifts."""
    for ladder in LADDERS:
        for lit in LIT[1:2] if quick else LIT:
            yield FringeBench(ladder, lit=lit)
        for shifts in SHIFTS:
            if shifts != 4 and not quick:
                yield FringeBench(ladder, shifts)


def rows(bench: FringeBench, calls: int) -> Iterator[Row]:
    """Raw and linearised, whole and cropped to the mirror."""
    raw = bench.frames()
    name = f"{len(bench.periods_px)} periods, {bench.shifts} shifts, {bench.lit:.0%} lit"
    for kind, frames in (("raw", raw), ("linearised", linearised(raw))):
        yield _measured(f"{name}, {kind}", bench, frames, bench.truth, bench.mirror, calls)
        if bench.lit < 1:
            window = bench.window
            cropped = np.ascontiguousarray(frames[(slice(None), *window)])
            truth, mirror = bench.truth[window], bench.mirror[window]
            yield _measured(f"{name}, {kind}, cropped", bench, cropped, truth, mirror, calls)


@benchmark("decoding", __doc__)
def command(quick: bool) -> Report:
    """Measure every set."""
    every = [row for bench in benches(quick) for row in rows(bench, 5 if quick else 9)]
    worst = max(every, key=lambda row: row.ours_px / row.plain_px)
    slowest = max((row for row in every if not row.small), key=lambda row: row.ratio)
    small = max((row for row in every if row.small), key=lambda row: row.ours_s, default=None)
    fewest = min(every, key=lambda row: row.valid)
    scatter = sorted(row.error_over_sigma for row in every)
    outside = max(row.outside for row in every)
    figures = (
        Figure(
            "error, ours over plain, worst",
            f"{worst.ours_px / worst.plain_px:.3f} ({worst.name})",
            "1 or less",
            worst.ours_px <= worst.plain_px,
        ),
        Figure(
            "time, ours over plain, longest",
            f"{slowest.ratio:.1f} ({slowest.name})",
            "10 or less",
            slowest.ratio <= MOST_TIME,
        ),
        *(
            [
                Figure(
                    f"time of an image below {SMALL_PX} x {SMALL_PX} px, longest",
                    f"{1e3 * small.ours_s:.0f} ms",
                )
            ]
            if small
            else []
        ),
        Figure(
            "valid share of the mirror, least",
            f"{fewest.valid:.4f} ({fewest.name})",
            "0.99 or more",
            fewest.valid >= LEAST_VALID,
        ),
        Figure("valid outside the mirror, most", f"{outside:.4f}", "0", outside == 0),
        Figure(
            "error over its sigma, rms",
            f"{scatter[0]:.2f} to {scatter[-1]:.2f}",
            "0.9 to 1.1",
            scatter[0] >= 0.9 and scatter[-1] <= 1.1,
        ),
    )
    header = (
        "set",
        "ours, px",
        "plain, px",
        "valid",
        "error / sigma",
        "ours, ms",
        "plain, ms",
        "ratio",
        "of fast",
    )
    details = [
        (
            row.name,
            f"{row.ours_px:.4f}",
            f"{row.plain_px:.4f}",
            f"{row.valid:.4f}",
            f"{row.error_over_sigma:.2f}",
            f"{1e3 * row.ours_s:.0f}",
            f"{1e3 * row.plain_s:.1f}",
            f"{row.ratio:.1f}",
            f"{row.ours_s / row.fast_s:.0f}",
        )
        for row in every
    ]
    data = {"sets": [asdict(row) for row in every]}
    return Report("decoding of fringes against arctangent and unwrapping", figures, (header, *details), data)


if __name__ == "__main__":
    start(command)
