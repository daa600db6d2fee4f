"""What is done of a study, kept on the disk run by run, so that it can be gone on with."""

from __future__ import annotations

import fcntl
import hashlib
import json
import os
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path
from types import TracebackType
from typing import Any

from zeromethod.errors import InputError
from zeromethod.study.task import Message

JOURNAL = "runs.jsonl"

_SCHEMA = 1
_OUTCOME = frozenset({"run", "seed", "figures", "failure", "seconds", "worker"})
_NOT_OF_FIGURES = "limit_s"
"""Key of a task that no figure depends on."""


def fingerprint(tasks: Sequence[Message]) -> dict[str, Any]:
    """What a study's outcomes depend on: every task to the last digit, and the version that carries it out.

    Recordings are told by name, size and time of their last change.
    """
    digest = hashlib.sha256()
    for task in tasks:
        told = {key: value for key, value in task.items() if key != _NOT_OF_FIGURES}
        digest.update(json.dumps(told, sort_keys=True).encode())
        for file in _files(task):
            digest.update(file.encode())
    return {
        "schema": _SCHEMA,
        "zeromethod": version("zeromethod"),
        "runs": len(tasks),
        "settings": digest.hexdigest(),
    }


def _files(task: Message) -> list[str]:
    """What tells the files of a task from changed ones."""
    press, rest = task["rig"].get("scenario", ""), task["rig"]["prism"].get("rest", {}).get("file")
    names = [press if press.endswith(".toml") else None, rest, task["recording"]]
    told = []
    for name in names:
        if name is not None and os.path.exists(name):
            found = os.stat(name)
            told.append(f"{name} {found.st_size} {found.st_mtime_ns}")
    return told


def _said(line: bytes) -> dict[str, Any] | None:
    """What a line says; None where it is damaged."""
    try:
        found = json.loads(line)
    except ValueError:
        return None
    return found if isinstance(found, dict) else None


class Journal:
    """The outcomes in a folder, one JSON a line, each on the disk before the next is waited for.

    `done`: outcome by run; where a run was done again, the last counts. `damaged`: numbers of the lines
    that could not be read when it was opened; they are gone, and their runs are not done.
    """

    def __init__(self, folder: Path, study: dict[str, Any], *, anew: bool = False) -> None:
        """Open or begin. Raises InputError: another study's, in use by another process, or not writable."""
        self.path = folder / JOURNAL
        self.done: dict[int, Message] = {}
        self.damaged: list[int] = []
        try:
            self._file = self.path.open("r+b" if self.path.exists() else "x+b")
        except OSError as error:
            raise InputError(f"--output: {self.path}: cannot be written: {error.strerror}") from None
        try:
            self._lock()
            if anew:
                self._file.truncate(0)
            if not self._read(study):
                self._append({"study": study})
            if self.damaged:
                self._rewrite(study)
        except BaseException:
            self._file.close()
            raise

    def __enter__(self) -> Journal:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._file.close()

    def add(self, outcome: Message) -> None:
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
        """Take in what is there, drop a line cut off by a crash; whether there is a study to go on with.

        One that was begun and has no line of a run is none: whatever its settings, nothing of it is lost.
        """
        whole, lines, begun = 0, 0, None
        self._file.seek(0)
        for number, line in enumerate(self._file):
            if not line.endswith(b"\n"):
                break
            said = _said(line)
            if number == 0:
                if said is None:
                    raise InputError(
                        f"--output: {self.path}: line 1, which says what study it is of, is damaged: "
                        "another folder, or --anew to begin anew"
                    )
                begun = said.get("study")
            elif said is None or not said.keys() >= _OUTCOME:
                self.damaged.append(number + 1)
            else:
                self.done[said["run"]] = said
            whole, lines = whole + len(line), lines + 1
        if lines == 1 and isinstance(begun, dict):
            whole = 0
        elif lines:
            self._check(begun, study)
        self._file.truncate(whole)
        self._file.seek(whole)
        return whole > 0

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
            f"--output: {self.path.parent}: what is there {what}: another folder, or --anew to begin anew"
        )

    def _rewrite(self, study: dict[str, Any]) -> None:
        """Put the lines that were read into a file of their own, in one move."""
        part = self.path.with_name(self.path.name + ".part")
        before, self._file = self._file, part.open("w+b")
        try:
            self._lock()
            for message in ({"study": study}, *self.done.values()):
                self._write(message)
            self._flush()
            part.replace(self.path)
        finally:
            before.close()

    def _append(self, message: dict[str, Any]) -> None:
        self._write(message)
        self._flush()

    def _write(self, message: dict[str, Any]) -> None:
        self._file.write(json.dumps(message).encode() + b"\n")

    def _flush(self) -> None:
        self._file.flush()
        os.fsync(self._file.fileno())
