"""What `calibrate fringes` and `calibrate decode` must agree on: which pictures are shown, in which order."""

from __future__ import annotations

import math

import click

from zeromethod.cli.calibrate_known import numbers_of
from zeromethod.cli.numbers import Whole
from zeromethod.cli.output import several
from zeromethod.decoding.fringes import Axis, FringeSequence, equal_shifts
from zeromethod.errors import InputError

fringe_options = several(
    click.option(
        "--periods",
        "periods_text",
        metavar="P,P,...",
        required=True,
        help="Periods, LCD px; 'P,P,.../P,P,...' where columns and rows have their own.",
    ),
    click.option(
        "--shifts",
        "shifts_text",
        metavar="N",
        required=True,
        help="Count of equal shifts, or the angles in degrees: 0,90,180,270.",
    ),
    click.option(
        "--axes",
        "axes_text",
        type=click.Choice(["columns,rows", "rows,columns"]),
        default="columns,rows",
        show_default=True,
        help="Which axis is shown first: fringes that vary along the columns, or along the rows.",
    ),
    click.option(
        "--repeats",
        type=Whole(1, 1000),
        default=1,
        show_default=True,
        help="How often the whole sequence is shown.",
    ),
)
"""Options that give periods_text, shifts_text, axes_text and repeats, see `sequence_of`."""


def sequence_of(periods_text: str, shifts_text: str, axes_text: str, repeats: int) -> FringeSequence:
    """The sequence that the options describe. Raises InputError."""
    axes: tuple[Axis, Axis] = ("columns", "rows") if axes_text == "columns,rows" else ("rows", "columns")
    columns, *rows = (numbers_of("--periods", part) for part in periods_text.split("/", 1))
    return FringeSequence(columns, _shifts(shifts_text), axes, repeats, *rows)


def _shifts(text: str) -> tuple[float, ...]:
    """A count of equal shifts, or angles in degrees; rad."""
    if "," in text:
        return tuple(math.radians(angle) for angle in numbers_of("--shifts", text))
    if not (text.isdecimal() and 3 <= int(text) <= 360):
        raise InputError(f"--shifts: {text}: a count of equal shifts, 3 to 360, or degrees: 0,90,180,270")
    return equal_shifts(int(text))
