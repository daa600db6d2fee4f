"""`zeromethod export`: a recording as files that other programs open."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path
from typing import Any

import click

from zeromethod.cli.numbers import Real, Whole
from zeromethod.cli.output import check_file, summary_option, write_summary, writing
from zeromethod.cli.stopping import stopped_by_signals
from zeromethod.errors import InputError
from zeromethod.export import FORMATS, MESHES, Export, Selection, form_of, prepare
from zeromethod.recording.recording import Recording
from zeromethod.thread_limits import limit_threads
from zeromethod.view.progress import progress


@click.command(
    "export", epilog="Example: zeromethod export session.h5 depth.tif peak.csv session.mp4 --from 1 --to 3"
)
@click.argument("file", type=click.Path(path_type=Path))
@click.argument(
    "outputs", metavar="OUT...", nargs=-1, required=True, type=click.Path(path_type=Path, dir_okay=False)
)
@click.option(
    "--format",
    "form",
    type=click.Choice(FORMATS),
    help="Format of OUT, whatever its name; by its suffix when left out.",
)
@click.option("--from", "from_s", type=float, metavar="S", help="Start at this time of the recording.")
@click.option("--to", "to_s", type=float, metavar="S", help="End at this time.")
@click.option(
    "--every", type=Whole(min=1), default=1, show_default=True, help="Export every n-th frame only."
)
@click.option(
    "--at",
    "at_s",
    type=float,
    metavar="S",
    help="Mesh at this time.  [default: where |depth| is largest while locked]",
)
@click.option(
    "--pitch",
    "pitch_mm",
    type=Real(min=0, min_open=True),
    metavar="MM",
    help="Pixels of a TIFF.  [default: the nodes' own distance]",
)
@summary_option
def export_command(
    file: Path,
    outputs: tuple[Path, ...],
    form: str | None,
    from_s: float | None,
    to_s: float | None,
    every: int,
    at_s: float | None,
    pitch_mm: float | None,
    summary: Path | None,
) -> None:
    """Write the recording FILE as OUT, by its suffix:

    \b
    .npz         slope and depth at the nodes, with their place in mm, over time
    .tif         depth and slope on a regular lattice in mm, over time (float, OME-TIFF)
    .ply .stl    the surface as a mesh in mm, at one time
    .csv         the track of the peak, the point of largest |depth|
    .mcap        camera, depth image, point cloud, peak, state for robots (ROS 2 types)
    .mp4         a video of camera, residual and depth

    Times are seconds since the recording's first turn.
    """  # noqa: D301, D400 - click's own mark for lines that stay as they are
    if file.is_dir():
        raise InputError(f"{file}: is a folder; give a recording (HDF5)")
    forms = _forms(outputs, form)
    _check_options(forms, every, at_s, pitch_mm)
    for path in outputs:
        check_file("OUT", path, suffix=path.suffix.lower())
        if path.resolve() == file.resolve():
            raise InputError(f"OUT: {path}: is the recording itself")
    limit_threads()
    selection = Selection(from_s, to_s, every, at_s)
    with stopped_by_signals(), Recording(file) as recording:
        exports = [
            prepare(recording, path, one, selection, pitch_mm)
            for path, one in zip(outputs, forms, strict=True)
        ]
        if not recording.complete:
            click.echo(
                f"! {file}: is still being written, or was cut off: exported up to {recording.seconds:.3f} s",
                err=True,
            )
        found = [_write(export) for export in exports]
    if summary is not None:
        write_summary(summary, {"recording": str(file), "files": found})


def _forms(outputs: tuple[Path, ...], form: str | None) -> list[str]:
    if form is not None and len(outputs) > 1:
        raise InputError(f"--format: {form}: for one OUT only; several go by their suffixes")
    if len({path.absolute() for path in outputs}) < len(outputs):
        raise InputError("OUT: the same file is named twice")
    return [form or form_of(path) for path in outputs]


def _check_options(forms: list[str], every: int, at_s: float | None, pitch_mm: float | None) -> None:
    """Refuse options that none of the files would use."""
    if at_s is not None and not set(forms) & set(MESHES):
        raise InputError(f"--at: {at_s:g}: only with a mesh (.ply, .stl); use --from and --to for the others")
    if pitch_mm is not None and "tiff" not in forms:
        raise InputError(f"--pitch: {pitch_mm:g}: for a .tif only")
    if every > 1 and set(forms) <= set(MESHES):
        raise InputError(f"--every: {every}: a mesh is of one time; choose it by --at")


def _write(export: Export) -> dict[str, Any]:
    """Write one file and say what is in it."""
    with ExitStack() as opened:
        advance = opened.enter_context(progress(len(export.selected.steps), first=export.path.name))
        opened.enter_context(writing("OUT", export.path))
        figures = export.write(lambda: advance(export.path.name))
    figures = {"file": str(export.path), "format": export.form, **figures}
    figures["bytes"] = export.path.stat().st_size
    click.echo(_line(export, figures))
    return figures


def _line(export: Export, figures: dict[str, Any]) -> str:
    times = export.selected.time_s
    when = (
        f"{times[0]:.3f} s" if len(times) == 1 else f"{len(times)} times, {times[0]:.3f} to {times[-1]:.3f} s"
    )
    parts = [f"{export.path}: {when}"]
    if export.form == "tiff":
        parts.append(f"{figures['columns']} x {figures['rows']} px of {figures['pitch_mm']:g} mm")
    elif export.form in MESHES:
        depth = f"largest depth {figures['depth_largest_mm']:.5f} mm"
        parts.append(f"{figures['vertices']} vertices, {depth}, in mm")
    elif export.form == "csv":
        parts.append(f"{figures['peaks']} peaks")
    elif export.form == "mcap":
        parts += [f"{topic} {count}" for topic, count in figures["messages"].items()]
    elif export.form == "mp4":
        parts.append(f"{figures['rate_hz']:.3f} frames/s, {figures['length_s']:.2f} s, {figures['codec']}")
    parts.append(f"{figures['bytes'] / 1e6:.2f} MB")
    return "; ".join(parts)
