"""`zeromethod measure`: the passive sensor for still images."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click
import numpy as np
from rich.console import Console

from zeromethod.atomic_write import atomic_write
from zeromethod.cli.device_options import given_rig
from zeromethod.cli.numbers import Real, Whole
from zeromethod.cli.output import check_folder, summary_option, write_summary, writing
from zeromethod.errors import InputError, MeasurementError
from zeromethod.optics import check_geometry
from zeromethod.passive.correlate import LARGEST_SPACING_PX, NARROWEST_PX, SPACING_PX, WIDEST_PX
from zeromethod.passive.measure import Measurement, StillReading, arrays, figures, measure_all
from zeromethod.thread_limits import limit_threads
from zeromethod.view.progress import progress
from zeromethod.view.table import cell, text_table

_COLUMNS = (
    ("valid", "valid_share", "{:.1%}"),
    ("median shift, px", "displacement_median_px", "{:.3f}"),
    ("largest, px", "displacement_largest_px", "{:.3f}"),
    ("sigma, px", "sigma_median_px", "{:.4f}"),
    ("peak depth, mm", "depth_peak_mm", "{:.5f}"),
    ("its sigma, mm", "depth_peak_sigma_mm", "{:.5f}"),
)
"""Depth only where a rig was given."""

_LEAST_SHARE = 0.05
"""Fewer valid points than this are no measurement."""

_ADVICE = {
    "outside": "most of the reference has left the image; photograph both from the same place",
    "texture": "too little texture for the noise; photograph a speckle of 3 to 10 px with strong contrast"
    " all over the picture (stripes and ramps determine nothing along them), with more light",
    "mismatch": "the images do not look alike; photograph the same texture, in focus, from the same place,"
    " with small steps between the images",
    "unsettled": "the match did not settle; photograph smaller steps, or a coarser speckle",
    "order": "the texture repeats, and another match is about as good; photograph a random speckle, keep"
    " a part at rest in view, give a sequence that begins at rest, or say --largest-shift, how far in px"
    " anything may have moved",
}
"""What to do, by the name of the commonest `Doubt`."""


@click.command(
    "measure",
    epilog="Example: zeromethod measure rest.png pressed.png --output results --summary measure.json",
)
@click.argument("reference", type=click.Path(path_type=Path))
@click.argument("images", metavar="IMAGE...", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option("--rig", "rig_name", help="Rig file, or a packaged name: read slope and depth as well.")
@click.option(
    "--spacing",
    type=Whole(1, LARGEST_SPACING_PX),
    default=SPACING_PX,
    show_default=True,
    help="Pixels between the points.",
)
@click.option(
    "--window",
    type=Real(NARROWEST_PX, WIDEST_PX),
    help="Standard deviation in px of the Gaussian window; chosen per point when left out.",
)
@click.option(
    "--largest-shift",
    type=Real(0.1, 10000.0),
    help="How far in px any point may have moved: decides by how many periods a texture that repeats did.",
)
@click.option(
    "--output", type=click.Path(path_type=Path), help="Folder for a .npz and a picture (.png) of every image."
)
@summary_option
def measure_command(
    reference: Path,
    images: tuple[Path, ...],
    rig_name: str | None,
    spacing: int,
    window: float | None,
    largest_shift: float | None,
    output: Path | None,
    summary: Path | None,
) -> None:
    """Measure how IMAGES moved against REFERENCE: reference(u, v) = image(u + du, v + dv).

    Any texture will do: lattice, checker or speckle. Give a sequence in its order: each image may start
    from the one before. With --rig, REFERENCE is the mirror at rest, and slope and depth are read.
    """
    _check_names(images)
    check_folder("--output", output)
    rig = None
    if rig_name is not None:
        rig = given_rig(rig_name)
        check_geometry(rig)
        if said := rig.rubber.not_known:
            click.echo(f"! {said}", err=True)
    limit_threads()
    measurement = Measurement(
        reference, rig=rig, spacing_px=spacing, window_px=window, largest_shift_px=largest_shift
    )
    if not measurement.calibrated:
        click.echo(f"! {rig_name}: not calibrated: depth is relative", err=True)
    found: list[dict[str, Any]] = []
    names = [*(path.name for path in images[1:]), ""]
    with progress(len(images), first=images[0].name) as advance:
        for reading, following in zip(measure_all(measurement, images), names, strict=True):
            if output is not None:
                _write(reading, measurement, output)
            found.append(figures(reading))
            advance(following)
    columns = [column for column in _COLUMNS if any(column[1] in one for one in found)]
    rows = ((one["name"], *(cell(one[key], pattern) for _, key, pattern in columns)) for one in found)
    heads = (
        title if measurement.calibrated else title.replace("peak depth", "relative depth")
        for title, _, _ in columns
    )
    Console().print(text_table(("image", *heads), rows))
    about = {"reference": str(reference), "rig": rig.name if rig else None}
    write_summary(summary, {**about, "calibrated": measurement.calibrated if rig else None, "images": found})
    _refuse_empty(found)
    if not measurement.calibrated:
        from zeromethod.session.trust import DOUBT  # noqa: PLC0415 - the simulation loads slowly

        raise MeasurementError(f"{rig_name}: not calibrated: {DOUBT.reason}")


def _check_names(images: tuple[Path, ...]) -> None:
    taken: dict[str, Path] = {}
    for path in images:
        if path.stem in taken:
            raise InputError(
                f"IMAGE: {path}: its results would overwrite those of {taken[path.stem]}: rename one"
            )
        taken[path.stem] = path


def _write(reading: StillReading, measurement: Measurement, folder: Path) -> None:
    from zeromethod.view.displacement_figure import draw_displacement  # noqa: PLC0415 - matplotlib loads slowly

    table, drawn = (folder / f"{reading.name}{suffix}" for suffix in (".npz", ".png"))
    with writing("--output", table), atomic_write(table) as part, part.open("wb") as file:
        np.savez_compressed(file, allow_pickle=False, **arrays(reading))
    with writing("--output", drawn):
        draw_displacement(reading, measurement.reference, drawn)


def _refuse_empty(found: list[dict[str, Any]]) -> None:
    """Turn images in which nothing could be measured into an exit code."""
    for image in found:
        if image["valid_share"] < _LEAST_SHARE:
            raise MeasurementError(
                f"{image['name']}: {image['valid_share']:.1%} of the points could be measured with confidence"
                f" (less than {_LEAST_SHARE:.0%}): {_ADVICE[image['doubt']]}"
            )
    unread = [image["name"] for image in found if not np.isfinite(image.get("depth_peak_mm", 0.0))]
    if unread:
        raise MeasurementError(f"{', '.join(unread)}: the displacement leaves no node to read depth at")
