"""A whole study: what is not yet done carried out, kept run by run, and put together into a table."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from zeromethod.errors import InputError
from zeromethod.study.plan import Study
from zeromethod.study.procedures import procedure
from zeromethod.study.resume import Journal, fingerprint
from zeromethod.study.table import Row, arrow, rows, write_seconds, write_table
from zeromethod.study.task import Message
from zeromethod.study.tasks import tasks

TABLE, SECONDS, COPY = "table.parquet", "seconds.csv", "study.toml"


class Executor(Protocol):
    """Whoever carries out runs: `pool.LocalPool` or `cluster.Cluster`."""

    def outcomes(self, tasks: Sequence[Message]) -> Iterator[Message]:
        """Outcome of every task, in any order."""


@dataclass(frozen=True)
class Results:
    """rows: the table, one row per run, in order. before: runs that an earlier go had done."""

    study: Study
    rows: list[Row]
    before: int

    @property
    def failures(self) -> list[Row]:
        """Rows of runs that failed."""
        return [row for row in self.rows if row["failure"] is not None]


@dataclass(frozen=True)
class Standing:
    """How far a study is. done: runs kept. total: runs in all. failed: of those done."""

    done: int
    total: int
    failed: int


def conduct(
    study: Study,
    folder: Path,
    executor: Executor,
    *,
    anew: bool = False,
    again: bool = False,
    on_standing: Callable[[Standing], None] = lambda _: None,
    on_outcome: Callable[[Message], None] = lambda _: None,
    tell: Callable[[str], None] = lambda _: None,
) -> Results:
    """Carry out what is not yet done of a study, write table.parquet and the rest into `folder`.

    anew: forget what is there. again: do failed runs again. on_standing: called when the study is opened and
    after each run; on_outcome: with each new outcome, once it is kept; tell: with a line for a person.

    Raises
    ------
    InputError
        A setting is wrong, `folder` holds another study, or pyarrow is missing.
    """
    arrow()
    planned = tasks(study)
    if not planned:
        raise InputError(f"{study.path}: no run")
    messages = [task.message() for task in planned]
    folder.mkdir(parents=True, exist_ok=True)
    with Journal(folder, fingerprint(messages), anew=anew) as journal:
        if journal.damaged:
            lines = ", ".join(map(str, journal.damaged))
            tell(f"{journal.path}: damaged at line {lines}: left out; what is missing is done again")
        (folder / COPY).write_text(study.text, encoding="utf-8")
        kept = {run for run, one in journal.done.items() if not (again and one["failure"] is not None)}
        todo = [message for message in messages if message["run"] not in kept]
        failed = sum(journal.done[run]["failure"] is not None for run in kept)
        on_standing(Standing(len(kept), len(messages), failed))
        if todo:
            outcomes = executor.outcomes(todo)
            try:
                for count, outcome in enumerate(outcomes, start=len(kept) + 1):
                    journal.add(outcome)
                    failed += outcome["failure"] is not None
                    on_outcome(outcome)
                    on_standing(Standing(count, len(messages), failed))
            finally:
                # the workers end here and now, not when the interpreter comes to forget them
                getattr(outcomes, "close", lambda: None)()
        found = rows(study, list(study.points()), journal.done, planned[0].metrics)
        write_table(folder / TABLE, study, procedure(study.table.procedure), found)
        write_seconds(folder / SECONDS, journal.done)
    return Results(study, found, len(kept))
