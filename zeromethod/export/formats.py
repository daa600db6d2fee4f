"""What a recording can be exported as, by the file's suffix."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from zeromethod.errors import InputError
from zeromethod.export.mcap import export_mcap
from zeromethod.export.mesh import export_mesh
from zeromethod.export.npz import export_npz
from zeromethod.export.selection import SelectedSteps, Selection, needed, require
from zeromethod.export.source import MapSource
from zeromethod.export.tiff import export_tiff
from zeromethod.export.track import export_rows, export_track
from zeromethod.recording.recording import Recording
from zeromethod.rig.model import Rig


@dataclass(frozen=True, slots=True)
class _Format:
    """How a format is written, and what of.

    library: of the extra `export`. groups: whose steps it has. parts: that must have been kept.
    """

    write: Callable[..., dict[str, Any]]
    suffixes: tuple[str, ...]
    library: str = ""
    groups: tuple[str, ...] = ("surface",)
    parts: tuple[str, ...] = ("surface",)
    purpose: str = ""


def _export_video(*common: Any) -> dict[str, Any]:
    from zeromethod.export.video import export_video  # noqa: PLC0415 - matplotlib loads slowly

    return export_video(*common)


def _rows(table: str, has: Callable[[Rig], bool], without: str) -> _Format:
    """A table of the recording as a .csv, by --format alone."""
    return _Format(partial(export_rows, table=table, has=has, without=without), (), groups=(), parts=())


_FORMATS = {
    "npz": _Format(export_npz, (".npz",)),
    "tiff": _Format(export_tiff, (".tif", ".tiff"), "tifffile"),
    "ply": _Format(partial(export_mesh, form="ply"), (".ply",), "trimesh"),
    "stl": _Format(partial(export_mesh, form="stl"), (".stl",), "trimesh"),
    "csv": _Format(export_track, (".csv",), groups=(), parts=()),
    "rubbing": _rows(
        "contact_status",
        lambda rig: rig.control.rubbing,
        "without --rubbing, so that it has no contact status",
    ),
    "pointers": _rows(
        "pointers",
        lambda rig: rig.projector is not None,
        "on a rig without [projector]: it has no pointer events",
    ),
    "approaches": _rows(
        "approaches", lambda rig: rig.watch is not None, "without a watch camera: it does not have what came"
    ),
    "mcap": _Format(export_mcap, (".mcap",), "mcap_ros2.writer", ("frames", "surface"), (), "an MCAP file"),
    "mp4": _Format(_export_video, (".mp4",), "av", ("frames",), ("frames", "residual", "surface"), "a video"),
}
FORMATS = tuple(_FORMATS)
MESHES = ("ply", "stl")
FINE_FORMATS = ("npz", "tiff", "csv", *MESHES)
"""Formats that have fine surfaces."""
SUFFIXES = {suffix: form for form, one in _FORMATS.items() for suffix in one.suffixes}
"""Format by suffix."""


@dataclass(frozen=True, slots=True)
class Export:
    """One file to be written."""

    recording: Recording
    form: str
    path: Path
    selected: SelectedSteps
    pitch_mm: float | None = None
    fine: bool = False

    def write(self, advance: Callable[[], None] = lambda: None) -> dict[str, Any]:
        """Write the file, whole or not at all. Returns its figures, which depend on the format.

        What is damaged in the recording is left out. advance: called once for every selected step. Raises
        MeasurementError where nothing was read that the file could hold, InputError where it is all damaged.
        """
        own: dict[str, Any] = {"pitch_mm": self.pitch_mm} if self.form == "tiff" else {}
        own |= {"fine": True} if self.fine else {}
        self.recording.leave_out_contrary_peaks(self.selected.steps)
        return _FORMATS[self.form].write(self.recording, self.selected, self.path, advance, **own)


def form_of(path: Path) -> str:
    """Format that a file's name asks for. Raises InputError for any other suffix."""
    form = SUFFIXES.get(path.suffix.lower())
    if form is None:
        raise InputError(f"OUT: {path}: the file name must end in {', '.join(SUFFIXES)}, or give --format")
    return form


