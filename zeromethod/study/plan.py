"""Study files: TOML in, a checked study out, or one line that says what is wrong."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from math import prod
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field

from zeromethod.errors import InputError
from zeromethod.resources import resource
from zeromethod.rig.refusal import shown, validated
from zeromethod.rig.tables import Count, Positive, Table, Text
from zeromethod.study.axes import DRAW_WORDS, RANGE_WORDS, axis_values, draw, run_seed
from zeromethod.study.task import LIMIT_S
from zeromethod.toml_file import parse_toml, read_text

SCHEMA_VERSION = 1
MOST_RUNS = 1_000_000

Settings = dict[str, Any]
"""Settings of one run by dotted key."""


class Start(Table):
    """The bench that every run starts from: a rig file or packaged name, its camera binned last of all."""

    file: Text = "simulated"
    binning: Annotated[int, Field(ge=1)] = 1


class FigureTable(Table):
    """What is drawn: column `y` over column `x`, a line for each combination of the values of `hue`.

    Repeated runs are shown by their median, with the range from 16 to 84 %. scale: "log" of y, "loglog" of x
    and y.
    """

    x: Text
    y: Text
    hue: tuple[Text, ...] = ()
    scale: Literal["linear", "log", "loglog"] = "linear"


class StudyTable(Table):
    """A study file. See docs/study.md."""

    schema_version: Literal[1]
    title: Text
    procedure: Text = "run"
    seed: Count = 0
    repeats: Annotated[int, Field(ge=1, le=MOST_RUNS)] = 1
    frames: Annotated[int, Field(ge=1)] | None = None
    seconds: Positive | None = None
    limit_s: Positive = LIMIT_S
    metrics: tuple[Text, ...] | None = None
    recordings: tuple[Text, ...] = ()
    rig: Start = Start()
    press: dict[str, Any] | None = None
    settings: dict[str, Any] = Field(default={}, alias="set")
    grid: dict[str, Any] = Field(default={})
    random: dict[str, Any] = Field(default={})
    figure: FigureTable | None = None


@dataclass(frozen=True)
class Point:
    """One run: its number, its seed and the settings that vary; the constant ones come before."""

    run: int
    repeat: int
    seed: int
    varied: Settings
    settings: Settings


@dataclass(frozen=True)
class Study:
    """A study as its file has it. path: of the file, in messages. text: of the file."""

    path: Path
    text: str
    table: StudyTable

    @property
    def name(self) -> str:
        """Name of the file."""
        return self.path.stem

    @cached_property
    def axes(self) -> dict[str, list[Any]]:
        """Values by key of the grid; the last key runs fastest."""
        axes = {key: axis_values(f"{self.path}: grid.{key}", given) for key, given in self.table.grid.items()}
        if self.table.recordings:
            axes = {"recording": self._recordings()} | axes
        return axes

    def _recordings(self) -> list[str]:
        """Files that [recordings] names, relative to the study file, sorted."""
        folder = self.path.parent
        found = set()
        for pattern in self.table.recordings:
            matches = {str(file.relative_to(folder)) for file in folder.glob(pattern)}
            if not matches:
                raise InputError(
                    f"{self.path}: recordings: {shown(pattern)}: no file matches below {folder.absolute()}"
                )
            found |= matches
        return sorted(found)

    @property
    def varied(self) -> list[str]:
        """Keys that differ from run to run, in the order of the table's columns."""
        return [*self.axes, *self.table.random]

    @property
    def count(self) -> int:
        """Number of runs."""
        return prod(map(len, self.axes.values())) * self.table.repeats

    def points(self) -> Iterator[Point]:
        """Every run, in order: the points of the grid, each `repeats` times.

        What is drawn at random is the same at every point of the grid, so that points compare like with like.
        """
        table, run = self.table, 0
        for values in product(*self.axes.values()):
            at = dict(zip(self.axes, values, strict=True))
            for repeat in range(table.repeats):
                drawn = {
                    key: draw(f"{self.path}: random.{key}", given, table.seed, key, repeat)
                    for key, given in table.random.items()
                }
                varied = at | drawn
                yield Point(run, repeat, run_seed(table.seed, run), varied, table.settings | varied)
                run += 1


def packaged_studies() -> list[str]:
    """Names of the studies that come with the package, sorted."""
    return sorted(path.stem for path in resource("studies").glob("*.toml"))


def load_study(name: str | Path) -> Study:
    """Study from a file, or a packaged one by bare name.

    Raises InputError, one line "file: key: value: what is allowed", for the first thing wrong. Settings are
    checked by `zeromethod.study.tasks`, which knows the rig.
    """
    path = Path(name)
    if not path.suffix and path.parent == Path() and not path.is_file():
        if str(name) not in packaged_studies():
            known = ", ".join(packaged_studies())
            raise InputError(f"FILE: {name}: a study file (.toml), or one of the packaged {known}")
        path = resource("studies", f"{name}.toml")
    return parse_study(read_text(path, "a study file (TOML)"), path)


def parse_study(text: str, path: Path) -> Study:
    """Study from the text of its file; `path` names it in messages, and files lie relative to it."""
    data = parse_toml(text, path)
    version = data.get("schema_version")
    if type(version) is not int or version != SCHEMA_VERSION:
        value = shown(version) if version is not None else "missing"
        raise InputError(f"{path}: schema_version: {value}: {SCHEMA_VERSION} is what this version reads")
    _flatten(data)
    study = Study(path, text, validated(StudyTable, data, path))
    _check(study)
    return study


def _flatten(data: dict[str, Any]) -> None:
    """Dotted keys may be quoted or not: `control.gain = 1` under [set] is "control.gain" = 1."""
    for name in ("set", "grid", "random"):
        table = data.get(name)
        if isinstance(table, dict):
            data[name] = dict(_leaves(table, name))


# a table with any of these is one of values; other words in it are refused where values are read
_WORDS = {*RANGE_WORDS, *DRAW_WORDS}


def _leaves(table: Mapping[str, Any], name: str, before: str = "") -> Iterator[tuple[str, Any]]:
    for key, value in table.items():
        dotted = f"{before}{key}"
        values = name != "set" and isinstance(value, dict) and (not value or _WORDS & set(value))
        if isinstance(value, dict) and not values:
            yield from _leaves(value, name, f"{dotted}.")
        else:
            yield dotted, value


def _check(study: Study) -> None:
    """Refuse what no rig is needed to see."""
    table, path = study.table, study.path
    if table.frames is not None and table.seconds is not None:
        raise InputError(f"{path}: seconds: {table.seconds:g}: frames or seconds, not both")
    for first, second in (("grid", "random"), ("set", "grid"), ("set", "random")):
        tables = {"set": table.settings, "grid": study.axes, "random": table.random}
        if twice := sorted(set(tables[first]) & set(tables[second])):
            raise InputError(f"{path}: {second}.{twice[0]}: also under [{first}]: in one of them only")
    if study.count > MOST_RUNS:
        raise InputError(f"{path}: {study.count} runs: at most {MOST_RUNS}: fewer values or repeats")
    if table.press is None:
        for key in (*table.settings, *study.varied):
            if key.startswith("press."):
                raise InputError(f"{path}: {key}: only with a table [press]")
