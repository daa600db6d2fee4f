"""A whole study: what is not yet done carried out, kept run by run, and put together into a table."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from zeromethod.errors import InputError
from zeromethod.study.cluster import Cluster
from zeromethod.study.plan import Study, load_study
from zeromethod.study.pool import LocalPool
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
        Runs that an earlier call had done.
    """

    study: Study
    rows: list[Row]
    before: int

    def __repr__(self) -> str:
        return f"<Results of {self.study.name!r}: {len(self.rows)} runs, {len(self.failures)} failed>"

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


def run_study(
    study: Study | str | Path,
    folder: str | Path | None = None,
    *,
    workers: int | None = None,
    cluster: str | None = None,
    anew: bool = False,
    again: bool = False,
) -> Results:
    """Carry out the runs of a study, on every core or a Dask cluster, and put their figures into one table.

    A study that was interrupted goes on where it stopped when it is called again.

    Parameters
    ----------
    study : Study, str or Path
        A study, a study file (.toml), or the name of a packaged study.
    folder : str or Path, optional
        Where table.parquet and the rest are written; study-NAME by default.
    workers : int, optional
        Number of processes; one per core by default.
    cluster : str, optional
        Address of a Dask scheduler, tcp://host:8786, to use instead.
    anew : bool
        Forget the runs that are in the folder.
    again : bool
        Do runs again that failed.

    Returns
    -------
    Results
        The table's rows, one per run; `failures` are those that failed.

    Raises
    ------
    InputError
        For a study or setting that cannot be used, a folder with another study, or a missing library.
    MeasurementError
        Workers die, or the cluster is lost.
    """
    if cluster is not None and workers is not None:
        raise InputError(f"workers: {workers}: not with a cluster, which has its own")
    plan = study if isinstance(study, Study) else load_study(str(study))
    executor = LocalPool(workers) if cluster is None else Cluster(cluster)
    return conduct(plan, Path(folder or f"study-{plan.name}"), executor, anew=anew, again=again)
