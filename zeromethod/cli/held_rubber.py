"""What `zeromethod init` asks of what holds the rubber, and the rig file's [rubber] of the answers."""

from __future__ import annotations

from typing import Any, get_args

import click

from zeromethod.cli.numbers import Real
from zeromethod.errors import InputError
from zeromethod.rig.keys import plain
from zeromethod.rig.tables import FaceSupports, Rubber, Support

UNKNOWN, FACES, LAYER = "unknown", "faces", ("bonded", "sliding")

_HELD = click.Choice([UNKNOWN, "free", *LAYER, FACES])
_FACE = click.Choice(get_args(Support))
_LENGTH = Real(0, 10_000, min_open=True)

QUESTIONS = (
    (
        "rubber.support",
        "--support",
        _HELD,
        "what holds the rubber: free, so thick that its other faces do not matter; a layer bonded to or "
        "sliding on a stiff plate; a prism by its faces; or unknown, which counts in sigma",
    ),
    ("rubber.thickness_mm", "--thickness", _LENGTH, "thickness of the layer, mm"),
    (
        "rubber.thickness_sigma_mm",
        "--thickness-sigma",
        Real(0, 1000),
        "the layer's thickness: standard deviation, mm",
    ),
    ("rubber.pattern", "--pattern-support", _FACE, "how the pattern face is held"),
    ("rubber.camera", "--camera-support", _FACE, "how the camera face is held"),
    ("rubber.ends", "--ends-support", _FACE, "how both ends across y are held"),
)
"""As the questions of `init`: name, option, what is allowed, words."""


def answers_of(rubber: Rubber, sigma_mm: float) -> dict[str, Any]:
    """Answers that a table [rubber] has given. sigma_mm: of a thickness that is not known yet."""
    support = rubber.support
    by_face = isinstance(support, FaceSupports)
    faces = support if isinstance(support, FaceSupports) else FaceSupports()
    return {
        "rubber.support": FACES if by_face else support or UNKNOWN,
        "rubber.thickness_mm": rubber.thickness_mm,
        "rubber.thickness_sigma_mm": sigma_mm if rubber.thickness_mm is None else rubber.thickness_sigma_mm,
    } | {f"rubber.{face}": value for face, value in faces.model_dump().items()}


def applies(name: str, answers: dict[str, Any]) -> bool:
    """Whether a question makes sense after the answers so far."""
    support = answers["rubber.support"]
    if name.startswith("rubber.thickness"):
        return support in LAYER
    return name not in {f"rubber.{face}" for face in FaceSupports.model_fields} or support == FACES


def rubber_of(answers: dict[str, Any], before: Rubber) -> Rubber:
    """The table, with what it had `before` but for what holds it. Raises InputError."""
    values = {
        key: value
        for key, value in plain(before).items()
        if key not in {"support", "thickness_mm", "thickness_sigma_mm"}
    }
    support = answers["rubber.support"]
    if support == UNKNOWN:
        return Rubber(**values)
    values.pop("body", None)
    if support == FACES:
        faces = {face: answers[f"rubber.{face}"] for face in FaceSupports.model_fields}
        return Rubber(**values, support=FaceSupports(**faces))
    if support in LAYER:
        if answers["rubber.thickness_mm"] is None:
            raise InputError(f"--thickness: missing: a number above 0 with --support {support}")
        values |= {key: answers[f"rubber.{key}"] for key in ("thickness_mm", "thickness_sigma_mm")}
    return Rubber(**values, support=support)


def check_given(given: set[str], answers: dict[str, Any]) -> None:
    """Refuse options that say nothing with this support. given: names of questions."""
    for name, option, *_ in QUESTIONS:
        if name in given and not applies(name, answers):
            fits = " or ".join(LAYER) if "thickness" in name else FACES
            raise InputError(f"{option}: {answers[name]}: only with --support {fits}")
