"""`zeromethod calibrate`: from an unknown bench to millimetres, step by step."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import click
from rich.console import Console
from rich.table import Table

from zeromethod.cli.calibrate_bench import calibrate_bench
from zeromethod.cli.calibrate_camera import board_command, intrinsics_command
from zeromethod.cli.calibrate_fringes import fringes_command
from zeromethod.cli.calibrate_options import calibrate_options, refuse_unused
from zeromethod.cli.calibrate_weight import weight_command
from zeromethod.cli.device_options import given_rig
from zeromethod.cli.fringe_options import fringe_options, sequence_of
from zeromethod.cli.numbers import Real, Whole
from zeromethod.cli.output import REPLACES, OutputFile, summary_option, write_summary, writing
from zeromethod.commissioning.decode import decode_files, figures, noise_of, refuse_empty
from zeromethod.decoding.measuring import LIMIT_SHARE
from zeromethod.decoding.noise import NoiseModel
from zeromethod.errors import InputError, MeasurementError
from zeromethod.rig.model import Rig
from zeromethod.thread_limits import limit_threads
from zeromethod.view.progress import progress
from zeromethod.view.table import pair_table

_SIGMAS = ("sigma_column_median_px", "sigma_row_median_px")


class _Calibrate(click.Group):
    """Sub-commands, and a word for numbers with blanks between them, which are none."""

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Refuse a number in place of a sub-command."""
        if _is_number(args[0]):
            raise InputError(
                f"--press-depths: {args[0]} by itself: commas between depths, no blanks: 0.2,0.15"
            )
        return super().resolve_command(ctx, args)


def _is_number(text: str) -> bool:
    try:
        return math.isfinite(float(text.strip(",")))
    except ValueError:
        return False


@click.group(
    "calibrate",
    cls=_Calibrate,
    invoke_without_command=True,
    epilog="Example: zeromethod calibrate --rig my.toml --display 1 --camera 0 --press-depths 0.2,0.15,0.1",
)
@calibrate_options
@click.pass_context
def calibrate_command(context: click.Context, /, **given: Any) -> None:
    """Find out what the bench is: response, rest map, delay, geometry; follow what it says.

    Nothing may touch the mirror until a press is asked for. What is found goes into a dated folder next to
    the rig file, with a rig file for `run`.
    """
    if context.invoked_subcommand is None:
        refuse_unused(context)
        calibrate_bench(**given)


calibrate_command.add_command(board_command)
calibrate_command.add_command(intrinsics_command)
calibrate_command.add_command(fringes_command)
calibrate_command.add_command(weight_command)


def _noise(rig: Rig | None, given: tuple[float, float] | None) -> NoiseModel | None:
    if given is not None:
        if not all(map(math.isfinite, given)):
            raise InputError(f"--noise: {given[0]:g} {given[1]:g}: two numbers above 0")
        return NoiseModel.of_camera(given[0], given[1])
    return noise_of(rig)


@calibrate_command.command(
    "decode",
    epilog="Example: zeromethod calibrate decode frame*.png --periods 16,20,22,25 --shifts 6 "
    "--panel 1920 1080 --output rest.npz",
)
@click.argument("frames", metavar="FRAMES...", nargs=-1, required=True, type=click.Path(path_type=Path))
@fringe_options
@click.option(
    "--output", type=OutputFile(".npz"), required=True, help=f"Write the rest map (.npz). {REPLACES}"
)
@click.option("--rig", "rig_name", help="Rig file, or a packaged name: LCD size, camera bits and noise.")
@click.option(
    "--panel",
    type=Whole(16, 16384),
    nargs=2,
    metavar="C R",
    help="LCD columns and rows. When left out: as far as the periods reach.",
)
@click.option("--bits", type=Whole(1, 16), help="Bits of the camera: all set is saturated.")
@click.option(
    "--noise",
    "noise_given",
    type=Real(min=0, min_open=True),
    nargs=2,
    metavar="S E",
    help="Camera noise: read noise, grey levels; electrons per grey level. Else found in the frames.",
)
@click.option(
    "--second-reflection",
    "limit_share",
    type=Real(0, 1, min_open=True),
    default=LIMIT_SHARE,
    show_default=True,
    help="Largest second reflection to accept, of the main one's light.",
)
@summary_option
def decode_command(
    frames: tuple[Path, ...],
    periods_text: str,
    shifts_text: str,
    output: Path,
    rig_name: str | None,
    panel: tuple[int, int] | None,
    axes_text: str,
    repeats: int,
    bits: int | None,
    noise_given: tuple[float, float] | None,
    limit_share: float,
    summary: Path | None,
) -> None:
    """Absolute LCD position of every camera pixel, from FRAMES of shifted fringes.

    FRAMES in the order shown: for each repeat, each axis, each period, each shift. Images of 8 or 16 bits,
    TIFF of many pages, .npy or .npz. light = 1/2 + 1/2 cos(2 pi x / period - shift), x the LCD column or row.
    """
    sequence = sequence_of(periods_text, shifts_text, axes_text, repeats)
    rig = given_rig(rig_name) if rig_name is not None else None
    size = panel or ((rig.display.columns, rig.display.rows) if rig else None)
    limit_threads()
    with progress(sequence.frames, first="decoding") as advance:
        found = decode_files(
            frames,
            sequence,
            size_px=size,
            noise=_noise(rig, noise_given),
            bits=bits or (rig.camera.bits if rig else None),
            limit_share=limit_share,
            camera_shape=(rig.camera.rows, rig.camera.columns) if rig else None,
            advance=lambda: advance("decoding"),
        )
    with writing("--output", output):
        found.rest_map.save(output)
    values = figures(found)
    Console().print(_table(values))
    if summary is not None:
        write_summary(summary, {"periods_px": sequence.periods, "output": str(output), **values})
    try:
        refuse_empty(found)
    except MeasurementError as error:
        hint = "do --periods, --shifts, --panel and the order of FRAMES fit what was shown?"
        raise MeasurementError(f"{error}; {hint}") from None


def _rare(share: float) -> str:
    return "under 1e-12" if share < 1e-12 else f"{share:.1g}"


def _table(values: dict[str, Any]) -> Table:
    """What was found, and why the rest was not."""
    columns, rows = values["display_px"]
    found = (
        ("camera pixels with a place on the LCD", f"{values['valid_share']:.2%}"),
        ("sigma, LCD px (columns, rows)", ", ".join(f"{values[key]:.4f}" for key in _SIGMAS)),
        ("LCD sought, px", f"{columns:.0f} x {rows:.0f}"),
        ("wrong orders expected from noise", _rare(values["wrong_orders_expected"])),
        ("frames' scatter over the camera's noise", f"{values['scatter_over_noise']:.2f}"),
        ("second reflection, median", f"{values['second_reflection_median_share']:.1%}"),
        ("second harmonic of the LCD's light", f"{values['second_harmonic_share']:.1%}"),
        ("drift of the light", f"{values['light_drift_share']:.1%}"),
        ("flicker from frame to frame", f"{values['light_flicker_share']:.1%}"),
        *(
            (f"camera pixels left out: {why}", f"{count}")
            for why, count in values["reasons_px"].items()
            if count
        ),
    )
    return pair_table(row for row in found if "nan" not in row[1])
