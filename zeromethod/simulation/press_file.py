"""Press files: TOML in, checked paths out, or one line that says what is wrong."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated, NamedTuple

from pydantic import Field, ValidationError, model_validator

from zeromethod.errors import InputError
from zeromethod.resources import resource
from zeromethod.rig.refusal import first_refusal, refused
from zeromethod.rig.tables import NotNegative, Positive, Table
from zeromethod.simulation.contact.path import ObjectPath
from zeromethod.simulation.load_path import LoadPath
from zeromethod.simulation.object_file import ObjectTable
from zeromethod.simulation.path import PressPath
from zeromethod.simulation.press_table import PressTable
from zeromethod.toml_file import parse_toml, read_text


class Phase(Table):
    """A named part of the run."""

    name: Annotated[str, Field(min_length=1)]
    from_s: NotNegative
    to_s: Positive

    @model_validator(mode="after")
    def _forwards(self) -> Phase:
        if self.to_s <= self.from_s:
            raise refused("to_s", self.to_s, "above from_s")
        return self


class PressFile(Table):
    """A whole press file; `duration_s` defaults to the last time in it."""

    duration_s: Positive | None = None
    press: tuple[PressTable, ...] = ()
    object: tuple[ObjectTable, ...] = ()
    phase: tuple[Phase, ...] = ()

    def duration(self) -> float:
        """Seconds that a run of it lasts."""
        if self.duration_s is not None:
            return self.duration_s
        moved = [p.path[-1].time_s for p in self.press] + [p.path[-1].time_s for p in self.object]
        ends = moved + [p.to_s for p in self.phase]
        return max(ends, default=0.0) or 1.0


class PressFileContent(NamedTuple):
    """What a press file holds."""

    presses: tuple[PressPath, ...]
    loads: tuple[LoadPath, ...]
    objects: tuple[ObjectPath, ...]
    duration_s: float
    phases: tuple[Phase, ...]


def read_press_file(path: Path, asked: str) -> PressFileContent:
    """Content of a press file; `asked` is what the user called it.

    Raises InputError with one line.
    """
    names = ", ".join(sorted(p.stem for p in resource("calibration", "presses").glob("*.toml")))
    allowed = f"a readable press file or one of {names}"
    if not os.path.exists(path):
        raise InputError(f"press: {asked}: {allowed}")
    text = read_text(path, allowed)
    if not text.strip():
        raise InputError(
            f"{path}: empty: allowed: duration_s, [[press]], [[object]], [[phase]] (none.toml: no press)"
        )
    try:
        file = PressFile.model_validate(parse_toml(text, path))
    except ValidationError as error:
        raise InputError(f"{path}: {first_refusal(error, PressFile)}") from error
    pressed = [table.press(f"{path}: press[{index}]", path.parent) for index, table in enumerate(file.press)]
    presses = tuple(each for each in pressed if isinstance(each, PressPath))
    loads = tuple(each for each in pressed if isinstance(each, LoadPath))
    objects = tuple(table.path_of(number) for number, table in enumerate(file.object))
    return PressFileContent(presses, loads, objects, file.duration(), file.phase)
