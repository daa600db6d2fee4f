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


def fingerprint(tasks: Sequence[Message]) -> dict[str, Any]:
    """What a study's outcomes depend on: every task to the last digit, and the version that carries it out.

    Recordings are told by name, size and time of their last change.
    """
    digest = hashlib.sha256()
    for task in tasks:
        digest.update(json.dumps(task, sort_keys=True).encode())
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
    press, rest = task["rig"].get("press", ""), task["rig"]["prism"].get("rest", {}).get("file")
    names = [press if press.endswith(".toml") else None, rest, task["recording"]]
    told = []
    for name in names:
        if name is not None and os.path.exists(name):
            found = os.stat(name)
            told.append(f"{name} {found.st_size} {found.st_mtime_ns}")
    return told


class Journal:
    """The outcomes in a folder, one JSON a line, each on the disk before the next is waited for.

    `done`: outcome by run; where a run was done again, the last counts.
    """

    def __init__(self, folder: Path, study: dict[str, Any], *, anew: bool = False) -> None:
        """Open or begin. Raises InputError: another study's, in use by another process, or not writable."""
        self.path = folder / JOURNAL
        self.done: dict[int, Message] = {}
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
        """Take in what is there, drop a line cut off by a crash; whether a study was begun."""
        whole = 0
        self._file.seek(0)
        for number, line in enumerate(self._file):
            if not line.endswith(b"\n"):
                break
            try:
                said = json.loads(line)
            except ValueError:
                raise InputError(
                    f"--output: {self.path}: line {number + 1} is damaged: --anew begins anew"
                ) from None
            if number == 0:
                self._check(said.get("study"), study)
            else:
                self.done[said["run"]] = said
            whole += len(line)
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

    def _append(self, message: dict[str, Any]) -> None:
        self._file.write(json.dumps(message).encode() + b"\n")
        self._file.flush()
        os.fsync(self._file.fileno())
