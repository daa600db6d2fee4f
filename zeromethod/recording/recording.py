"""Reading a recording, finished or not."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Callable
from contextlib import AbstractContextManager
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from zeromethod.arrays import Float, Image, Ints, Single
from zeromethod.contact import ContactImage
from zeromethod.devices.protocols import Frame
from zeromethod.fine.lattice import PixelLattice
from zeromethod.fine.surface import FineSurface
from zeromethod.loop.events import Event
from zeromethod.loop.state import State
from zeromethod.recording.attributes import checked_attributes
from zeromethod.recording.contact_images import images
from zeromethod.recording.damage import contrary_peaks
from zeromethod.recording.growing import COMPLETE
from zeromethod.recording.opening import Refusal, RefusedRecording
from zeromethod.recording.schema import EVENTS, STATES
from zeromethod.recording.source import RecordingFile
from zeromethod.recording.step_index import StepIndex
from zeromethod.recording.surfaces import fine_surface, node_surface
from zeromethod.recording.tables import Tables
from zeromethod.rig.load import parse_rig
from zeromethod.rig.model import Rig
from zeromethod.sensing.residual import Residual
from zeromethod.surface import Surface
from zeromethod.toml_file import parse_toml
from zeromethod.warp.grid import NodeGrid
from zeromethod.warp.rest import Rest
from zeromethod.warp.rest_pixels import RestGrid
from zeromethod.warp.warp import Warp


class Recording(AbstractContextManager["Recording"]):
    """One recording, open for reading; it may still be written by another process: `refresh`.

    Tables are structured arrays, one row per step, picture, reading or drop, with the fields of
    `zeromethod.recording.schema`. Arrays are asked for by the number of their step; None: there are none.
    live: whether it ran in real time. kept: what was kept, of `schema.KEEP`. every: arrays were kept of every
    so many-th frame. seed: of the simulated bench. started_utc: ISO 8601. calibration: text of its document;
    "" without. rig_text: the rig as TOML, with all its values.
    tables: what is left out of them.
    Every read may raise InputError, one line: the file is damaged there. Damaged arrays are left out (None; a
    surface without a valid node), and damaged rows of tables, with one DamagedWarning per dataset.

    Parameters
    ----------
    path : str or Path
        The file.

    Raises
    ------
    InputError
        For a file that does not exist, is no recording, or was written by another version.
    """

    def __init__(self, path: str | Path) -> None:
        self._folder: tempfile.TemporaryDirectory[str] | None = None
        self._source = RecordingFile(path)
        self.path = self._source.path
        try:
            self._open()
        except BaseException:
            self._source.close()
            raise

    def _open(self) -> None:
        found = checked_attributes(self._source)
        self.live = bool(found["live"])
        self.kept = frozenset(str(name) for name in found["keep"])
        self.every, self.seed = int(found["every"]), int(found["seed"])
        self.command_line, self.started_utc = str(found["command_line"]), str(found["started_utc"])
        self.gl_renderer, self.calibration = str(found["gl_renderer"]), str(found["calibration"])
        self.versions: dict[str, str] = json.loads(found["versions"])
        self.zeromethod_version, self.rig_text = str(found["zeromethod_version"]), str(found["rig"])
        if found["compressed"]:
            import hdf5plugin  # noqa: F401, PLC0415 - knows the filters
        self.tables, self._index = Tables(self._source), StepIndex(self._source)

    def __repr__(self) -> str:
        frames = int(np.count_nonzero(self.steps["frame_number"] >= 0))
        end = "complete" if self.complete else "cut off, or still being written"
        rig = parse_toml(self.rig_text, self.path).get("name", "")
        return f"<Recording {self.path}: {self.seconds:.1f} s, {frames} frames, rig {rig}, {end}>"

    def close(self) -> None:
        """Close the file; may be called again."""
        self._source.close()
        if self._folder is not None:
            self._folder.cleanup()
        self._folder = None

    def __exit__(self, *_: object) -> None:
        self.close()

    def refresh(self) -> None:
        """See what was written since the last call; raises InputError where it cannot be read any more."""
        self._source.refresh()
        self.tables = Tables(self._source)
        self._index.measure()

    def steps_with(self, group: str) -> Ints:
        """Numbers of the steps that a group ("frames", "warps/measured", ...) has arrays of, rising."""
        numbers = self._index.numbers(group)
        return numbers[numbers >= 0]

    def is_damaged(self, group: str, number: int) -> bool:
        """Whether a group has damaged arrays of a step (`pictures`: of a row)."""
        return self._index.is_damaged(group, number)

    def damaged(self, advance: Callable[[], None] = lambda: None) -> dict[str, int]:
        """Number of damaged items by group, and of peaks that contradict theirs; reads the whole file."""
        found = self._index.damaged(advance)
        if contrary := self.leave_out_contrary_peaks():
            found["peaks"] = found.get("peaks", 0) + contrary
        return found

    def leave_out_contrary_peaks(self, among: Ints | None = None) -> int:
        """Leave peaks (of these steps, or all) that contradict their surfaces out of `peaks`; how many."""
        with self._source.silence():
            return self.tables.leave_out(contrary_peaks(self, among))

    @property
    def complete(self) -> bool:
        """Whether it was ended in order; false while it is being written, or where it was cut off."""
        # the nearer of 0 and 255, whatever bit may have changed
        return int(self._source.read("complete")).bit_count() > COMPLETE.bit_count() // 2

    @cached_property
    def rig(self) -> Rig:
        """The rig; files that it names lie in a folder that is removed when the recording is closed."""
        self._folder = tempfile.TemporaryDirectory(prefix="zeromethod-recording-")
        folder = Path(self._folder.name)
        for name in self._source.group("files"):
            (folder / Path(name).name).write_bytes(self._source.whole(name).tobytes())
        return parse_rig(self.rig_text, folder / "rig.toml")

    @cached_property
    def grid(self) -> NodeGrid:
        """The nodes, on the rays that they had; on the rig's, with a warning, where those are damaged."""
        grid = NodeGrid.of_rig(self.rig)
        nominal = np.stack(grid.mesh(), axis=-1)
        if self._source.is_whole("rest/node_pixels", nominal):
            return grid
        if not self._source.is_whole("rest/node_pixels"):
            self._source.leave_out_whole("rest", "node_pixels")
            return grid
        pixels = self._source.read("rest/node_pixels")
        return RestGrid(image_shape=grid.image_shape, period_px=grid.period_px, pixels=pixels)

    @cached_property
    def rest(self) -> Rest:
        """The warp of the untouched mirror that the run started from."""
        if not self._source.is_whole("rest/node_pixels", np.stack(self.grid.mesh(), axis=-1)):
            raise RefusedRecording(self.path, Refusal.CHANGED, part="rest/node_pixels")
        q, flags, mask = (self._source.whole(f"rest/{name}") for name in ("q", "flags", "mask"))
        display = self.rig.display
        return Rest(self.grid, q, flags, mask, (display.columns, display.rows))

    @property
    def steps(self) -> Image:
        """One row per step of the loop, but for damaged rows."""
        return self.tables.rows("steps")

    @property
    def turns(self) -> Image:
        """Number, time_ns and state of every step, also of damaged rows whose step was read."""
        return self.tables.turns()

    @property
    def presentation_log(self) -> Image:
        """One row per picture given to the panel, up to the first damaged one: `pictures` counts rows."""
        return self.tables.presentation_log()

    @property
    def peaks(self) -> Image:
        """Point of largest |depth| of every surface that was read: a structured array of named columns.

        step, time_s (since the first step), state (a word), depth_mm, depth_sigma_mm, possibly_deeper_mm,
        x_mm, y_mm, x_sigma_mm, y_sigma_mm, read_ms, time_ns (of the run's clock), where, as pandas takes it.
        """
        return self.tables.peaks()

    @property
    def fine_peaks(self) -> Image:
        """Point of largest |depth| of every fine surface, of `zeromethod.recording.schema.FINE_PEAKS`."""
        return self.tables.fine_peaks()

    @property
    def contacts(self) -> Image:
        """Contacts: a structured array of `zeromethod.recording.schema.CONTACTS`, a row per frame read."""
        return self.tables.contacts()

    def contact_images(self, step: int) -> dict[int, ContactImage]:
        """What touched in a step as images, by the contact's id.

        Parameters
        ----------
        step : int
            Number of the step; images are kept where its surface is.

        Returns
        -------
        dict of int to ContactImage
            Empty where there are none; large ones are coarser than the camera's pixels.
        """
        rows = self.tables.contact_images()
        return images(rows[rows["step"] == step])

    @property
    def drops(self) -> Image:
        """Frames that are not in the file, and why."""
        return self.tables.rows("drops")

    @property
    def notes(self) -> Image:
        """Messages to the operator."""
        return self.tables.rows("notes")

    @property
    def calls(self) -> Image:
        """Methods called during the run: a structured array of `zeromethod.recording.schema.CALLS`."""
        return self.tables.calls()

    @property
    def seconds(self) -> float:
        """From the first step to the last, s of the run's clock."""
        steps = self.turns
        return 1e-9 * float(steps["time_ns"][-1] - steps["time_ns"][0]) if len(steps) else 0.0

    @staticmethod
    def state_of(row: Any) -> State:
        """State of a row of `steps`."""
        return STATES[int(row["state"])]

    @staticmethod
    def events_of(row: Any) -> tuple[Event, ...]:
        """Events of a row of `steps`."""
        bits = int(row["events"])
        return tuple(event for index, event in enumerate(EVENTS) if bits >> index & 1)

    @staticmethod
    def text(field: bytes) -> str:
        """Text of a field: a reason, a note, why frames are missing."""
        return bytes(field).decode("utf-8", "replace")

    def row(self, step: int) -> Any:
        """Row of `steps`; None where there is none of that number."""
        index = int(np.searchsorted(numbers := self.steps["number"], step))
        return self.steps[index] if index < len(numbers) and numbers[index] == step else None

    def _array(self, group: str, step: int, name: str) -> Image | None:
        found = self._index.arrays(group, step, name)
        return None if found is None else np.asarray(found[0])

    def image(self, step: int) -> Image | None:
        """(rows, cols) frame as the camera gave it, uint8 or uint16."""
        return self._array("frames", step, "image")

    def frame(self, step: int) -> Frame | None:
        """The frame with its times, as the loop had it."""
        image, row = self.image(step), self.row(step)
        if image is None or row is None:
            return None
        times = (int(row[name]) for name in ("time_ns", "exposure_ns", "frame_number", "dropped"))
        return Frame(image, *times)

    def measured(self, step: int) -> Warp | None:
        """Warp by the step's frame alone, from the zero that was taken last; bit for bit as it was.

        None where what its sigma while nulling follows from was kept, but is damaged.
        """
        found, row = self._index.arrays("warps/measured", step, "q", "sigma", "flags"), self.row(step)
        if found is None or row is None:
            return None
        q, sigma, flags = found
        warp = Warp(q, sigma, flags, int(row["time_ns"]))
        shown, residual = self.shown(step), self.residual(step)
        parts = {"warps/shown": shown, "residual": residual}
        if any(part is None and self._index.holds(group) for group, part in parts.items()):
            return None
        if shown is None:
            return warp
        return warp.with_left(shown, self.zero(step), None if residual is None else residual.valid)

    def commanded(self, step: int) -> Single | None:
        """(rows, cols, 2) warp to be shown next, LCD px."""
        return self._array("warps/commanded", step, "q")

    def shown(self, step: int) -> Single | None:
        """(rows, cols, 2) mix of warps lit while the step's frame was exposed, LCD px."""
        return self._array("warps/shown", step, "q")

    def picture_q(self, index: int) -> Float | None:
        """(rows, cols, 2) warp of the picture in row `index` of `presentation_log`, LCD px, bit for bit."""
        return self._array("pictures", index, "q")

    def residual(self, step: int) -> Residual | None:
        """Residual in single precision; the carrier's amplitude is not kept: NaN."""
        found = self._index.arrays("residual", step, "d", "sigma", "flags", "mean")
        if found is None:
            return None
        d, sigma, flags, mean = found
        unknown = np.full(d.shape, np.nan, np.float32)
        return Residual(d.astype(np.float64), sigma.astype(np.float64), flags, unknown, mean)

    def surface(self, step: int) -> Surface | None:
        """Slope and depth that were read from the step, in single precision."""
        return node_surface(self, self._index, "surface", step)

    def fine(self, step: int) -> FineSurface | None:
        """Slope and depth on every pixel, read from the frames up to a step, in single precision.

        None where none was read or kept, or where it is damaged. `steps_with("fine")` are those with one.
        """
        return fine_surface(self, self._index, self._lattice, step)

    @cached_property
    def _lattice(self) -> PixelLattice:
        return PixelLattice(self.grid)

    def zero(self, step: int) -> Float | None:
        """(rows, cols, 2) LCD px, the zero from which `measured` of this step starts; None for the rig's."""
        steps = self._index.numbers("zeros")
        if (index := int(np.count_nonzero(steps <= step)) - 1) < 0:
            return None
        found = self._source.items("zeros", index, ("q",))
        if not found or steps.min() < 0:
            raise RefusedRecording(self.path, Refusal.CHANGED, part="zeros/q")
        return np.asarray(found["q"])


def open_recording(path: str | Path) -> Recording:
    """Open a recording that a run has written, or is still writing.

    Parameters
    ----------
    path : str or Path
        The file (.h5).

    Returns
    -------
    Recording
        A context manager; `close` it, or use it in a `with` statement.

    Raises
    ------
    InputError
        For a file that does not exist, is no recording, or was written by another version.
    """
    return Recording(path)
