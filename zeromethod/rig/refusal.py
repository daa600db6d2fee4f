"""One-line messages that refuse a rig file: key, value, what is allowed."""

from __future__ import annotations

import difflib
import json
from collections.abc import Mapping
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, Literal, TypeVar, Union, get_args, get_origin

from annotated_types import Ge, Gt, Le, Lt, MinLen, MultipleOf
from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails, PydanticCustomError

from zeromethod.errors import InputError

Model = TypeVar("Model", bound=BaseModel)

RENAMED = {
    "press": "scenario",
    "prism.captured_angle_deg": "prism.camera_angle_deg",
    "prism.leg_mm": "prism.pattern_length_mm",
    "captured_layers": "camera_layers",
    "display.fill": "display.fill_factor",
}
"""Keys of schema 1 by what they are called since."""

_LONGEST = 60
_NAMES: dict[Any, str] = {
    float: "a number",
    int: "a whole number",
    str: "text",
    bool: "true or false",
    Path: "a file name",
}
_BOUNDS: dict[type, tuple[str, str]] = {
    Gt: ("gt", "above"),
    Ge: ("ge", "at least"),
    Lt: ("lt", "below"),
    Le: ("le", "at most"),
    MultipleOf: ("multiple_of", "a multiple of"),
}


def refused(key: str, value: object, allowed: str) -> PydanticCustomError:
    """Error of a rule between keys: which key of the table, its value (None: not given), what is allowed."""
    return PydanticCustomError("rig", "{allowed}", {"key": key, "value": value, "allowed": allowed})


def shown(value: object) -> str:
    """Value as a TOML file would have it, on one line, shortened."""
    if isinstance(value, Mapping):
        return "a table"
    try:
        text = json.dumps(value, default=str, ensure_ascii=False)
    except ValueError:
        text = repr(value)
    text = text.replace("NaN", "nan").replace("Infinity", "inf")
    return text if len(text) <= _LONGEST else text[: _LONGEST - 3] + "..."


def validated(model: type[Model], data: Mapping[str, Any], where: object) -> Model:
    """Table of plain values. Raises InputError "where: key: value: what is allowed"."""
    try:
        # By way of JSON, where pydantic's strict mode still takes a list for a tuple and text for a path.
        return model.model_validate_json(json.dumps(data, default=str), strict=True)
    except ValidationError as error:
        raise InputError(f"{where}: {first_refusal(error, model)}") from None


def _split(annotation: Any) -> tuple[Any, list[Any]]:
    """Type and bounds of an annotation, `| None` taken off (TOML cannot say None)."""
    bounds: list[Any] = []
    while True:
        if hasattr(annotation, "__metadata__"):
            for item in annotation.__metadata__:
                bounds += item.metadata if isinstance(item, FieldInfo) else [item]
            annotation = annotation.__origin__
        elif get_origin(annotation) in (Union, UnionType):
            annotation = next(a for a in get_args(annotation) if a is not NoneType)
        else:
            return annotation, bounds


def _alternatives(annotation: Any) -> list[Any]:
    """What a value may be, `None` taken off; more than one where a table may stand in a value's place."""
    while hasattr(annotation, "__metadata__"):
        annotation = annotation.__origin__
    if get_origin(annotation) not in (Union, UnionType):
        return [annotation]
    return [one for one in get_args(annotation) if one is not NoneType]


def _table(annotation: Any) -> type[BaseModel] | None:
    """The table among the alternatives."""
    tables = [
        one for one in _alternatives(annotation) if isinstance(one, type) and issubclass(one, BaseModel)
    ]
    return tables[0] if tables else None


def _limits(bounds: list[Any]) -> str:
    """Bounds in words, e.g. " above 0 and at most 1"."""
    words = []
    for bound in bounds:
        if type(bound) in _BOUNDS:
            attribute, word = _BOUNDS[type(bound)]
            words.append(f"{word} {getattr(bound, attribute):g}")
        elif isinstance(bound, MinLen):
            words.append("that is not empty")
    return f" {' and '.join(words)}" if words else ""


