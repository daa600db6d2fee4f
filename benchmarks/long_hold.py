"""Whether anything drifts over ten thousand frames at rest and ten thousand with a press held.

Camera and LCD binned by 4 (drawn on the GPU), noise, jitter and free-running clocks on. The warp measured
and the warp commanded are compared with the true one over usable, valid nodes; depth is read in windows of
100 frames.

Error: rms over the nodes and frames of a window, so it holds noise and drift alike. Bar: in the last window
at most 1.1 times that in the window which starts 100 frames after the start (after the press). Depth peak:
mean over a window, given with its own standard error, as a single frame's noise would hide a drift
of 0.05 %. Drift: rms over the nodes of the change of the mean warp between first and last window; noise
explains a part.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, field

import numpy as np
from numpy.typing import NDArray

from benchmarks.report import Figure, Report, benchmark, start
from benchmarks.rigs import Bench, opened, pressed, small_rig, step_path
from zeromethod.arrays import Float
from zeromethod.loop.state import State
from zeromethod.loop.step import Step
from zeromethod.surface import SurfaceReader, peak
from zeromethod.view.progress import Advance, progress

FRAMES = 10_000
SETTLED_FRAMES = 100
WINDOW_FRAMES = 100
PRESS_S = 0.15
ERROR_RATIO = 1.1
PEAK_DRIFT_PERCENT = 0.05
GOOD = {State.LOCKED, State.RESTING}


@dataclass
class Window:
    """Figures of the frames [start, start + WINDOW_FRAMES) after the press; warps in LCD px, depth in mm.

    The camera's own count is meant: with a camera faster than the display, some frames are never read.
    """

    start: int
    measured: list[float] = field(default_factory=list)
    commanded: list[float] = field(default_factory=list)
    peaks_mm: list[float] = field(default_factory=list)
    depth_rms_mm: list[float] = field(default_factory=list)
    not_good: int = 0
    warp_sum: Float | None = None

    def add(
        self, step: Step, bench: Bench, true_q: Float, usable: NDArray[np.bool_], reader: SurfaceReader
    ) -> None:
        """Take one frame in."""
        self.not_good += step.state not in GOOD
        if step.measured is None:
            return
        nodes = usable & step.measured.valid
        self.measured.append(_mean_square(step.measured.q, true_q, nodes))
        self.commanded.append(_mean_square(step.commanded.q, true_q, usable))
        surface = reader.follow(step.measured)
        self.peaks_mm.append(peak(surface).depth_mm)
        truth = bench.truth(step.time_ns).depth(surface.x_mm[nodes], surface.y_mm[nodes])
        error = (surface.depth_mm[nodes] - truth)[surface.valid[nodes]]
        self.depth_rms_mm.append(float(np.sqrt(np.mean(error**2))))
        off = np.where(nodes[..., None], step.measured.q - true_q, 0.0)
        self.warp_sum = off if self.warp_sum is None else self.warp_sum + off

    @property
    def measured_px(self) -> float:
        """Rms error of the measured warp, LCD px."""
        return float(np.sqrt(np.mean(self.measured)))

    @property
    def commanded_px(self) -> float:
        """Rms error of the commanded warp, LCD px."""
        return float(np.sqrt(np.mean(self.commanded)))

    @property
    def peak_mm(self) -> float:
        """Mean depth peak."""
        return float(np.mean(self.peaks_mm))

    @property
    def peak_error_mm(self) -> float:
        """Standard error of `peak_mm`, frames taken as independent."""
        return float(np.std(self.peaks_mm) / np.sqrt(len(self.peaks_mm)))


def _mean_square(q: Float, true_q: Float, nodes: NDArray[np.bool_]) -> float:
    return float(np.mean(np.sum((q - true_q)[nodes] ** 2, axis=-1)))


def hold(depth_mm: float, frames: int, bar: Advance, settled: int = SETTLED_FRAMES) -> list[Window]:
    """Run `frames` frames after a step of `depth_mm` (0: at rest).

    Windows start at frame `settled`, at 1000 and 3000, and so that the last one ends with the run.
    """
    last = frames - WINDOW_FRAMES
    starts = sorted({settled, *(s for s in (1000, 3000) if settled < s < last), last})
    windows = [Window(start) for start in starts]
    with pressed(small_rig(), step_path(PRESS_S, depth_mm)) as rig, opened(rig) as bench:
        reader = SurfaceReader(rig, bench.optics, bench.loop.grid)
        mirror = bench.truth(round(2e9 * PRESS_S))
        usable, true_q = bench.usable(mirror), bench.true_warp(mirror)
        before = round(PRESS_S * rig.camera.rate_hz)
        for step in bench.loop.run(frames=before + frames):
            count = (step.frame_number or 0) - before
            for window in windows:
                if window.start <= count < window.start + WINDOW_FRAMES:
                    window.add(step, bench, true_q, usable, reader)
            bar()
    return windows


def _figures(name: str, windows: list[Window], depth_mm: float) -> list[Figure]:
    first, last = windows[0], windows[-1]
    figures = []
    for kind in ("measured_px", "commanded_px"):
        a, b = getattr(first, kind), getattr(last, kind)
        label = f"{name}: error of the {kind.removesuffix('_px')} warp, end / after {first.start} frames"
        figures.append(Figure(label, f"{b / a:.3f}", f"<= {ERROR_RATIO}", bool(b <= ERROR_RATIO * a)))
    assert first.warp_sum is not None
    assert last.warp_sum is not None
    drift = last.warp_sum / len(last.measured) - first.warp_sum / len(first.measured)
    nodes = drift.any(axis=-1)
    drift_px = float(np.sqrt(np.mean(np.sum(drift[nodes] ** 2, axis=-1))))
    noise_px = float(np.hypot(first.measured_px, last.measured_px) / np.sqrt(WINDOW_FRAMES))
    figures.append(
        Figure(
            f"{name}: drift of the mean warp",
            f"{1e3 * drift_px:.2f} mpx (independent noise: <{1e3 * noise_px:.2f})",
        )
    )
    if depth_mm:
        percent = 100 * (last.peak_mm - first.peak_mm) / first.peak_mm
        own = 100 * float(np.hypot(first.peak_error_mm, last.peak_error_mm)) / first.peak_mm
        figures.append(
            Figure(
                f"{name}: depth peak, end against after {first.start} frames",
                f"{percent:+.4f} % (+- {own:.4f})",
                f"within {PEAK_DRIFT_PERCENT} %",
                bool(abs(percent) <= PEAK_DRIFT_PERCENT),
            )
        )
    not_good = sum(window.not_good for window in windows)
    figures.append(
        Figure(f"{name}: frames of the windows that were not locked", str(not_good), "0", not_good == 0)
    )
    return figures


def _rows(name: str, windows: list[Window]) -> list[list[str]]:
    return [
        [
            f"{name}, frames {w.start} to {w.start + WINDOW_FRAMES}",
            f"{1e3 * w.measured_px:.2f}",
            f"{1e3 * w.commanded_px:.2f}",
            f"{1e3 * w.peak_mm:.4f} +- {1e3 * w.peak_error_mm:.4f}",
            f"{1e6 * float(np.sqrt(np.mean(np.square(w.depth_rms_mm)))):.1f}",
        ]
        for w in windows
    ]


def measure(frames: int, settled: int = SETTLED_FRAMES) -> Report:
    """Hold rest, then the press, for so many frames each."""
    figures: list[Figure] = []
    header = ["window", "measured, mpx", "commanded, mpx", "depth peak, um", "depth rms error, nm"]
    details: list[list[str]] = [header]
    data = {}
    with progress(2 * frames, "holding") as bar:
        for name, depth_mm in (("at rest", 0.0), ("pressed", 0.2)):
            windows = hold(depth_mm, frames, bar, settled)
            figures += _figures(name, windows, depth_mm)
            details += _rows(name, windows)
            data[name] = [
                {k: v for k, v in asdict(window).items() if k != "warp_sum"}
                | {"measured_px": window.measured_px, "commanded_px": window.commanded_px}
                for window in windows
            ]
    return Report(f"Long hold: {frames} frames at rest, {frames} pressed by 0.2 mm", figures, details, data)


@benchmark("long_hold", __doc__)
def command(quick: bool) -> Report:
    return measure(800 if quick else FRAMES)


if __name__ == "__main__":
    start(command)
