"""`zeromethod init`: a rig file of one's own, from what calipers give."""

from __future__ import annotations

import shlex
import sys
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import click

from zeromethod.atomic_write import atomic_write
from zeromethod.cli.device_options import given_rig
from zeromethod.cli.held_rubber import QUESTIONS as OF_RUBBER
from zeromethod.cli.held_rubber import UNKNOWN, answers_of, applies, check_given, rubber_of
from zeromethod.cli.numbers import Real, Whole
from zeromethod.cli.output import check_file, several, writing
from zeromethod.commissioning.calibration.new_rig import Calipers, rig_text
from zeromethod.errors import InputError
from zeromethod.rig.load import packaged_rigs
from zeromethod.rig.model import PriorSpec, Rubber

_ABOVE_ZERO = Real(min=0, min_open=True)
_ANGLE = Real(5, 85, min_open=True, max_open=True)
_INDEX = Real(1, 4, min_open=True)
_PIXEL = Real(0.1, 100)
_LENGTH = Real(0.01, 10_000)
_GAP = Real(0, 1000)
_COUNT = Whole(16, 16384)

_SIGMA = Real(0, 1000)
_AIM = Real(-10_000, 10_000)

_QUESTIONS = (
    ("pattern_angle_deg", "--pattern-angle", _ANGLE, "angle between mirror and pattern face, degrees"),
    ("priors.angle_deg", "--angle-sigma", _SIGMA, "the pattern face's angle: standard deviation, degrees"),
    ("camera_angle_deg", "--camera-angle", _ANGLE, "angle between mirror and camera face, degrees"),
    (
        "priors.faces_difference_deg",
        "--faces-sigma",
        _SIGMA,
        "the faces' difference in angle: standard deviation, degrees (1.4 times the angle's where each is "
        "measured by itself)",
    ),
    ("pattern_length_mm", "--leg", _LENGTH, "length of the pattern face, from P0 to its far edge, mm"),
    ("priors.length_mm", "--leg-sigma", _SIGMA, "the pattern face's length: standard deviation, mm"),
    ("width_mm", "--width", _LENGTH, "width of the prism, mm"),
    ("index", "--index", _INDEX, "refractive index of the rubber"),
    ("priors.index", "--index-sigma", _SIGMA, "the index: standard deviation"),
    *OF_RUBBER,
    ("gap_mm", "--gap", _GAP, "gap between prism and LCD, its glass counted in, mm"),
    ("priors.gap_mm", "--gap-sigma", _SIGMA, "the gap: standard deviation, mm"),
    ("lcd_columns", "--lcd-columns", _COUNT, "columns of the LCD"),
    ("lcd_rows", "--lcd-rows", _COUNT, "rows of the LCD"),
    ("pitch_mm", "--pitch", Real(1e-4, 100), "pitch of the LCD's pixels, mm"),
    ("lcd_along_mm", "--lcd-along", Real(), "from P0 to the LCD's middle, along the pattern face, mm"),
    (
        "priors.display_along_mm",
        "--lcd-along-sigma",
        _SIGMA,
        "the LCD's place along the face: standard deviation, mm",
    ),
    ("refresh_hz", "--refresh", _ABOVE_ZERO, "refresh rate of the LCD, Hz"),
    ("camera_columns", "--camera-columns", _COUNT, "columns of the camera's image"),
    ("camera_rows", "--camera-rows", _COUNT, "rows of the camera's image"),
    ("pixel_um", "--pixel", _PIXEL, "pitch of the camera's pixels, micrometres"),
    ("lens_mm", "--lens", _LENGTH, "focal length of the lens, mm"),
    ("priors.focal_percent", "--lens-sigma", _SIGMA, "the focal length: standard deviation, percent"),
    ("distance_mm", "--distance", _LENGTH, "from the lens to the camera face, mm"),
    ("priors.camera_place_mm", "--distance-sigma", _SIGMA, "the camera's place: standard deviation, mm"),
    ("aim_x_mm", "--aim-x", _AIM, "where the camera aims on the mirror: from P0 along it, mm"),
    ("aim_y_mm", "--aim-y", _AIM, "where it aims across, from the middle of its width, mm"),
    ("priors.camera_aim_deg", "--aim-sigma", _SIGMA, "the camera's direction: standard deviation, degrees"),
    ("rate_hz", "--rate", _ABOVE_ZERO, "frame rate of the camera, frames per second"),
    ("exposure_s", "--exposure", _ABOVE_ZERO, "exposure of the camera, s"),
)
"""Name, option, what is allowed, words; names of sigmas are the rig file's."""


_measures = several(
    *(
        click.option(option, name.replace(".", "__"), type=kind, help=words[0].upper() + words[1:] + ".")
        for name, option, kind, words in _QUESTIONS
    )
)


