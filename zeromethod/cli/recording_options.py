"""Options of `run` that ask for a recording, and the recorder that they ask for."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import click

from zeromethod.calibration.folder import DOCUMENT, Stored
from zeromethod.cli.numbers import Whole
from zeromethod.cli.output import several
from zeromethod.errors import InputError
from zeromethod.loop.loop import Loop
from zeromethod.recording.schema import KEEP
from zeromethod.rig.model import Rig

if TYPE_CHECKING:
    from zeromethod.recording.recorder import Recorder
    from zeromethod.recording.recording import Recording

NOTHING = "none"


def parts_of(ctx: click.Context, param: click.Parameter, value: str) -> tuple[str, ...]:  # noqa: ARG001
    """Parts of a recording that `--keep` names. Raises InputError for other names."""
    names = tuple(name.strip() for name in value.split(","))
    if names == (NOTHING,):
        return ()
    for name in names:
        if name not in KEEP:
            allowed = ", ".join(KEEP)
            raise InputError(f"--keep: {name!r}: of {allowed}, with commas between, or {NOTHING} alone")
    return names


def _not_a_folder(ctx: click.Context, param: click.Parameter, value: Path) -> Path:  # noqa: ARG001
    if value.is_dir():
        raise InputError(f"{value}: is a folder; give a recording (HDF5)")
    return value


recording_argument = click.argument(
    "file", metavar="FILE", type=click.Path(path_type=Path), callback=_not_a_folder
)
time_options = several(
    click.option("--from", "from_s", type=float, metavar="S", help="Start at this time of the recording, s."),
    click.option("--to", "to_s", type=float, metavar="S", help="End at this time of the recording, s."),
)
recording_options = several(
    click.option(
        "--record",
        "recording",
        type=click.Path(path_type=Path, dir_okay=False),
        help="Record the run (.h5). Never replaces a file.",
    ),
    click.option(
        "--keep",
        metavar="PART,...",
        default=",".join(KEEP),
        callback=parts_of,
        help="With --record, next to the tables: frames, residual, warps, surface, fine; or none.  "
        "[default: all]",
    ),
    click.option(
        "--every",
        type=Whole(min=1),
        default=1,
        show_default=True,
        help="With --record: keep them of every n-th step.",
    ),
    click.option(
        "--compress", is_flag=True, help="With --record: arrays a fifth smaller, for processor time."
    ),
)


def open_recording(path: Path) -> Recording:
    """Open a recording to read it; one that is not whole is said to be so."""
    from zeromethod.recording.recording import Recording  # noqa: PLC0415 - `run` needs none

    recording = Recording(path)
    if not recording.complete:
        said = f"is still being written, or was cut off: {recording.seconds:.3f} s are in it"
        click.echo(f"! {path}: {said}", err=True)
    return recording


@dataclass(frozen=True)
class RecordingOptions:
    """What was asked for; `recording` None: no recording."""

    recording: Path | None
    keep: tuple[str, ...]
    every: int
    compress: bool

    def check(self, given: Sequence[str]) -> None:
        """Raise InputError for a file that cannot be made, and for options that need --record."""
        if self.recording is not None:
            from zeromethod.recording.file import check_new  # noqa: PLC0415 - only who records needs it

            check_new(self.recording)
        else:
            for option in given:
                if option in {"--keep", "--every", "--compress"}:
                    raise InputError(f"{option}: only with --record FILE.h5")

    def maker(
        self, rig: Rig, calibration: Stored | None, fine: bool = False
    ) -> Callable[[Loop], Recorder] | None:
        """Make the recorder once there is a loop; None where none was asked for.

        fine: of fine surfaces, too.
        """
        path = self.recording
        if path is None:
            return None

        def make(loop: Loop) -> Recorder:
            from zeromethod.recording.recorder import Recorder  # noqa: PLC0415 - as above

            document = (
                "" if calibration is None else (calibration.folder / DOCUMENT).read_text(encoding="utf-8")
            )
            return Recorder(
                path,
                rig,
                loop.rest,
                keep=self.keep,
                every=self.every,
                compress=self.compress,
                command_line=shlex.join(["zeromethod", *sys.argv[1:]]),
                live=loop.live,
                gl_renderer=loop.gl_renderer,
                calibration=document,
                fine=fine,
            )

        return make

    def report(self, trouble: str, astray: bool) -> None:
        """Say what was recorded. trouble: what went wrong with it. astray: it has lost its name."""
        if self.recording is not None and not astray and self.recording.exists():
            size = self.recording.stat().st_size / 1e6
            why = f"; {trouble}" if trouble else ""
            click.echo(f"recorded in {self.recording} ({size:.1f} MB{why})")
