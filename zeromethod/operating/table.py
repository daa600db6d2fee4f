"""Methods and readable values, described once: name, type, unit, range and words."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, Literal

from zeromethod.errors import InputError

Kind = Literal["number", "integer", "boolean", "text", "list"]

_CHECKED = {"number": (int, float), "integer": int, "boolean": bool, "text": str}
MOST_TEXT = 200
"""Characters of a text argument."""


def _is_text(value: str) -> bool:
    """Whether UTF-8 has all its characters; it has none for a lone surrogate."""
    try:
        value.encode()
    except UnicodeEncodeError:
        return False
    return True


@dataclass(frozen=True, slots=True)
class Quantity:
    """One argument or value. least, most: its range, None where there is no bound. default: when left out."""

    name: str
    type: Kind
    doc: str
    unit: str = ""
    least: float | None = None
    most: float | None = None
    default: Any = None
    required: bool = False

    def checked(self, method: str, value: Any) -> Any:
        """The value, if it is one. Raises InputError, one line: of another type, out of range, too long."""
        where = f"{method}: {self.name}: {value!r}"
        wrong = not isinstance(value, _CHECKED[self.type])  # type: ignore[arg-type]
        if wrong or (self.type != "boolean" and isinstance(value, bool)):
            raise InputError(f"{where}: a {self.type} is wanted")
        if isinstance(value, str) and len(value) > MOST_TEXT:
            raise InputError(f"{method}: {self.name}: {len(value)} characters: at most {MOST_TEXT}")
        if isinstance(value, str) and not _is_text(value):
            raise InputError(f"{where}: half a character, which cannot be written")
        if isinstance(value, float) and not math.isfinite(value):
            raise InputError(f"{where}: a finite number is wanted")
        below = self.least is not None and not isinstance(value, str) and value < self.least
        above = self.most is not None and not isinstance(value, str) and value > self.most
        if below or above:
            unit = f" {self.unit}" if self.unit else ""
            least = "any" if self.least is None else f"{self.least:g}"
            most = "any" if self.most is None else f"{self.most:g}"
            raise InputError(f"{where}: allowed: {least} to {most}{unit}")
        return value


@dataclass(frozen=True, slots=True)
class Method:
    """Something that can be done. key: in the terminal and on the page, "" for none."""

    name: str
    doc: str
    arguments: tuple[Quantity, ...] = ()
    key: str = ""

    def checked(self, given: Mapping[str, Any]) -> dict[str, Any]:
        """All arguments, defaults filled in. Raises InputError, one line, for what does not fit."""
        known = {one.name: one for one in self.arguments}
        for name in given:
            if name not in known:
                allowed = ", ".join(known) or "none"
                raise InputError(f"{self.name}: {name}: no such argument; allowed: {allowed}")
        found = {}
        for one in self.arguments:
            value = given.get(one.name)
            if value is None and one.required:
                raise InputError(f"{self.name}: {one.name}: missing: {one.doc}")
            found[one.name] = one.default if value is None else one.checked(self.name, value)
        return found


@dataclass(frozen=True)
class Table:
    """Everything that can be done and read. mode: "run", "replay", "calibrate" or "focus"."""

    mode: str
    methods: tuple[Method, ...]
    values: tuple[Quantity, ...]

    def method(self, name: str) -> Method:
        """The method of a name. Raises InputError, one line, where there is none."""
        for one in self.methods:
            if one.name == name:
                return one
        raise InputError(f"{name!r}: no such method; allowed: {', '.join(one.name for one in self.methods)}")

    @property
    def keys(self) -> dict[str, str]:
        """Methods by their keys."""
        return {one.key: one.name for one in self.methods if one.key}

    def described(self) -> dict[str, Any]:
        """The table as JSON has it."""
        return {
            "mode": self.mode,
            "methods": [asdict(one) for one in self.methods],
            "values": [asdict(one) for one in self.values],
        }
