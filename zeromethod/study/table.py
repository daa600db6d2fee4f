"""The results as a Parquet table: one row per run, whatever the order in which they were carried out."""

from __future__ import annotations

import csv
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from zeromethod.atomic_write import atomic_write
from zeromethod.errors import InputError
from zeromethod.study.plan import Point, Study
from zeromethod.study.task import WHOLE_LIMIT, Message, Procedure

Row = dict[str, Any]

FIRST = {
    "run": "number of the run, from 0",
    "repeat": "number of the run among those at the same point of the grid, from 0",
    "seed": "seed of the run's simulated bench",
}
LAST = {"failure": "why the run failed; null where it did not"}


def rows(
    study: Study, points: Sequence[Point], done: Mapping[int, Message], metrics: Sequence[str]
) -> list[Row]:
    """One row per run, in order: number, repeat, seed, what varies, figures, failure."""
    found = []
    for point in points:
        outcome = done[point.run]
        figures = outcome["figures"] or {}
        found.append(
            {"run": point.run, "repeat": point.repeat, "seed": point.seed}
            | {key: _cell(point.varied[key]) for key in study.varied}
            | {name: figures.get(name) for name in metrics}
            | {"failure": outcome["failure"]}
        )
    return found


def write_table(path: Path, study: Study, chosen: Procedure, table: Sequence[Row]) -> None:
    """Write rows as Parquet, in one move. Raises InputError without pyarrow.

    Each column's meaning stands in its metadata, the study file in the table's. What depends on the machine
    or the moment is not in it.
    """
    pa, parquet = arrow()
    words = FIRST | dict(chosen.figures) | LAST
    fields, columns = [], []
    for name in table[0]:
        values = [row[name] for row in table]
        kind = _kind(values, name)
        meaning = {"meaning": words.get(name, "setting of the run")}
        fields.append(pa.field(name, getattr(pa, kind)(), metadata=meaning))
        columns.append(pa.array([_as(kind, value) for value in values], getattr(pa, kind)()))
    about = {"title": study.table.title, "study": study.text}
    written = pa.Table.from_arrays(columns, schema=pa.schema(fields, metadata=about))
    with atomic_write(path) as part:
        parquet.write_table(written, part)


def write_seconds(path: Path, done: Mapping[int, Message]) -> None:
    """Write where and how long each run was carried out (.csv); differs from time to time."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(["run", "seconds", "host", "pid"])
        for run in sorted(done):
            worker = done[run]["worker"] or {"host": "", "pid": ""}
            writer.writerow([run, done[run]["seconds"], worker["host"], worker["pid"]])


def arrow() -> tuple[Any, Any]:
    """Import pyarrow and pyarrow.parquet. Raises InputError, one line, where they are not installed."""
    try:
        import pyarrow  # noqa: PLC0415 - an extra
        import pyarrow.parquet  # noqa: PLC0415
    except ImportError:
        raise InputError("study: results are written by pyarrow: pip install 'zeromethod[study]'") from None
    return pyarrow, pyarrow.parquet


def _cell(value: Any) -> Any:
    """Value of a setting as one cell: a list as JSON text."""
    return json.dumps(value) if isinstance(value, list | dict) else value


def _kind(values: Sequence[Any], name: str) -> str:
    """Type of a column: that of all its values, text where they differ in kind."""
    if name in LAST:
        return "string"
    # TOML has whole numbers of any size, a column has not
    if any(type(value) is int and abs(value) >= WHOLE_LIMIT for value in values):
        return "string"
    kinds = {type(value) for value in values if value is not None}
    if kinds <= {bool} and kinds:
        return "bool_"
    if kinds == {int}:
        return "uint32" if name == "seed" else "int64"
    return "float64" if kinds <= {int, float} else "string"


def _as(kind: str, value: Any) -> Any:
    if value is None or kind not in {"string", "float64"}:
        return value
    return float(value) if kind == "float64" else str(value)