@click.command(
    "init", epilog="Example: zeromethod init my.toml --pattern-angle 50 --leg 60.1 --lens 50 --distance 275"
)
@click.argument("path", metavar="FILE.toml", type=click.Path(path_type=Path, dir_okay=False))
@click.option(
    "--from",
    "rig_name",
    default="simulated",
    show_default=True,
    help="Rig file, or a packaged name, that gives what is left out.",
)
@_measures
@click.option("--ask/--no-ask", default=None, help="Ask for what is not given.  [default: on a terminal]")
@click.option("--force", is_flag=True, help="Overwrite a file that is there.")
def init_command(path: Path, rig_name: str, ask: bool | None, force: bool, **given: Any) -> None:
    """Write a commented rig file for a bench of one's own.

    Asks for what calipers, a protractor and data sheets give; Enter keeps the value shown. What holds the
    rubber is not taken from a packaged rig, whose bench is simulated.
    """
    check_file("FILE", path, ".toml")
    if path.exists() and not force:
        raise InputError(f"FILE: {path}: exists already: --force overwrites it")
    known = {name.replace("__", "."): value for name, value in given.items() if value is not None}
    before = Calipers.of(given_rig(rig_name, "--from"))
    if rig_name in packaged_rigs():
        before = replace(before, rubber=Rubber())
    asking = sys.stdin.isatty() if ask is None else ask
    text = _text(_flat(before) | known, set(known), before.rubber, path, asking=asking)
    with writing("FILE", path), atomic_write(path) as part:
        part.write_text(text, encoding="utf-8")
    name = shlex.quote(str(path))
    click.echo(f"{path} written; next:")
    click.echo(f"  zeromethod design {name}                                    is it a good bench?")
    click.echo(f"  zeromethod devices --focus --rig {name} --display 1 --camera 0   aim and focus")
    click.echo(f"  zeromethod calibrate --rig {name} --display 1 --camera 0 --press-depths 0.2,0.15,0.2")


def _flat(calipers: Calipers) -> dict[str, Any]:
    """Answers by the names of the questions; None for a camera that aims where it best does."""
    values = {field.name: getattr(calipers, field.name) for field in fields(calipers)}
    priors = values.pop("priors").model_dump()
    rubber = answers_of(values.pop("rubber"), priors["length_mm"])
    x_mm, y_mm = values.pop("aim_mm") or (None, None)
    return (
        values
        | rubber
        | {"aim_x_mm": x_mm, "aim_y_mm": y_mm}
        | {f"priors.{key}": one for key, one in priors.items()}
    )


def _calipers(answers: dict[str, Any], rubber: Rubber) -> Calipers:
    """Back from answers. rubber: what it was before."""
    tables = "priors.", "rubber.", "aim_"
    values = {name: value for name, value in answers.items() if not name.startswith(tables)}
    priors = {
        name.removeprefix("priors."): one for name, one in answers.items() if name.startswith("priors.")
    }
    calipers = Calipers(**values, rubber=rubber_of(answers, rubber), priors=PriorSpec(**priors))
    x_mm, y_mm = answers["aim_x_mm"], answers["aim_y_mm"]
    if x_mm is None and y_mm is None:
        return calipers
    usual = calipers.look_at_mm
    return replace(calipers, aim_mm=(usual[0] if x_mm is None else x_mm, usual[1] if y_mm is None else y_mm))


def _text(answers: dict[str, Any], known: set[str], rubber: Rubber, path: Path, *, asking: bool) -> str:
    """Text of the rig file, with answers in place of what was not given as an option. rubber: before.

    Answers that do not make a bench are refused with the reason, and asked for again.
    """
    while True:
        asked = [
            _ask(question, answers, path) for question in _QUESTIONS if asking and question[0] not in known
        ]
        try:
            check_given(known, answers)
            return rig_text(_calipers(answers, rubber), path.stem, path)
        except InputError as error:
            if not any(asked):
                raise
            click.echo(f"{error}: again (Enter keeps your answer)", err=True)


def _ask(question: tuple[str, str, click.ParamType[Any], str], answers: dict[str, Any], path: Path) -> bool:
    """Ask one question, where it makes sense; whether it was asked."""
    name, _, kind, words = question
    if not applies(name, answers):
        return False
    default = answers[name]
    if default is None and name.startswith("aim_"):
        default = _calipers(answers | {"rubber.support": UNKNOWN}, Rubber()).look_at_mm[name == "aim_y_mm"]
    answers[name] = _answer(words, default, kind, path)
    return True


def _answer(words: str, default: Any, kind: click.ParamType[Any], path: Path) -> Any:
    try:
        return click.prompt(words, default=default, type=kind)
    except click.Abort as abort:
        if isinstance(abort.__context__, EOFError):
            ended = f"the input ended at {words!r}; nothing is written; allowed: options, with --no-ask"
            raise InputError(f"FILE: {path}: {ended}") from None
        raise KeyboardInterrupt("interrupted: nothing is written") from None
