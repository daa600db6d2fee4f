"""Benchmarks in parts: each run's outcome is kept in a file, and a later start goes on from there."""

from __future__ import annotations

import hashlib
import json
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import click

from benchmarks.salt import held_out
from zeromethod.cli.numbers import Whole
from zeromethod.errors import InputError
from zeromethod.view.progress import progress


def part_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Add the options --keep and --most-runs, whose values `Parts` takes."""
    keep = click.option(
        "--keep",
        type=click.Path(dir_okay=False, path_type=Path),
        metavar="FILE",
        help="Keep every run's outcome here (JSON lines), and go on from what is there already.",
    )
    most = click.option(
        "--most-runs",
        type=Whole(min=0),
        help="With --keep: end after so many new runs, and report all that are kept.",
    )
    return keep(most(command))


class Parts:
    """Runs of a benchmark, each of which leaves a dictionary that JSON can hold.

    keep: file of what was found, None to keep nothing; its first line says by which program and settings, and
    another's is refused with InputError. most_runs: new ones at most.
    """

    def __init__(self, keep: Path | None, most_runs: int | None, **settings: Any) -> None:
        if most_runs is not None and keep is None:
            raise InputError("--most-runs: only with --keep")
        if keep is not None and held_out():
            raise InputError("--keep: not with --held-out, of which only totals are given")
        self._keep, self._most = keep, most_runs
        self._about = {"program": fingerprint(), **settings}
        self._kept: dict[int, Any] = {}
        if keep is not None and keep.exists():
            self._read(keep)

    def run(self, runs: int, words: str, one: Callable[[int], Any]) -> list[Any]:
        """Outcomes of runs 0 to `runs` - 1 in their order, those that the file has and new ones."""
        missing = [number for number in range(runs) if number not in self._kept][: self._most]
        with progress(len(missing), words) as advance:
            for number in missing:
                self._kept[number] = one(number)
                self._append(number)
                advance()
        return [self._kept[number] for number in range(runs) if number in self._kept]

    @contextmanager
    def folder(self) -> Iterator[Path]:
        """Folder for what runs share: next to the kept outcomes, or one that is taken away in the end."""
        if self._keep is not None:
            shared = self._keep.resolve().with_name(f"{self._keep.name}.{self._about['program']}")
            shared.mkdir(exist_ok=True)
            yield shared
            return
        with tempfile.TemporaryDirectory() as temporary:
            yield Path(temporary)

    def _read(self, path: Path) -> None:
        lines = path.read_text().splitlines()
        about, *outcomes = (json.loads(line) for line in lines)
        if about != self._about:
            raise InputError(f"--keep: {path}: made by other code or settings: give another file")
        self._kept = dict(outcomes)

    def _append(self, number: int) -> None:
        if self._keep is None:
            return
        lines = [] if self._keep.exists() else [self._about]
        text = "".join(json.dumps(line) + "\n" for line in (*lines, [number, self._kept[number]]))
        with self._keep.open("a") as file:
            file.write(text)


def fingerprint() -> str:
    """Of every source file of program, shaders, benchmarks, rig and press files, 16 hexadecimal digits."""
    root = Path(__file__).parent.parent
    digest = hashlib.sha256()
    for pattern in ("zeromethod/**/*.py", "benchmarks/**/*.py", "shaders/*.*", "calibration/**/*.toml"):
        for path in sorted(root.glob(pattern)):
            digest.update(path.read_bytes())
    return digest.hexdigest()[:16]
