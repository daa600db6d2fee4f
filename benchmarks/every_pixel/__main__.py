"""Every pixel: what a moving target and windows in time read, and open loops from the same frames.

On the packaged bench with a pupil of 2.5 mm, a target that steps by sixteenths, 2 grey levels of noise and 8
bits. Narrow shapes in a view of 384 x 320 px of full size:

- dents: Gaussian ones at half the depth at which they fold: the peak of the fine surface "as seen", against
  the mirror averaged over the pupil's footprint and the lens's blur, and with both divided out, against the
  mirror; and by an open loop that steps its phases too (the picture of the mirror at rest stays, the same
  number of frames is fitted pixel by pixel), by Fourier demodulation of each of its frames, averaged, and by
  eight-step phase shifting from as many frames, each of one picture;
- waves: one of 0.6 mm pitch, 0.05 um high: its height against the response predicted from footprint and
  pixel; and one of 1.1 times the pitch of which half should be left.

The whole view:

- rest: depth from 60 frames, at nodes and at pixels, whether their scatter is as stated, and the largest
  press that a matched filter finds at 100 places of it;
- press: one of 5 nm (8 nm where the lever is short), sigma 5 mm, by a matched filter;
- pads: sigma 5 mm at 2, 10 and 50 um, binned by 2, against open loops;
- moving: a pad of 50 um that slides, binned by 2: errors over stated sigma;
- mean: that of 10,000 frames, with jitter, a wrong delay and the chip's fixed pattern;
- loop: its time with the target still, moving, and read alongside; what a reading takes.

Seed by seed: with --keep it goes on from where it was stopped.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import click
import numpy as np

from benchmarks.every_pixel import moving, parts
from benchmarks.every_pixel.parts import DENTS, PADS_MM, REST_FRAMES, Found
from benchmarks.every_pixel.scenes import PUPIL_MM, WAVE_HIGH_MM, WAVE_MM
from benchmarks.parts import Parts, part_options
from benchmarks.report import Figure, Report, benchmark, figure, start
from benchmarks.salt import salt_option
from benchmarks.totals import estimate, rms
from zeromethod.fine.frames import FRAMES

JUDGED_MM = 0.5
"""Sigma of dents from which their error has a bar; a narrower one is mostly what the pupil leaves of it."""
PARTS = "dents", "waves", "rest", "press", "pads", "moving", "mean", "loop"


@dataclass(frozen=True)
class Case:
    """One measurement: a figure's name, of one seed, and what measures it."""

    part: str
    name: str
    measure: Callable[[], Found]


def cases(seeds: int, quick: bool) -> list[Case]:
    """All of them."""
    out, wide = [], min(seeds, 1 if quick else 20)
    for seed in range(seeds):
        out += [Case("dents", f"{s:g} mm", partial(parts.dent, s, seed)) for s in DENTS]
    for along_x, name in ((True, "x"), (False, "y")):
        pitch = 1.1 * parts.half_response_mm(along_x)
        out.append(Case("waves", name, partial(parts.wave, along_x, WAVE_MM, 0)))
        out.append(Case("waves", f"half {name} {pitch:.3f} mm", partial(parts.wave, along_x, pitch, 0)))
    for seed in range(wide):
        out.append(Case("rest", "rest", partial(parts.rest, seed)))
        out += [Case("pads", f"{1e3 * d:g} um", partial(parts.pad, d, seed)) for d in PADS_MM]
        out += [Case("moving", f"{v:g} mm/s", partial(moving.slide, v, seed)) for v in moving.SPEEDS_MM_S]
    out += [Case("press", "press", partial(parts.tiny_press, seed)) for seed in range(2 * wide)]
    long, binning = (240, 4) if quick else (10_000, 1)
    out.append(Case("mean", "mean", partial(parts.long_mean, long, binning)))
    out.append(Case("loop", "loop", partial(parts.loop_cost, 120 if quick else 240)))
    return out


class Results:
    """What was measured of cases, an entry of each seed."""

    def __init__(self, found: Sequence[dict[str, Any]]) -> None:
        self._found = found

    def of(self, part: str, name: str) -> dict[str, np.ndarray]:
        """Figures of a case, (seeds,) each; empty where it was not measured."""
        every = [one["found"] for one in self._found if (one["part"], one["name"]) == (part, name)]
        return {key: np.array([one[key] for one in every]) for key in every[0]} if every else {}

    def names(self, part: str) -> list[str]:
        """Names of a part's cases."""
        return list(dict.fromkeys(one["name"] for one in self._found if one["part"] == part))


