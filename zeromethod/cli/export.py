"""`zeromethod export`: a recording as files that other programs open."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import click

from zeromethod.cli.numbers import Real, Whole
from zeromethod.cli.output import check_file, summary_option, write_summary, writing
from zeromethod.cli.recording_options import open_recording, recording_argument, time_options
from zeromethod.errors import InputError
from zeromethod.export import FORMATS, MESHES, Export, Selection, form_of, prepare
from zeromethod.recording import DamagedWarning
from zeromethod.recording.damage import damaged_words
from zeromethod.thread_limits import limit_threads
from zeromethod.view.progress import progress


@click.command(
    "export", epilog="Example: zeromethod export session.h5 depth.tif peak.csv session.mp4 --from 1 --to 3"
)
@recording_argument
@click.argument(
    "outputs", metavar="OUT...", nargs=-1, required=True, type=click.Path(path_type=Path, dir_okay=False)
)
@click.option(
    "--format",
    "form",
    type=click.Choice(FORMATS),
    help="Format of OUT, whatever its name; by its suffix when left out.",
)
@time_options
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
@click.option("--fine", is_flag=True, help="The fine surfaces of `run --fine`, of every pixel.")
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
    fine: bool,
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

    OUT may be a .csv of something else, with --format: rubbing (how a texture rubbed, of `run --rubbing`),
    pointers (what fingers did, of a rig with a projector), approaches (what a watch camera saw come).

    With --fine: .npz, .tif, .ply, .stl and .csv of the surfaces of every pixel.

    Times are seconds since the recording's first step.
    """  # noqa: D301, D400 - click's own mark for lines that stay as they are
    forms = _forms(outputs, form)
    _check_options(forms, every, at_s, pitch_mm)
    for path in outputs:
        check_file("OUT", path, suffix=path.suffix.lower())
        if path.resolve() == file.resolve():
            raise InputError(f"OUT: {path}: is the recording itself")
    limit_threads()
    selection = Selection(from_s, to_s, every, at_s)
    with open_recording(file) as recording, warnings.catch_warnings():
        # one line at the end says how much it was
        warnings.simplefilter("ignore", DamagedWarning)
        exports = [
            prepare(recording, path, one, selection, pitch_mm, fine)
            for path, one in zip(outputs, forms, strict=True)
        ]
        found = [_write(export) for export in exports]
        left_out, origin = recording.tables.left_out(), recording.tables.origin_words()
    write_summary(summary, {"recording": str(file), "files": found, "damaged": left_out})
    for words in filter(None, (damaged_words(left_out), origin)):
        click.echo(f"! {file}: {words}", err=True)


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
    steps, name = len(export.selected.steps), export.path.name
    with progress(steps, first=name) as advance, writing("OUT", export.path):
        figures = export.write(lambda: advance(name))
    figures = {"file": str(export.path), "format": export.form, **figures}
    figures["bytes"] = export.path.stat().st_size
    click.echo(_line(export, figures))
    return figures


_MESH = (
    "{vertices} vertices, largest measured depth {depth_largest_mm:.5f} mm (nothing inside contacts), in mm"
)
_ABOUT = {
    "npz": "",
    "tiff": "{columns} x {rows} px of {pitch_mm:g} mm",
    "csv": "{peaks} peaks",
    "rubbing": "{rows} frames with a contact status",
    "pointers": "{rows} pointer events",
    "approaches": "{rows} frames of the watch camera",
    "mp4": "{rate_hz:.3f} frames/s, {length_s:.2f} s, {codec}",
    **dict.fromkeys(MESHES, _MESH),
}


def _line(export: Export, figures: dict[str, Any]) -> str:
    times = export.selected.time_s
    several = f"{len(times)} times, {times[0]:.3f} to {times[-1]:.3f} s"
    parts = [f"{export.path}: {f'{times[0]:.3f} s' if len(times) == 1 else several}"]
    if export.form == "mcap":
        parts += [f"{topic} {count}" for topic, count in figures["messages"].items()]
    elif about := _ABOUT[export.form].format(**figures):
        parts.append(about)
    return "; ".join([*parts, f"{figures['bytes'] / 1e6:.2f} MB"])
