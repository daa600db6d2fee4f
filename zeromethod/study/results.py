"""A whole study: the runs that are missing carried out and kept one by one, and all of them in one table."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from zeromethod.atomic_write import atomic_write
from zeromethod.errors import InputError, check_type
from zeromethod.study.journal import Journal, fingerprint
from zeromethod.study.plan import Study, load_study
from zeromethod.study.runs import WHOLE_LIMIT, Outcome, procedure
from zeromethod.study.task import Procedure
from zeromethod.study.tasks import tasks
from zeromethod.study.workers import Workers

TABLE, SECONDS, COPY = "table.parquet", "seconds.csv", "study.toml"

Row = dict[str, Any]

FIRST = {
    "run": "number of the run, from 0",
    "repeat": "number of the run among those at the same point of the grid, from 0",
    "seed": "seed of the run's simulated bench",
}
LAST = {"failure": "why the run failed; null where it did not"}


@dataclass(frozen=True, repr=False)
class Results:
    """Results of a study.

    Attributes
    ----------
    study : Study
        What was asked for.
    rows : list of dict
        The table, one row per run, in order.
    before : int
        Runs that were done when this call began.
    """

    study: Study
    rows: list[Row]
    before: int

    def __repr__(self) -> str:
        return f"Results({self.study.name!r}, {len(self.rows)} runs, {len(self.failures)} failed)"

    @property
    def failures(self) -> list[Row]:
        """Rows of runs that failed."""
        return [row for row in self.rows if row["failure"] is not None]


@dataclass(frozen=True)
class Progress:
    """done: runs kept. total: runs in all. failed: of those done. outcome: of the run that was just done."""

    done: int
    total: int
    failed: int
    outcome: Outcome | None = None


def run_study(
    study: Study | str | Path,
    folder: str | Path | None = None,
    workers: Workers | int | None = None,
    *,
    restart: bool = False,
    retry_failed: bool = False,
    on_progress: Callable[[Progress], None] = lambda _: None,
    report: Callable[[str], None] = lambda _: None,
) -> Results:
    """Carry out the missing runs of a study and put their figures into one table.

    A study that was interrupted goes on where it stopped when it is called again. Scripts need
    `if __name__ == "__main__":` around it, because workers import them.

    Parameters
    ----------
    study : Study, str or Path
        A study, a study file (.toml), or the name of a packaged study.
    folder : str or Path, optional
        Where table.parquet and the rest are written; study-NAME by default.
    workers : Workers or int, optional
        Who carries it out, or how many processes of this machine; one per core by default.
    restart : bool
        Forget the runs that are in the folder.
    retry_failed : bool
        Do runs again that failed.
    on_progress : callable, optional
        Called when the study is opened and after each run, once it is kept.
    report : callable, optional
        Called with a line for a person.

    Returns
    -------
    Results
        The rows of the table, and how many runs were there before.

    Raises
    ------
    InputError
        A setting is wrong, another study is in `folder`, or pyarrow or Dask is missing.
    """
    check_type(
        "study", study, Study | str | Path, "a Study, a study file (.toml), or a packaged study's name"
    )
    study = study if isinstance(study, Study) else load_study(study)
    folder = Path(f"study-{study.name}" if folder is None else folder)
    workers = Workers(workers) if workers is None or isinstance(workers, int) else workers
    _pyarrow()
    planned = tasks(study)
    if not planned:
        raise InputError(f"{study.path}: no run")
    folder.mkdir(parents=True, exist_ok=True)
    with Journal(folder, fingerprint(planned), restart=restart) as journal:
        if journal.damaged:
            lines = ", ".join(map(str, journal.damaged))
            report(f"{journal.path}: damaged at line {lines}: left out; what is missing is done again")
        (folder / COPY).write_text(study.text, encoding="utf-8")
        kept = {run for run, one in journal.done.items() if not (retry_failed and one["failure"] is not None)}
        failed = sum(journal.done[run]["failure"] is not None for run in kept)
        on_progress(Progress(len(kept), len(planned), failed))
        if todo := [task for task in planned if task.run not in kept]:
            # closed here and now: that ends the workers, whatever happened
            with closing(workers.outcomes(todo)) as outcomes:
                for count, outcome in enumerate(outcomes, start=len(kept) + 1):
                    journal.add(outcome)
                    failed += outcome["failure"] is not None
                    on_progress(Progress(count, len(planned), failed, outcome))
        found = _rows(study, journal.done, planned[0].metrics)
        _write_table(folder / TABLE, study, procedure(study.table.procedure), found)
        _write_seconds(folder / SECONDS, journal.done)
    return Results(study, found, len(kept))


def _rows(study: Study, done: Mapping[int, Outcome], metrics: Sequence[str]) -> list[Row]:
    """One row per run, in order: number, repeat, seed, what varies, figures, failure."""
    found = []
    for point in study.points():
        outcome = done[point.run]
        figures = outcome["figures"] or {}
        found.append(
            {"run": point.run, "repeat": point.repeat, "seed": point.seed}
            | {key: _cell(point.varied[key]) for key in study.varied}
            | {name: figures.get(name) for name in metrics}
            | {"failure": outcome["failure"]}
        )
    return found


def _write_table(path: Path, study: Study, chosen: Procedure, table: Sequence[Row]) -> None:
    """Write rows as Parquet, in one move.

    Each column's meaning stands in its metadata, the study file in the table's. What depends on the machine
    or the moment is not in it.
    """
    pa, parquet = _pyarrow()
    meanings = FIRST | dict(chosen.figures) | LAST
    fields, columns = [], []
    for name in table[0]:
        values = [row[name] for row in table]
        kind = _kind(values, name)
        meaning = {"meaning": meanings.get(name, "setting of the run")}
        fields.append(pa.field(name, getattr(pa, kind)(), metadata=meaning))
        columns.append(pa.array([_as(kind, value) for value in values], getattr(pa, kind)()))
    about = {"title": study.table.title, "study": study.text}
    written = pa.Table.from_arrays(columns, schema=pa.schema(fields, metadata=about))
    with atomic_write(path) as part:
        parquet.write_table(written, part)


def _write_seconds(path: Path, done: Mapping[int, Outcome]) -> None:
    """Write where and how long each run was carried out (.csv); differs from time to time."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(["run", "seconds", "host", "pid"])
        for run in sorted(done):
            worker = done[run]["worker"] or {"host": "", "pid": ""}
            writer.writerow([run, done[run]["seconds"], worker["host"], worker["pid"]])


def _pyarrow() -> tuple[Any, Any]:
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