def figures(found: Results) -> list[Figure]:
    """All whose cases were measured."""
    out: list[Figure] = []

    def add(name: str, value: str, bar: str, met: bool) -> None:
        out.append(Figure(name, value, bar, met))

    for sigma_mm, depth_mm in DENTS.items():
        of = found.of("dents", f"{sigma_mm:g} mm")
        for name in ("seen", "divided") if of else ():
            label = f"dent of sigma {sigma_mm:g} mm, {1e3 * depth_mm:g} µm: {name}, {len(of[name])} seeds"
            most = 0.01 if sigma_mm >= JUDGED_MM else None
            out.append(
                figure(label, *estimate(np.mean, 0.01 * of[name]), unit="%", least=most and -most, most=most)
            )
    for name in found.names("waves"):
        of = found.of("waves", name)
        height, predicted = (float(np.mean(of[key])) for key in ("height", "predicted"))
        label = f"wave of {1e6 * WAVE_HIGH_MM:g} nm along {name}"
        value = f"{height:.3f} of it, predicted {predicted:.3f}"
        half = name.startswith("half")
        add(
            label,
            value,
            "0.5" if half else "within 5 %",
            height >= 0.5 if half else abs(height / predicted - 1) <= 0.05,
        )
    if of := found.of("rest", "rest"):
        count = f"rest, {REST_FRAMES} frames, {len(of['nodes'])} seeds"
        over = estimate(lambda seen, stated: rms(seen) / rms(stated), of["pixels"], of["stated"])
        out += [
            Figure(f"{count}: nodes", f"{rms(of['nodes']):.2f} nm"),
            figure(f"{count}: pixels", *estimate(rms, of["pixels"]), unit="nm", most=1.4),
            figure(f"{count}: scatter over stated sigma", *over, least=0.8, most=1.25),
            figure(
                f"{count}: pixels valid", *estimate(np.mean, of["valid"]), unit="%", least=0.98, of_other=True
            ),
        ]
        add(f"{count}: largest press found", f"{of['found'].max():.1f} sigma", "5", of["found"].max() < 5.0)
    if of := found.of("press", "press"):
        seen = int(np.count_nonzero(of["sigmas"] > 5.0))
        value = f"{seen} of {len(of['sigmas'])}, least {of['sigmas'].min():.1f} sigma"
        add("a press of 5 or 8 nm, matched filter", value, "all at 5", seen == len(of["sigmas"]))
    for depth_mm in PADS_MM[:2]:
        if of := found.of("pads", f"{1e3 * depth_mm:g} um"):
            null, label = rms(of["null"]), f"pad of {1e3 * depth_mm:g} um, {len(of['null'])} seeds: null over"
            for name, most in (
                ("open, one frame", 1 / 3),
                ("open, stepping", 1.1),
                ("Fourier", 1.05),
                ("eight steps", 1.05),
            ):
                ratio = null / rms(of[name])
                add(f"{label} {name}", f"{ratio:.2f}", f"{most:.2f}", ratio <= most)
    if of := found.of("mean", "mean"):
        for name in ("nodes", "pixels"):
            left = float(of[name][0])
            add(f"mean of {of['frames'][0]:.0f} frames: {name}", f"{left:.2f} nm", "0.2 nm", left <= 0.2)
    if of := found.of("loop", "loop"):
        for name in ("step", "fine"):
            ratio = float(of[name][0] / of["still"][0])
            add(
                f"loop_ms, {name} over still ({of['still'][0]:.2f} ms)", f"{ratio:.3f}", "1.05", ratio <= 1.05
            )
        memory_mb, reading_ms = float(of["memory_mb"][0]), float(of["reading_ms"][0])
        add("memory of the process that reads pixels", f"{memory_mb:.0f} MB", "400 MB", memory_mb < 400.0)
        add("its processor time for a reading", f"{reading_ms:.0f} ms", "500 ms", reading_ms <= 500.0)
    return out + moving_figures(found)


def moving_figures(found: Results) -> list[Figure]:
    """Errors over stated sigma while a pad slides."""
    out = []
    for name in found.names("moving"):
        of = found.of("moving", name)
        nm = {one: rms(of[f"{one}, nm"]) for one in ("nodes", "pixels", "one frame")}
        for one in ("nodes", "pixels"):
            ratio = estimate(rms, of[f"{one}, over sigma"])
            label = f"pad sliding at {name}, {len(of['nodes, nm'])} seeds: error over sigma, {one}"
            out.append(figure(label, *ratio, least=0.8, most=1.25))
            out.append(Figure("the same; one frame of nodes", f"{nm[one]:.0f} nm; {nm['one frame']:.0f} nm"))
    return out


def table(found: Results) -> Sequence[Sequence[str]]:
    """Errors of peaks by every method, percent: means of dents, rms of pads."""
    methods = (
        "seen",
        "divided",
        "raw",
        "null",
        "open",
        "open, stepping",
        "Fourier",
        "eight steps",
        "open, one frame",
    )
    rows = [["peak error, %", *methods]]
    for part in ("dents", "pads"):
        for name in found.names(part):
            of = found.of(part, name)
            size = (lambda values: float(np.mean(values))) if part == "dents" else rms
            cells = [f"{size(of[key]):+.3f}" if key in of else "" for key in methods]
            rows.append([f"{part[:-1]} {name}", *cells])
    return rows if len(rows) > 1 else []


PART = click.option(
    "--part", "which", multiple=True, type=click.Choice(PARTS), help="Only this; may be given again."
)
SEEDS = click.option("--seeds", type=click.IntRange(1), help="20 unless given; 2 with --quick.")


@benchmark("every_pixel", __doc__, PART, SEEDS, part_options, salt_option)
def command(
    quick: bool, which: tuple[str, ...], seeds: int | None, keep: Path | None, most_runs: int | None
) -> Report:
    """Measure all parts."""
    seeds = seeds or (2 if quick else 20)
    wanted = [case for case in cases(seeds, quick) if case.part in (which or PARTS)]
    kept = Parts(keep, most_runs, parts=list(which), seeds=seeds, quick=quick)

    def one(number: int) -> dict[str, Any]:
        case = wanted[number]
        return {"part": case.part, "name": case.name, "found": case.measure()}

    runs = kept.run(len(wanted), "every pixel", one)
    found = Results(runs)
    title = f"Every pixel: {FRAMES} frames, pupil {PUPIL_MM:g} mm"
    return Report(title, figures(found), table(found), {"found": runs})


if __name__ == "__main__":
    start(command)
