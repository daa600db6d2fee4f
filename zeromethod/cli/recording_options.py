"""Options of `run` that ask for a recording, and the recorder that they ask for."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import click

from zeromethod.calibration.folder import DOCUMENT, Stored
from zeromethod.cli.numbers import Whole
from zeromethod.cli.output import several
from zeromethod.errors import InputError
from zeromethod.loop.loop import Loop
from zeromethod.rig.model import Rig

if TYPE_CHECKING:
    from zeromethod.recording.recorder import Recorder

NOTHING = "none"


def parts_of(ctx: click.Context, param: click.Parameter, value: str | None) -> tuple[str, ...] | None:  # noqa: ARG001
    """Parts of a recording that `--keep` names; None: not given. Raises InputError for other names."""
    if value is None:
        return None
    from zeromethod.recording.schema import KEEP  # noqa: PLC0415 - only who records needs it

    names = tuple(name.strip() for name in value.split(","))
    if names == (NOTHING,):
        return ()
    for name in names:
        if name not in KEEP:
            allowed = ", ".join(KEEP)
            raise InputError(f"--keep: {name!r}: of {allowed}, with commas between, or {NOTHING} alone")
    return names


recording_options = several(
    click.option(
        "--record", "recording", type=click.Path(path_type=Path, dir_okay=False), help="Record the run (.h5)."
    ),
    click.option(
        "--keep",
        metavar="PART,...",
        callback=parts_of,
        help="With --record, besides the tables: frames, residual, warps, surface; or none.  [default: all]",
    ),
    click.option(
        "--every", type=Whole(min=1), help="With --record: keep them of every n-th turn.  [default: 1]"
    ),
    click.option(
        "--compress", is_flag=True, help="With --record: arrays a fifth smaller, for processor time."
    ),
)


@dataclass(frozen=True)
class RecordingOptions:
    """What was asked for; `recording` None: no recording."""

    recording: Path | None = None
    keep: tuple[str, ...] | None = None
    every: int | None = None
    compress: bool = False

    def check(self) -> None:
        """Raise InputError for options without --record, and for a file that cannot be made."""
        if self.recording is not None:
            from zeromethod.recording.file import check_new  # noqa: PLC0415 - only who records needs it

            check_new(self.recording)
            return
        given = {"--keep": self.keep is not None, "--every": self.every, "--compress": self.compress}
        for option, value in given.items():
            if value:
                raise InputError(f"{option}: only with --record FILE.h5")

    def maker(self, rig: Rig, calibration: Stored | None) -> Callable[[Loop], Recorder] | None:
        """Make the recorder once there is a loop; None where none was asked for."""
        path = self.recording
        if path is None:
            return None

        def make(loop: Loop) -> Recorder:
            from zeromethod.recording.recorder import Recorder  # noqa: PLC0415 - as above
            from zeromethod.recording.schema import KEEP  # noqa: PLC0415

            document = (
                "" if calibration is None else (calibration.folder / DOCUMENT).read_text(encoding="utf-8")
            )
            return Recorder(
                path,
                rig,
                loop.rest,
                keep=KEEP if self.keep is None else self.keep,
                every=self.every or 1,
                compress=self.compress,
                command_line=shlex.join(["zeromethod", *sys.argv[1:]]),
                live=loop.live,
                gl_renderer=loop.gl_renderer,
                calibration=document,
            )

        return make

    def report(self, trouble: str) -> None:
        """Say what was recorded. trouble: what went wrong with it, "" for nothing."""
        if self.recording is not None and self.recording.exists():
            size = self.recording.stat().st_size / 1e6
            why = f"; {trouble}" if trouble else ""
            click.echo(f"recorded in {self.recording} ({size:.1f} MB{why})")
