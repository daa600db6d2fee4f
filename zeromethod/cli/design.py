"""`zeromethod design`: what a bench can do, from its rig file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from zeromethod.cli.device_options import given_rig
from zeromethod.cli.numbers import Real
from zeromethod.cli.output import (
    REPLACES,
    OutputFile,
    summary_option,
    wide_console,
    write_picture,
    write_summary,
)
from zeromethod.design import (
    DEFAULT_KINDS,
    PressKind,
    SampledView,
    Variation,
    curves,
    design_figures,
    design_warnings,
)
from zeromethod.design.assess import stability_figures
from zeromethod.design.delay_budget import ASSUMED_COMPUTING_S
from zeromethod.design.resolution import ASSUMED_PUPIL_MM
from zeromethod.optics import check_geometry
from zeromethod.pattern.printed import bar_mm, printed_pattern, printed_sheet
from zeromethod.rig.model import Rig
from zeromethod.thread_limits import limit_threads
from zeromethod.view.design_table import curves_table, design_table
from zeromethod.view.progress import progress

_MOST_COMPUTING_S = 10.0
_MOST_PUPIL_MM = 100.0


@click.command("design", epilog="Example: zeromethod design my.toml --vary angle=45:60 --figure design.png")
@click.argument("rig_name", metavar="[RIG]", default="simulated")
@click.option("--figure", type=OutputFile(".png"), help=f"Draw prism and rays (.png). {REPLACES}")
@summary_option
@click.option(
    "--vary",
    "variations",
    multiple=True,
    metavar="KEY=FROM:TO[:N]",
    help="Curves over angle, index, gap, distance, focal or a dotted key of the rig file; may be repeated.",
)
@click.option(
    "--press",
    "kinds",
    multiple=True,
    metavar="KIND:SIZE",
    help="Press whose largest depth is given: load:2, ball:50, cone:5, edge:2 (mm); may be repeated.",
)
@click.option(
    "--pattern",
    type=OutputFile(".png"),
    help=f"Draw the pattern for `run --passive`, to be printed at its true size (.png). {REPLACES}",
)
@click.option(
    "--pupil",
    "pupil_mm",
    type=Real(0, _MOST_PUPIL_MM, min_open=True),
    metavar="MM",
    help=f"Diameter of the lens's entrance pupil, focal length / f-number.  [default: {ASSUMED_PUPIL_MM:g}]",
)
@click.option(
    "--computing", "computing_s", type=Real(0, _MOST_COMPUTING_S), default=ASSUMED_COMPUTING_S,
    show_default=True, metavar="S", help="Time to read a frame and to draw the next picture, s.",
)  # fmt: skip
def design_command(
    rig_name: str,
    figure: Path | None,
    summary: Path | None,
    variations: tuple[str, ...],
    kinds: tuple[str, ...],
    pattern: Path | None,
    pupil_mm: float | None,
    computing_s: float,
) -> None:
    """Predict what a bench can do, planned or calibrated, from its RIG file alone.

    Margin to total reflection, lever, the deepest presses that can be nulled, resolution, noise, delay and
    stable gain, view. The curves of --vary are drawn next to --figure, as NAME-KEY.png.
    """
    presses = [PressKind.parse(text) for text in kinds] or list(DEFAULT_KINDS)
    runs = [Variation.parse(text) for text in variations]
    rig = given_rig(rig_name, "RIG")
    check_geometry(rig)
    limit_threads()
    pupil = ASSUMED_PUPIL_MM if pupil_mm is None else pupil_mm
    view = SampledView(rig)
    steps = len(presses) * len(view.regions) + sum(run.steps for run in runs)
    with progress(steps, "design") as advance:
        found = [(run, curves(rig, run, pupil, lambda: advance("curves"))) for run in runs]
        figures = design_figures(view, presses, pupil, computing_s, lambda: advance("presses"))
    figures["resolution"]["pupil_assumed"] = pupil_mm is None
    figures["delay"] |= stability_figures(rig, figures["delay"]["worst_frames"])
    figures["warnings"] = design_warnings(view, figures)
    figures["vary"] = [curve for _, curve in found]
    _report(view, figures, found, figure, summary)
    if pattern is not None:
        _print_pattern(rig, pattern)


def _print_pattern(rig: Rig, path: Path) -> None:
    pitch_mm, image = rig.display.pitch_mm, printed_pattern(rig)
    sheet = printed_sheet(image, pitch_mm)
    dots_per_inch = write_picture("--pattern", path, sheet, pitch_mm)
    rows, cols = sheet.shape
    size = f"{cols * pitch_mm:.2f} x {rows * pitch_mm:.2f} mm, {dots_per_inch:.1f} dpi"
    checked = f"measure the {bar_mm(image.shape[1], pitch_mm):g} mm bar, then cut along the frame"
    click.echo(f"{path}: print it {size}; {checked}")


def _report(
    view: SampledView,
    figures: dict[str, Any],
    found: list[tuple[Variation, dict[str, Any]]],
    figure: Path | None,
    summary: Path | None,
) -> None:
    """Print the tables and write what was asked for."""
    console = wide_console()
    console.print(design_table(figures, figures["warnings"]))
    for _, curve in found:
        console.print()
        console.print(curves_table(curve))
        for value, reason in curve["refused"].items():
            console.print(f"{curve['key']} {value}: {reason}")
    write_summary(summary, figures)
    if figure is not None:
        from zeromethod.view.design_figure import draw_curves, draw_design  # noqa: PLC0415 - matplotlib loads slowly

        draw_design(view, figures, figure)
        for run, curve in found:
            draw_curves(curve, run.label, figures["rig"], figure.with_name(f"{figure.stem}-{run.key}.png"))
