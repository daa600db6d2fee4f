"""Keys of a study's settings: a misspelt one is told with its table and the key that may be meant."""

from __future__ import annotations

import difflib
from typing import Any, get_args, get_origin

from pydantic import BaseModel

from zeromethod.design.vary import NAMES
from zeromethod.errors import InputError
from zeromethod.rig.model import Rig
from zeromethod.study.axes import DRAW_WORDS, RANGE_WORDS, not_a_word
from zeromethod.study.plan import Study
from zeromethod.study.press import PressTable
from zeromethod.study.task import Procedure

_OWN = ("rig.file", "rig.binning", "recording")
_BENCH, _PRESS = "bench.", "press."
_WORDS = {"grid": RANGE_WORDS, "random": DRAW_WORDS}


def check_keys(study: Study, chosen: Procedure) -> None:
    """Raise InputError, one line, for the first key under [set], [grid] or [random] that nobody knows."""
    rig = _dotted(Rig)
    press = [_PRESS + name for name in PressTable.model_fields]
    known = [*_OWN, *chosen.settings, *NAMES, *press, *rig, *(_BENCH + key for key in rig)]
    tables = {"set": study.table.settings, "grid": study.axes, "random": study.table.random}
    for table, keys in tables.items():
        for key in keys:
            _check_word(study, table, key, known)
            if key in known or _may_be(key):
                continue
            nearest = difflib.get_close_matches(key, known, n=1)
            hint = (
                f"did you mean {nearest[0]}?"
                if nearest
                else "a dotted key of a rig file, or of docs/study.md"
            )
            raise InputError(f'{study.path}: {table}: "{key}": unknown key: {hint}')


def _check_word(study: Study, table: str, key: str, known: list[str]) -> None:
    """Refuse { unifrm = [low, high] }, which reads as a further step of the key that it is given to."""
    before, _, word = key.rpartition(".")
    words = _WORDS.get(table, ())
    value = before in known and not any(other.startswith(f"{before}.") for other in known)
    # what lies in a list only the rig can tell, and "press" is a key of its own and a table as well
    likely = (before in known or "[" in before) and difflib.get_close_matches(word, words, n=1)
    if words and (value or likely):
        raise not_a_word(f"{study.path}: {table}.{before}", word, words)


def _may_be(key: str) -> bool:
    """Whether a key lies where only the rig itself can tell: in a list, or in a table that takes any key."""
    model: Any = Rig
    for step in key.removeprefix(_BENCH).split("."):
        if "[" in step:
            return True
        if not (isinstance(model, type) and issubclass(model, BaseModel)) or step not in model.model_fields:
            return False
        model = _model(model.model_fields[step].annotation)
    return True


def _dotted(model: type[BaseModel], before: str = "") -> list[str]:
    """Dotted keys of all values of a model."""
    keys = []
    for name, field in model.model_fields.items():
        inner = _model(field.annotation)
        keys += _dotted(inner, f"{before}{name}.") if inner is not None else [f"{before}{name}"]
    return keys


def _model(annotation: Any) -> type[BaseModel] | None:
    """The table that an annotation is, or may be; None for anything else, a list of tables included."""
    if get_origin(annotation) in (tuple, list):
        return None
    if isinstance(annotation, type):
        return annotation if issubclass(annotation, BaseModel) else None
    found = (part for part in get_args(annotation) if isinstance(part, type))
    return next((part for part in found if issubclass(part, BaseModel)), None)
