"""What a command writes: files, refused before the work when they cannot be; lines and bars."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import click
import numpy as np
from rich.console import Console

from zeromethod.arrays import Bytes
from zeromethod.atomic_write import atomic_write, check_writable
from zeromethod.errors import InputError
from zeromethod.view.progress import progress

INCH_MM = 25.4

REPLACES = "Replaces a file."
"""What can be made again is replaced, in one move; recordings and rig files, made once, are refused."""


class OutputFile(click.Path):
    """A file that a command writes, with this suffix, in a folder that is there."""

    name = "file"

    def __init__(self, suffix: str, *, new: bool = False) -> None:
        """new: a file that exists already is refused."""
        super().__init__(path_type=Path)
        self._suffix, self._new = suffix, new

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Path:  # noqa: ARG002
        """Path of a text; raises InputError, one line."""
        option = max(param.opts, key=len) if param is not None else self._suffix
        path = Path(value)
        check_file(option, path, self._suffix)
        if self._new and path.exists():
            raise InputError(f"{option}: {path}: exists already: a recording never replaces a file")
        return path


def several(*options: Callable[[Any], Any]) -> Callable[[Any], Any]:
    """A decorator that adds these options to a command, in this order."""

    def add(command: Any) -> Any:
        for option in reversed(options):
            command = option(command)
        return command

    return add


summary_option = click.option(
    "--summary", type=OutputFile(".json"), help=f"Write the figures (.json). {REPLACES}"
)
figure_option = click.option("--figure", type=OutputFile(".png"), help=f"Write a picture (.png). {REPLACES}")


def check_file(option: str, path: Path | None, suffix: str) -> None:
    """Refuse an output file that cannot be written, with one line. None: not asked for."""
    if path is None:
        return
    if path.suffix.lower() != suffix:
        raise InputError(f"{option}: {path}: the file name must end in {suffix}")
    folder = path.absolute().parent
    if not folder.is_dir():
        raise InputError(f"{option}: {path}: the folder {folder} does not exist")
    with writing(option, path):
        check_writable(path)


def check_folder(option: str, path: Path | None) -> None:
    """Make an output folder, or refuse it with one line. None: not asked for."""
    if path is None:
        return
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{option}: {path}: must be a folder that can be made ({error.strerror})") from error
    with writing(option, path):
        check_writable(path / "x")


@contextmanager
def folder_for(option: str, path: Path) -> Iterator[None]:
    """Make an output folder as `check_folder` does; what was made and stays empty is removed again."""
    made = [one for one in (path, *path.parents) if not one.exists()]
    check_folder(option, path)
    try:
        yield
    finally:
        for one in made:
            with suppress(OSError):  # something was kept in it
                one.rmdir()


@contextmanager
def writing(option: str, path: Path) -> Iterator[None]:
    """Name the file, with InputError, that its disk does not take."""
    try:
        yield
    except OSError as error:
        why = error.strerror or " ".join(str(error).split())
        raise InputError(f"{option}: {path}: cannot be written: {why}") from None


def write_picture(option: str, path: Path, picture: Bytes, pixel_mm: float) -> float:
    """Write grey codes (rows, cols) to the .png of an option, for a printer; its dots per inch."""
    from matplotlib.image import imsave  # noqa: PLC0415 - it loads slowly

    dots_per_inch = INCH_MM / pixel_mm
    with writing(option, path), atomic_write(path) as part:
        imsave(part, picture, cmap="gray", vmin=0, vmax=255, dpi=dots_per_inch, format="png")
    return dots_per_inch


def write_summary(path: Path | None, figures: dict[str, Any]) -> None:
    """Write figures as JSON, in one move, so that a reader never sees half of it; what is no number: null.

    None: not asked for. Raises InputError where the disk does not take it.
    """
    if path is None:
        return
    with writing("--summary", path), atomic_write(path) as part:
        part.write_text(json.dumps(_plain(figures), indent=2) + "\n")


def _plain(value: Any) -> Any:
    """The same figures as JSON can say them."""
    if isinstance(value, dict):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, np.ndarray | np.generic):
        return _plain(value.tolist())
    return None if isinstance(value, float) and not np.isfinite(value) else value


class TerminalPrompts:
    """Progress bars, and lines above them, for procedures that ask a person to do something."""

    @contextmanager
    def part(self, words: str, total: int) -> Iterator[Callable[[], object]]:
        """A bar over `total` steps."""
        with progress(total, words) as advance:
            yield lambda: advance(words)

    def say(self, words: str) -> None:
        """A line on the terminal."""
        click.echo(words, err=True)


def wide_console(columns: int = 120) -> Console:
    """Standard output; so many columns wide where it is not a terminal, so that no table is cut."""
    return Console(width=None if sys.stdout.isatty() else columns, highlight=False)