def prepare(
    recording: Recording,
    path: Path,
    form: str | None = None,
    selection: Selection | None = None,
    pitch_mm: float | None = None,
    fine: bool = False,
) -> Export:
    """Look whether a recording has what a file needs; `Export.write` then writes it.

    form: one of `FORMATS`, by the suffix without. pitch_mm: of a TIFF's lattice. fine: the fine surfaces
    instead of those at the nodes. Raises InputError where it
    has not, or has nothing in the time selected, and where a library of the extra `export` is missing.
    """
    form = form or form_of(path)
    chosen, selection = _FORMATS[form], selection or Selection()
    if chosen.library:
        needed(chosen.library)
    if fine:
        return _prepare_fine(recording, path, form, selection, pitch_mm)
    groups = [part for part in chosen.groups if part in recording.kept]
    parts = chosen.parts or (() if groups else chosen.groups)
    require(recording, parts, chosen.purpose or f"a .{form} file")
    one = form in MESHES
    selected = selection.one(MapSource(recording)) if one else selection.several(recording, groups)
    return Export(recording, form, path, selected, pitch_mm)


def _prepare_fine(
    recording: Recording, path: Path, form: str, selection: Selection, pitch_mm: float | None
) -> Export:
    """`prepare` of fine surfaces."""
    if form not in FINE_FORMATS:
        raise InputError(f"--fine: .{form} has no fine surfaces: one of {', '.join(FINE_FORMATS)}")
    require(recording, () if form == "csv" else ("fine",), f"a .{form} file of fine surfaces")
    source = MapSource(recording, fine=True)
    if form in MESHES:
        selected = selection.one(source)
    elif form == "csv":  # the peaks are kept where the maps are not
        selected = selection.among(recording, recording.fine_peaks["step"], "fine surface")
    else:
        selected = selection.several(recording, (source.group,))
    return Export(recording, form, path, selected, pitch_mm, fine=True)


def export_recording(
    recording: Recording | str | Path,
    path: str | Path,
    *,
    form: str | None = None,
    from_s: float | None = None,
    to_s: float | None = None,
    every: int = 1,
    at_s: float | None = None,
    pitch_mm: float | None = None,
    fine: bool = False,
) -> dict[str, Any]:
    """Write a recording as a file that other programs open.

    Parameters
    ----------
    recording : Recording, str or Path
        What to export.
    path : str or Path
        File to write; its suffix chooses the format: .npz, .tif, .ply, .stl, .csv, .mcap, .mp4.
    form : str, optional
        Format, whatever the suffix: "npz", "tiff", "ply", "stl", "csv", "mcap" or "mp4"; or "rubbing",
        "pointers", "approaches": these tables of the recording as CSV.
    from_s, to_s : float, optional
        Part to export, seconds since the recording's first step.
    every : int
        Only every so many-th step.
    at_s : float, optional
        Time of a mesh; by default where |depth| is largest while locked.
    pitch_mm : float, optional
        Pixels of a TIFF; by default the nodes' own distance.
    fine : bool
        Export the fine surfaces, of every pixel: as npz, tiff, ply, stl or csv.

    Returns
    -------
    dict
        Figures of what was written, which depend on the format.

    Raises
    ------
    InputError
        For another suffix or format, a recording without what the format needs, and a missing library.
    """
    if not isinstance(recording, Recording):
        with Recording(recording) as opened:
            return export_recording(
                opened,
                path,
                form=form,
                from_s=from_s,
                to_s=to_s,
                every=every,
                at_s=at_s,
                pitch_mm=pitch_mm,
                fine=fine,
            )
    if form is not None and form not in FORMATS:
        raise InputError(f"form: {form!r}: allowed: {', '.join(FORMATS)}")
    selection = Selection(from_s, to_s, every, at_s)
    return prepare(recording, Path(path), form, selection, pitch_mm, fine).write()
