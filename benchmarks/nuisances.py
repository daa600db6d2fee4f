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
from benchmarks.salt import salt_option, seed
from benchmarks.totals import Frame, frame_of, node_figures
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


@dataclass(frozen=True)
class Suffered:
    """One nuisance. nodes: of frames called good. worst: the largest error, sigmas.

    nulled: share of the frames that the loop calls nulled; valid: of the nodes in view, when pressed.
    peak_percent: error of the peak, median, None where never nulled. states: in which the run was, by frames.
    """

    nuisance: str
    frames: int
    false: int
    nodes: list[Frame]
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
    nodes: list[Frame] = []
    peaks = []
    worst = 0.0
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
            off, sigma = surface.depth_mm[good] - true, surface.sigma_depth_mm[good]
            held = time_s > touch_s + SETTLED_S and step.peak is not None
            if good.any() and (held or time_s < touch_s - 0.02):
                nodes.append(frame_of(off, sigma, pressed=held))
                worst = max(worst, float(np.abs(off / sigma).max()))
            if held and step.peak is not None:
                valid = step.valid_share
                peak_off = step.peak.depth_mm - DEPTH_MM
                peaks.append((100 * peak_off / DEPTH_MM, abs(peak_off) / step.peak.sigma_mm))
        total = session.result.frames
    peak = np.median(peaks, axis=0) if peaks else None
    return Suffered(
        name, total, int(false), nodes, worst,
        float(1e6 * np.sqrt(np.median([one[4] for one in nodes if not one[0]] or [np.nan]))),
        None if peak is None else float(peak[0]), None if peak is None else float(peak[1]),
        nulled / max(total, 1), valid, states,
    )  # fmt: skip


def _beyond(one: Suffered, pressed: bool) -> str:
    """Share of nodes off by more than three sigma."""
    mine = [frame for frame in one.nodes if frame[0] is pressed]
    return f"{sum(frame[2] for frame in mine) / max(sum(frame[1] for frame in mine), 1):.2%}"


def report(found: Sequence[Suffered]) -> Report:
    """Figures with their bars."""
    false, frames = sum(one.false for one in found), sum(one.frames for one in found)
    nodes = [one.nodes for one in found]
    figures = (
        Figure("frames with a false touch", f"{false} of {frames}", "0", false == 0),
        *node_figures(nodes, nodes),
    )
    details: list[Sequence[str]] = [
        ("nuisance", "false touches", "> 3 sigma at rest", "pressed", "worst", "rms at rest", "peak",
         "in sigmas", "nulled", "valid")
    ]  # fmt: skip
    for one in found:
        peak = "-" if one.peak_percent is None else f"{one.peak_percent:+.2f} %"
        off = "-" if one.peak_sigmas is None else f"{one.peak_sigmas:.1f}"
        at_rest = _beyond(one, False), _beyond(one, True), f"{one.worst:.1f}"
        row = (one.nuisance, f"{one.false} of {one.frames}", *at_rest, f"{one.rms_untouched_nm:.0f} nm")
        details.append((*row, peak, off, f"{one.nulled:.0%}", f"{one.valid:.1%}"))
    return Report("Nuisances, one by one", figures, details, {"suffered": [asdict(one) for one in found]})


@benchmark(
    "nuisances",
    __doc__,
    click.option("--frames", default=600, help="Untouched frames of each."),
    salt_option,
    click.option("--full", is_flag=True, help="The packaged bench at full size."),
)
def command(*, quick: bool, frames: int, full: bool) -> Report:
    """Run all nuisances."""
    cases = [case for case in CASES if not quick or case[0] in QUICK]
    base = load_rig("simulated").replace({"simulation.seed": seed(0)}) if full else small_rig()
    found = []
    with progress(len(cases), "nuisances") as advance:
        for name, values in cases:
            rig = base.replace({f"simulation.{key}": value for key, value in values.items()})
            found.append(suffered(rig, name, frames))
            advance()
    return report(found)


if __name__ == "__main__":
    start(command)
