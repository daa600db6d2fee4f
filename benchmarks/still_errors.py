"""What is left in the mean of frames of a mirror at rest: errors that noise hides in one frame.

Without noise, in 16 bits, the clocks of camera and LCD free (60 and 59.94 Hz, 8 ms, two pictures in most
exposures): LCD codes rounded to 8 bits, and the chip's fixed pattern (`pixel_gain` 1 %, `pixel_offset_grey` 1
of 255). Measured warps of consecutive frames of the locked loop are averaged and read; true depth is 0. A
moving target has seen every phase in 32 frames.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from benchmarks.report import Figure, Report, benchmark, start
from zeromethod.arrays import Float
from zeromethod.optics import Optics
from zeromethod.rig.binning import binned
from zeromethod.rig.load import load_rig
from zeromethod.rig.model import Rig
from zeromethod.session.session import Session
from zeromethod.surface import SurfaceReader
from zeromethod.view.progress import progress
from zeromethod.warp.warp import Warp

FRAMES = (1, 4, 8, 16, 32)
SETTLED = 24
"""Frames until the loop rests on what it has measured without noise."""

QUIET = {
    "scenario": "none",
    "camera.bits": 16,
    "camera.noise.read_grey": 0.0,
    "camera.noise.electrons_per_grey": None,
    "simulation.display_refresh_hz": 60.0,
    "simulation.camera_rate_hz": 59.94,
    "simulation.camera_phase": 0.3,
}
PATTERN = {"simulation.nuisances.pixel_gain": 0.01, "simulation.nuisances.pixel_offset_grey": 257.0}
CARRY, STEP = {"target.carry": True}, {"target.step": 16}
CASES: tuple[tuple[str, Mapping[str, Any]], ...] = (
    ("rounded codes", {}),
    ("summed as light (carry)", CARRY),
    ("moving target (step 16)", STEP),
    ("both", CARRY | STEP),
    ("rounded codes, fixed pattern", PATTERN),
    ("both, fixed pattern", PATTERN | CARRY | STEP),
)


def left_nm(rig: Rig, optics: Optics) -> list[float]:
    """Depth rms of means of the last so many frames, nm, for `FRAMES`."""
    with Session(rig) as session:
        reader = SurfaceReader(rig, optics, session.loop.grid, with_sigma=False)
        steps = session.run(frames=SETTLED + max(FRAMES))
        kept = [step.measured for step in steps if step.measured is not None]
    found = []
    for count in FRAMES:
        q: Float = np.mean([one.q for one in kept[-count:]], axis=0)
        flags = np.bitwise_or.reduce([one.flags for one in kept[-count:]])
        surface = reader.read(Warp(q, kept[-1].sigma, flags, kept[-1].time_ns))
        found.append(1e6 * float(np.sqrt(np.mean(surface.depth_mm[surface.valid] ** 2))))
    return found


def measure(factor: int) -> Report:
    """All cases, on the packaged bench with camera pixels so many times as large."""
    rows = []
    figures: dict[str, list[float]] = {}
    with progress(len(CASES), "cases") as advance:
        for name, values in CASES:
            rig = binned(load_rig("simulated"), factor).replace(QUIET | dict(values))
            figures[name] = left_nm(rig, Optics(rig))
            rows.append([name, *(f"{one:.2f}" for one in figures[name])])
            advance()
    header = ["depth rms, nm, of the mean of", *(f"{count} frames" for count in FRAMES)]
    one, sixteen = figures["rounded codes"][0], figures["both, fixed pattern"][3]
    shown = [
        Figure("rounded codes, one frame", f"{one:.2f} nm", "", None),
        Figure("both, with the chip's fixed pattern, 16 frames", f"{sixteen:.2f} nm", "", None),
    ]
    return Report("Errors that stay at rest", shown, [header, *rows], {"nm": figures, "frames": FRAMES})


@benchmark("still_errors", __doc__)
def command(quick: bool) -> Report:
    """Camera pixels twice as large; four times for a quick look."""
    return measure(4 if quick else 2)


if __name__ == "__main__":
    start(command)