def allowed(annotation: Any, more: list[Any] | None = None) -> str:
    """What a field of this annotation takes, e.g. "a number above 0"."""
    first, *others = _alternatives(annotation)
    if others and (table := _table(annotation)):
        return f"{allowed(first, more)}, or a table of {', '.join(table.model_fields)}"
    kind, bounds = _split(annotation)
    limits = _limits(bounds + (more or []))
    if get_origin(kind) is Literal:
        values = [shown(v) for v in get_args(kind)]
        return values[0] if len(values) == 1 else "one of " + ", ".join(values)
    if get_origin(kind) is tuple:
        items = get_args(kind)
        one = allowed(items[0])
        if items[-1] is Ellipsis:
            return f"a list{limits}, each {one}"
        each = "" if one == "a number" else f", each {one}"
        return f"a list of {len(items)} numbers{each}"
    if isinstance(kind, type) and issubclass(kind, BaseModel):
        return "a table"
    return f"{_NAMES.get(kind, 'a value')}{limits}"


def _field(model: type[BaseModel], place: tuple[int | str, ...]) -> tuple[Any, list[Any]]:
    """Type and bounds at a place in a model, e.g. ("camera", "focal_px", 1)."""
    annotation: Any = model
    bounds: list[Any] = []
    for step in place:
        table = _table(annotation)
        if isinstance(step, int):
            items = get_args(_split(annotation)[0])
            annotation, bounds = items[0] if items[-1] is Ellipsis else items[min(step, len(items) - 1)], []
        elif table is not None and step in table.model_fields:
            annotation, bounds = table.model_fields[step].annotation, table.model_fields[step].metadata
        else:
            break
    return annotation, bounds


def dotted(place: tuple[int | str, ...]) -> str:
    """Name of a place as the messages and `save_values` have it, e.g. "pattern_layers[0].index"."""
    text = ""
    for step in place:
        text += f"[{step}]" if isinstance(step, int) else f".{step}" if text else step
    return text


def unknown_key(place: tuple[int | str, ...], known: list[str]) -> str:
    """Refusal of an unknown key, with its new name or the nearest known key."""
    key = dotted(place)
    near = [RENAMED[key]] if key in RENAMED else difflib.get_close_matches(str(place[-1]), known, n=1)
    hint = f"did you mean {near[0]}?" if near else f"known are {', '.join(known)}"
    return f"{key}: unknown key: {hint}"


def _fields(model: type[BaseModel], place: tuple[int | str, ...]) -> list[str]:
    """Keys of the table at a place."""
    table = _table(_field(model, place)[0])
    return [] if table is None else list(table.model_fields)


def _untagged(model: type[BaseModel], detail: ErrorDetails) -> ErrorDetails | None:
    """The same without the step that names an alternative; None for an alternative that was not meant."""
    place = detail["loc"]
    for k in range(1, len(place)):
        if len(_alternatives(_field(model, place[:k])[0])) > 1:
            ends = k == len(place) - 1
            # what is a table is meant as one
            wrong = detail["type"] == "model_type" or isinstance(detail["input"], Mapping)
            if ends and wrong and detail["type"] != "rig":
                return None
            return {**detail, "loc": place[:k] + place[k + 1 :]}
    return detail


def _complaint(model: type[BaseModel], detail: ErrorDetails) -> str:
    place = detail["loc"]
    if detail["type"] == "extra_forbidden":
        return unknown_key(place, _fields(model, place[:-1]))
    if detail["type"] == "rig":
        rule = detail["ctx"]
        place = (*place, rule["key"])
        value = "missing" if rule["value"] is None else shown(rule["value"])
        return f"{dotted(place)}: {value}: {rule['allowed']}"
    value = "missing" if detail["type"] == "missing" else shown(detail["input"])
    return f"{dotted(place)}: {value}: {allowed(*_field(model, place))}"


def first_refusal(error: ValidationError, model: type[BaseModel]) -> str:
    """First complaint as "key: value: what is allowed".

    An unknown key goes before one that is missing; where it is no misspelling of that, both are named.
    """
    given = [_untagged(model, detail) for detail in error.errors(include_url=False)]
    details = [detail for detail in given if detail is not None]
    unknown = [detail for detail in details if detail["type"] == "extra_forbidden"]
    first = _complaint(model, (unknown or details)[0])
    missing = [dotted(detail["loc"]) for detail in details if detail["type"] == "missing"]
    if (
        unknown
        and missing
        and not any(first.endswith(f"did you mean {key.split('.')[-1]}?") for key in missing)
    ):
        return f"{first}; {missing[0]}: missing"
    return first
