"""`zeromethod calibrate board` and `calibrate intrinsics`: the camera by itself, by a ChArUco board."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import click
from rich.console import Console
from rich.table import Table

from zeromethod.calibration.camera_file import save_camera
from zeromethod.calibration.charuco import DEFAULT_DICTIONARY, DICTIONARIES, Board, board_of
from zeromethod.calibration.intrinsics import LEAST_VIEWS, CameraFit, fit_camera
from zeromethod.cli.calibrate_options import patience_option
from zeromethod.cli.device_options import (
    REAL_CAMERAS,
    BenchOptions,
    bench_options,
    given_rig,
    opened_devices,
    with_devices,
    without_display,
)
from zeromethod.cli.numbers import Real, Whole
from zeromethod.cli.output import (
    INCH_MM,
    REPLACES,
    OutputFile,
    TerminalPrompts,
    several,
    summary_option,
    write_picture,
    write_summary,
    writing,
)
from zeromethod.commissioning.calibration.board_views import (
    Views,
    live_views,
    square_on_lcd_px,
    views_in_files,
)
from zeromethod.errors import InputError
from zeromethod.rig.model import SIMULATED
from zeromethod.thread_limits import limit_threads
from zeromethod.view.progress import progress
from zeromethod.view.table import text_table

_board_options = several(
    click.option(
        "--board",
        "board_text",
        required=True,
        metavar="CxR:SQUARE[:MARKER]",
        help="Squares across and down, sides of a square and a marker in mm: 12x9:10 or 12x9:10:7.5.",
    ),
    click.option(
        "--dictionary",
        type=click.Choice(DICTIONARIES),
        default=DEFAULT_DICTIONARY,
        show_default=True,
        metavar="NAME",
        help="ArUco dictionary of the markers.",
    ),
)


@click.command(
    "board", epilog="Example: zeromethod calibrate board --board 12x9:10 --dpi 600 --output board.png"
)
@_board_options
@click.option("--dpi", type=Real(10, 10_000), help="Of the printer: a picture that prints at its true size.")
@click.option("--rig", "rig_name", help="Instead: a picture that fills this rig's LCD, pixel by pixel.")
@click.option("--output", type=OutputFile(".png"), required=True, help=f"PNG to write. {REPLACES}")
def board_command(
    board_text: str, dictionary: str, dpi: float | None, rig_name: str | None, output: Path
) -> None:
    """Draw a ChArUco board, to print or to show on the LCD."""
    board = board_of(board_text, dictionary)
    if rig_name is not None and dpi is None:
        rig = given_rig(rig_name)
        square_px = square_on_lcd_px(board, rig)
        picture = board.on_lcd(square_px, rig.display.columns, rig.display.rows)
        words = f"show it full screen, unscaled: squares of {square_px} px"
    elif dpi is not None and rig_name is None:
        square_px = round(board.square_mm * dpi / INCH_MM)
        picture = board.picture(square_px)
        words = (
            "print it unscaled, glue it to something flat, and measure it: "
            f"{board.columns} squares should span {board.columns * board.square_mm:g} mm"
        )
    else:
        raise InputError("--dpi, --rig: one of them: the board for a printer or for an LCD")
    write_picture("--output", output, picture, board.square_mm / square_px)
    click.echo(words)


@click.command(
    "intrinsics",
    epilog="Example: zeromethod calibrate intrinsics board*.png --board 12x9:10 --output camera.toml",
)
@click.argument("frames", metavar="[FRAMES...]", nargs=-1, type=click.Path(path_type=Path))
@_board_options
@click.option("--rig", "rig_name", help="Rig file whose camera is meant; needed for live pictures.")
@bench_options
@click.option(
    "--views",
    "count",
    type=Whole(LEAST_VIEWS, 200),
    default=15,
    show_default=True,
    help="Live: how many views to take.",
)
@patience_option("Live: longest wait for a view.")
@click.option("--output", type=OutputFile(".toml"), required=True, help=f"File (.toml). {REPLACES}")
@summary_option
def intrinsics_command(
    frames: tuple[Path, ...],
    board_text: str,
    dictionary: str,
    rig_name: str | None,
    count: int,
    patience_s: float,
    output: Path,
    summary: Path | None,
    **devices: Any,
) -> None:
    """Focal length, principal point and distortion of the camera, from FRAMES that show a board, or live.

    Focus, zoom and aperture must stay as they are at the bench. Tilt the board by 20 to 40 degrees, another
    way in each picture, and let it reach the corners of the view. With --display the board is shown on the
    LCD, and the camera is moved.
    """
    board, options = board_of(board_text, dictionary), BenchOptions(**devices)
    limit_threads()
    if frames:
        if options.given:
            raise InputError(f"{options.given[0]}: FRAMES are given: either files or live pictures")
        views = _from_files(frames, board, rig_name)
    else:
        views = _live(board, rig_name, options, count, patience_s)
    for name, why in views.refused.items():
        click.echo(f"! {name}: {why}", err=True)
    found = fit_camera(views.views, board, views.shape)
    with writing("--output", output):
        save_camera(output, found, str(board))
    Console().print(_table(found))
    click.echo(f"use it: zeromethod calibrate --intrinsics {output} ...")
    if summary is not None:
        one = found.intrinsics
        figures = {
            "output": str(output),
            "views": found.views,
            "refused": views.refused,
            "corners": found.corners,
            "stray_corners": found.stray,
            "rms_px": found.rms_px,
            "values": dict(zip(one.names, one.values, strict=True)),
            "sigma": dict(zip(one.names, one.spread, strict=True)),
        }
        write_summary(summary, figures)


def _from_files(frames: tuple[Path, ...], board: Board, rig_name: str | None) -> Views:
    with progress(len(frames), "pictures") as advance:
        views = views_in_files(frames, board, LEAST_VIEWS, lambda: advance("pictures"))
    if rig_name is not None:
        camera = given_rig(rig_name).camera
        if views.shape != (camera.rows, camera.columns):
            raise InputError(
                f"{frames[0]}: {views.shape[1]} x {views.shape[0]} px: the rig's camera has "
                f"{camera.columns} x {camera.rows}"
            )
    return views


def _live(board: Board, rig_name: str | None, options: BenchOptions, count: int, patience_s: float) -> Views:
    if rig_name is None:
        raise InputError("FRAMES: missing: picture files, or --rig and --camera for live pictures")
    rig = with_devices(given_rig(rig_name), options, camera_alone=True).model_copy(
        update={"scenario": "none"}
    )
    if rig.camera.driver == SIMULATED:
        raise InputError(
            "--camera: missing: the simulated camera never sees a board; allowed: a camera's address"
        )
    shown = options.monitor is not None
    if not shown and rig.camera.driver in REAL_CAMERAS:
        rig = without_display(rig)
    if shown:
        square_on_lcd_px(board, rig)
    with opened_devices(rig) as opened:
        return live_views(opened, rig, board, count, patience_s, shown=shown, prompts=TerminalPrompts())


_WORDS = {
    "fx": "focal length along columns, px",
    "fy": "focal length along rows, px",
    "cx": "principal point, column",
    "cy": "principal point, row",
}


def _table(found: CameraFit) -> Table:
    one, rows = found.intrinsics, []
    for name, value, sigma in zip(one.names, one.values, one.spread, strict=True):
        digits = max(0, 1 - math.floor(math.log10(sigma)))
        rows.append((_WORDS.get(name, f"distortion {name}"), f"{value:.{digits}f}", f"{sigma:.2g}"))
    rows.append(("pictures, corners", f"{len(found.views)}, {found.corners}", ""))
    rows.append(("misfit of a corner, px", f"{found.rms_px:.3f}", ""))
    if found.stray:
        rows.append(("stray corners left out", f"{found.stray}", ""))
    return text_table(("camera", "found", "sigma"), rows)
