"""`zeromethod calibrate fringes`: the pictures whose photographs `calibrate decode` reads."""

from __future__ import annotations

from pathlib import Path

import click
import cv2

from zeromethod.atomic_write import atomic_write
from zeromethod.cli.device_options import given_rig
from zeromethod.cli.fringe_options import fringe_options, sequence_of
from zeromethod.cli.numbers import Whole
from zeromethod.cli.output import check_folder, writing
from zeromethod.errors import InputError
from zeromethod.pattern.response import Response


@click.command(
    "fringes",
    epilog="Example: zeromethod calibrate fringes --rig my.toml --periods 16,20,22,25 --shifts 6 "
    "--output fringes",
)
@fringe_options
@click.option("--rig", "rig_name", help="Rig file, or a packaged name: the LCD's size and its response.")
@click.option(
    "--panel",
    type=Whole(16, 16384),
    nargs=2,
    metavar="C R",
    help="LCD columns and rows, without a rig file: grey codes are proportional to light.",
)
@click.option("--output", type=click.Path(path_type=Path), required=True, help="Folder for the pictures.")
def fringes_command(
    periods_text: str,
    shifts_text: str,
    axes_text: str,
    repeats: int,
    rig_name: str | None,
    panel: tuple[int, int] | None,
    output: Path,
) -> None:
    """Write the fringe pictures: show each full screen, unscaled, and photograph it.

    They are numbered in the order in which `calibrate decode` wants the photographs: for each repeat, each
    axis, each period, each shift. With --rig light is a sine on that LCD; with --panel the grey codes are.
    """
    sequence = sequence_of(periods_text, shifts_text, axes_text, repeats)
    if (rig_name is None) == (panel is None):
        raise InputError("--rig and --panel: give one of them: the size of the LCD")
    size, response = panel, Response()
    if rig_name is not None:
        display = given_rig(rig_name).display
        size, response = (display.columns, display.rows), Response.from_rig(display)
    assert size is not None
    check_folder("--output", output)
    digits = max(2, len(str(sequence.frames - 1)))
    for number, light in enumerate(sequence.pictures(*size)):
        path = output / f"fringe{number:0{digits}d}.png"
        with writing("--output", path), atomic_write(path) as part:
            part.write_bytes(cv2.imencode(".png", response.picture(light))[1].tobytes())
    click.echo(f"{sequence.frames} pictures of {size[0]} x {size[1]} px in {output}: photograph them in turn")
