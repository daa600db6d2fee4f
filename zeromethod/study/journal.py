"""The outcomes of a study on the disk, run by run, so that it can be resumed."""

from __future__ import annotations

import fcntl
import hashlib
import json
import os
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

from zeromethod.errors import InputError
from zeromethod.study.runs import Outcome
from zeromethod.study.task import Task

JOURNAL = "runs.jsonl"

_SCHEMA = 1
_OUTCOME = frozenset({"run", "seed", "figures", "failure", "seconds", "worker"})


def fingerprint(tasks: Sequence[Task]) -> dict[str, Any]:
    """What a study's outcomes depend on: every task to the last digit, and the version that carries it out.

    Files (press, rest map, recording) count by name, size and time of their last change.
    """
    digest = hashlib.sha256()
    for task in tasks:
        digest.update(task.as_json().encode())
        press = task.rig.scenario if task.rig.scenario.endswith(".toml") else None
        for name in (press, task.rig.prism.rest.file, task.recording):
            if name is not None and os.path.exists(name):
                found = os.stat(name)
                digest.update(f"{name} {found.st_size} {found.st_mtime_ns}".encode())
    return {
        "schema": _SCHEMA,
        "zeromethod": version("zeromethod"),
        "runs": len(tasks),
        "settings": digest.hexdigest(),
    }


class Journal:
    """The outcomes in a folder, one JSON a line, each on the disk before the next is waited for.

    `done`: outcome by run; where a run was done again, the last counts. `damaged`: numbers of the lines
    that could not be read when it was opened; they are gone, and their runs are not done.
    """

    def __init__(self, folder: Path, study: dict[str, Any], *, restart: bool = False) -> None:
        """Open or begin. Raises InputError: another study's, in use by another process, or not writable."""
        self.path = folder / JOURNAL
        self.done: dict[int, Outcome] = {}
        self.damaged: list[int] = []
        try:
            self._file = self.path.open("r+b" if self.path.exists() else "x+b")
        except OSError as error:
            raise InputError(f"--output: {self.path}: cannot be written: {error.strerror}") from None
        try:
            self._lock()
            if restart or not self._read(study):
                self._rewrite(study)
        except BaseException:
            self._file.close()
            raise

    def __enter__(self) -> Journal:
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()

    def add(self, outcome: Outcome) -> None:
        """Keep one outcome; on the disk when this returns."""
        self._append(outcome)
        self.done[outcome["run"]] = outcome

    def _lock(self) -> None:
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise InputError(
                f"--output: {self.path.parent}: a study is being run there: wait for it, or another folder"
            ) from None

    def _read(self, study: dict[str, Any]) -> bool:
        """Read what is there; whether it can be added to as it is, every line whole.

        A study without the line of a run is none: whatever its settings, nothing of it is lost.
        """
        *lines, cut = self._file.read().split(b"\n")
        parsed = [_parsed(line) for line in lines]
        head = parsed[0] if parsed else {}
        if head is None:
            raise InputError(
                f"--output: {self.path}: line 1, which says what study it is of, is damaged: "
                "another folder, or --restart to begin again"
            )
        if len(parsed) <= isinstance(head.get("study"), dict):
            return False
        self._check(head.get("study"), study)
        for number, found in enumerate(parsed[1:], start=2):
            if found is None or not found.keys() >= _OUTCOME:
                self.damaged.append(number)
            else:
                self.done[found["run"]] = found
        return not (cut or self.damaged)

    def _check(self, found: Any, study: dict[str, Any]) -> None:
        if found == study:
            return
        if not isinstance(found, dict) or found.get("schema") != _SCHEMA:
            what = "was written by a version that kept its runs otherwise"
        elif found["zeromethod"] != study["zeromethod"]:
            what = f"was begun by zeromethod {found['zeromethod']}, this is {study['zeromethod']}"
        elif found["runs"] != study["runs"]:
            what = f"is of {found['runs']} runs, the file now has {study['runs']}"
        else:
            what = "was begun with other settings, rig or seed than the file now has"
        raise InputError(
            f"--output: {self.path.parent}: what is there {what}: another folder, or --restart to begin again"
        )

    def _rewrite(self, study: dict[str, Any]) -> None:
        """Put what was read into a file of its own, in one move."""
        part = self.path.with_name(self.path.name + ".part")
        before, self._file = self._file, part.open("w+b")
        try:
            self._lock()
            self._append({"study": study}, *self.done.values())
            part.replace(self.path)
        finally:
            before.close()

    def _append(self, *messages: dict[str, Any]) -> None:
        for message in messages:
            self._file.write(json.dumps(message).encode() + b"\n")
        self._file.flush()
        os.fsync(self._file.fileno())


def _parsed(line: bytes) -> dict[str, Any] | None:
    """A line's table; None where it is damaged."""
    try:
        found = json.loads(line)
    except ValueError:
        return None
    return found if isinstance(found, dict) else None
