"""Options of `zeromethod calibrate`, and which of them go together."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import click
from click.core import ParameterSource

from zeromethod.calibration.camera_file import ASSUMED_PERCENT
from zeromethod.cli.device_options import bench_options
from zeromethod.cli.numbers import Real, Whole
from zeromethod.cli.output import several, summary_option
from zeromethod.cli.page_options import view_option
from zeromethod.commissioning.calibration import Plan
from zeromethod.errors import InputError


def patience_option(waits: str, default_s: float = 120.0) -> Callable[[Any], Any]:
    """Option `--patience S` of a command that waits for a person; waits: for what."""
    kind = Real(min=0, min_open=True)
    return click.option(
        "--patience", "patience_s", type=kind, default=default_s, show_default=True, metavar="S", help=waits
    )


calibrate_options = several(
    click.option("--rig", "rig_name", help="Rig file (`zeromethod init` makes one), or a packaged name."),
    bench_options,
    click.option(
        "--press-depths", "depths", metavar="D,D,...", default="",
        help="Depths, mm, of presses that you will make, in order; you are asked for each.",
    ),
    click.option(
        "--depth-sigma", "press_sigma_mm", type=float, metavar="MM",
        help="How well these depths are known (standard deviation).  "
        f"[default: {Plan.press_sigma_mm:g}]",
    ),
    click.option(
        "--press-ball", "ball_text", metavar="RADIUS:SIGMA",
        help="A ball that you will press in after these, mm: its radius and how well it is known.",
    ),
    click.option(
        "--known", multiple=True, metavar="NAME=VALUE:SIGMA",
        help="A parameter measured by itself: gap_mm=0.48:0.01 by feeler gauge, display.along_mm=29.8:0.25.",
    ),
    click.option(
        "--edge-point", "edges", multiple=True, metavar="P0=U,V[:SIGMA]",
        help="A point of the mirror's edge P0 or R0 in the camera's image, px: R0=1180.5,512:2 (sigma 2 px "
        "unless given). It takes the place of what is found there.",
    ),
    click.option(
        "--edges/--no-edges", "find", default=None,
        help="Look for the mirror's edges in the image.  [default: edges]",
    ),
    click.option(
        "--intrinsics", "camera_file", type=click.Path(path_type=Path), metavar="FILE",
        help="The camera by itself: from `zeromethod calibrate intrinsics`, OpenCV (.yaml) or ROS (.yaml).",
    ),
    click.option(
        "--intrinsics-sigma", "camera_percent", type=Real(min=0, min_open=True), metavar="PERCENT",
        help="How well a .yaml of --intrinsics is known: standard deviation, percent of the focal length.  "
        f"[default: {ASSUMED_PERCENT:g}, assumed]",
    ),
    click.option("--light/--no-light", default=True, help="Measure response and noise."),
    click.option("--delay/--no-delay", default=True, help="Measure the delay of display and camera."),
    click.option(
        "--frames", "rest_frames", type=Whole(1, 1000), default=Plan.rest_frames, show_default=True,
        help="Camera frames averaged for each picture of the rest map.",
    ),
    click.option(
        "--press-frames", type=Whole(4, 1000), default=Plan.press_frames, show_default=True,
        help="Camera frames averaged for each press.",
    ),
    patience_option("Longest wait for a press.", Plan.patience_s),
    click.option(
        "--output", type=click.Path(path_type=Path, file_okay=False),
        help="Folder for the dated folder.  [default: calibrations/<rig> next to the rig file]",
    ),
    view_option,
    summary_option,
    click.option(
        "--show", "show_folder", is_flag=False, flag_value="", metavar="[FOLDER]",
        help="Show a calibration instead: the one in FOLDER, or with --rig its newest.",
    ),
    click.option(
        "--diff", "compared", nargs=2, type=click.Path(path_type=Path), metavar="A B",
        help="Compare the calibrations in two folders instead.",
    ),
    click.option(
        "--evaluate-again", "again_folder", type=click.Path(path_type=Path), metavar="FOLDER",
        help="Instead: evaluate what was recorded in FOLDER again, with --known, --edge-point, --intrinsics, "
        "or other --press-depths than were typed then.",
    ),
)  # fmt: skip


_INSTEAD = {
    "compared": frozenset[str](),
    "show_folder": frozenset({"rig_name", "summary"}),
    "again_folder": frozenset(
        {"known", "edges", "find", "camera_file", "camera_percent", "ball_text", "output", "summary"}
        | {"depths", "press_sigma_mm"}
    ),
}
"""Options that may be given with those that take the place of a calibration."""


def refuse_unused(context: click.Context) -> None:
    """Raise InputError for an option that was given and would have no effect."""
    typed = {option.name: option.opts[0] for option in context.command.params}
    given = [
        name
        for name in typed
        if name is not None and context.get_parameter_source(name) is ParameterSource.COMMANDLINE
    ]
    for name, used in _INSTEAD.items():
        if name in given:
            for other in given:
                if other != name and other not in used:
                    allowed = ", ".join(sorted(typed[one] for one in used)) or "none other"
                    raise InputError(f"{typed[other]}: not with {typed[name]}; allowed: {allowed}")
