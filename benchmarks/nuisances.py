"""What a bench suffers besides presses, one at a time: false touches, and depth against its own sigma.

Each nuisance at two strengths on the packaged bench with four times larger pixels (--full: as it is): room
light through the rubber, lamps on the mains (at the camera's rate their light beats slowly), a backlight that
drifts, dust and scratches on the camera face, bubbles in the rubber, rubber that grows warmer. All are there
from the first frame on. Untouched for --frames frames, every contact is a false one; then a press of 0.1 mm
comes and stays. Compared are the nodes called valid in frames that the loop calls nulled, from the rig file's
geometry: their depth less the true one, over their sigma.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import click
import numpy as np

from benchmarks.report import Figure, Report, benchmark, start
from benchmarks.rigs import pressed, small_rig
from zeromethod.loop.state import NULLED
from zeromethod.rig.load import load_rig
from zeromethod.rig.model import Rig
from zeromethod.session.session import Session
from zeromethod.view.progress import progress

CASES: Sequence[tuple[str, dict[str, Any]]] = (
    ("none", {}),
    ("room light 3 %", {"ambient": 0.03}),
    ("room light 10 %", {"ambient": 0.1}),
    ("mains light 1 %, 100 Hz", {"nuisances.mains": 0.01}),
    ("mains light 5 %, 100 Hz", {"nuisances.mains": 0.05}),
    ("backlight +0.5 % a minute", {"nuisances.backlight_per_minute": 0.005}),
    ("backlight -20 % a minute", {"nuisances.backlight_per_minute": -0.2}),
    ("dust, 5 specks", {"nuisances.dust": 5}),
    ("dust, 40 specks", {"nuisances.dust": 40}),
    ("2 scratches", {"nuisances.scratches": 2}),
    ("8 scratches", {"nuisances.scratches": 8}),
    ("3 bubbles", {"nuisances.bubbles": 3}),
    ("15 bubbles", {"nuisances.bubbles": 15}),
    ("0.1 K a minute warmer", {"nuisances.kelvin_per_minute": 0.1}),
    ("2 K a minute warmer", {"nuisances.kelvin_per_minute": 2.0}),
)
QUICK = ("none", "dust, 40 specks", "8 scratches", "15 bubbles")
DEPTH_MM = 0.1
HELD_S, SETTLED_S = 0.6, 0.2
EVERY = 5
"""Of the untouched frames every such one's depth is compared."""
BEYOND_PERCENT = 1.0
"""Share of the nodes called good that may be off by more than three sigma."""


@dataclass(frozen=True)
class Suffered:
    """One nuisance. beyond: nodes off by more than three sigma, percent; worst: the largest error, sigmas.

    nulled: share of the frames that the loop calls nulled; valid: of the nodes in view, when pressed.
    peak_percent: error of the peak, median, None where never nulled. states: in which the run was, by frames.
    """

    nuisance: str
    frames: int
    false: int
    beyond_untouched: float
    beyond_pressed: float
    worst: float
    rms_untouched_nm: float
    peak_percent: float | None
    peak_sigmas: float | None
    nulled: float
    valid: float
    states: dict[str, int]


def suffered(rig: Rig, name: str, frames: int) -> Suffered:
    """Run one nuisance."""
    touch_s = frames / rig.camera.rate_hz
    path = [(touch_s, 0.0), (touch_s + 0.05, DEPTH_MM), (touch_s + HELD_S, DEPTH_MM)]
    untouched, held, peaks, rms = [], [], [], []
    states: dict[str, int] = {}
    false = nulled = valid = 0.0
    with pressed(rig, path) as bench, Session(bench) as session:
        truth = session.result.true_mirror
        assert truth is not None
        for step in session.run(seconds=touch_s + HELD_S):
            states[str(step.state)] = states.get(str(step.state), 0) + 1
            false += bool(step.contacts)
            nulled += step.state in NULLED
            time_s = 1e-9 * step.time_ns
            surface = step.surface
            if surface is None or step.state not in NULLED or (time_s < touch_s and step.number % EVERY):
                continue
            good = surface.valid
            true = truth(step.time_ns).depth(surface.x_mm[good], surface.y_mm[good])
            off = surface.depth_mm[good] - true
            sigmas = off / surface.sigma_depth_mm[good]
            if time_s < touch_s - 0.02:
                untouched.append(sigmas)
                rms.append(1e6 * float(np.sqrt(np.mean(off**2))))
            elif time_s > touch_s + SETTLED_S and step.peak is not None:
                held.append(sigmas)
                valid = step.valid_share
                peak_off = step.peak.depth_mm - DEPTH_MM
                peaks.append((100 * peak_off / DEPTH_MM, abs(peak_off) / step.peak.sigma_mm))
        total = session.result.frames
    peak = np.median(peaks, axis=0) if peaks else None
    return Suffered(
        name, total, int(false), _beyond(untouched), _beyond(held),
        max((float(np.abs(one).max()) for one in untouched + held), default=float("nan")),
        float(np.median(rms)) if rms else float("nan"),
        None if peak is None else float(peak[0]), None if peak is None else float(peak[1]),
        nulled / max(total, 1), valid, states,
    )  # fmt: skip


def _beyond(sigmas: list[Any]) -> float:
    """Percent of errors of more than three sigma; 0 where nothing was called good."""
    return 100 * float(np.mean(np.abs(np.concatenate(sigmas)) > 3)) if sigmas else 0.0


def report(found: Sequence[Suffered]) -> Report:
    """Figures with their bars."""
    false, frames = sum(one.false for one in found), sum(one.frames for one in found)
    worst = max(found, key=lambda one: max(one.beyond_untouched, one.beyond_pressed))
    share = max(worst.beyond_untouched, worst.beyond_pressed)
    words = f"{share:.2f} % ({worst.nuisance})"
    figures = (
        Figure("frames with a false touch", f"{false} of {frames}", "0", false == 0),
        Figure(
            "nodes off by more than 3 sigma, worst", words, f"{BEYOND_PERCENT:g} %", share <= BEYOND_PERCENT
        ),
    )
    details: list[Sequence[str]] = [
        ("nuisance", "false touches", "> 3 sigma at rest", "pressed", "worst", "rms at rest", "peak",
         "in sigmas", "nulled", "valid")
    ]  # fmt: skip
    for one in found:
        peak = "-" if one.peak_percent is None else f"{one.peak_percent:+.2f} %"
        off = "-" if one.peak_sigmas is None else f"{one.peak_sigmas:.1f}"
        at_rest = f"{one.beyond_untouched:.2f} %", f"{one.beyond_pressed:.2f} %", f"{one.worst:.1f}"
        row = (one.nuisance, f"{one.false} of {one.frames}", *at_rest, f"{one.rms_untouched_nm:.0f} nm")
        details.append((*row, peak, off, f"{one.nulled:.0%}", f"{one.valid:.1%}"))
    return Report("Nuisances, one by one", figures, details, {"suffered": [asdict(one) for one in found]})


@benchmark(
    "nuisances",
    __doc__,
    click.option("--frames", default=600, help="Untouched frames of each."),
    click.option("--full", is_flag=True, help="The packaged bench at full size."),
)
def command(*, quick: bool, frames: int, full: bool) -> Report:
    """Run all nuisances."""
    cases = [case for case in CASES if not quick or case[0] in QUICK]
    base = load_rig("simulated") if full else small_rig()
    found = []
    with progress(len(cases), "nuisances") as advance:
        for name, values in cases:
            rig = base.replace({f"simulation.{key}": value for key, value in values.items()})
            found.append(suffered(rig, name, frames))
            advance()
    return report(found)


if __name__ == "__main__":
    start(command)
