"""Reading a recording, finished or not."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Callable
from functools import cached_property
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np

from zeromethod.arrays import Float, Image, Ints, Single
from zeromethod.devices.protocols import Frame
from zeromethod.errors import InputError
from zeromethod.loop.events import Event
from zeromethod.loop.state import State
from zeromethod.recording.damage import damaged_items, unknown_surface
from zeromethod.recording.schema import ANCHORS, EVENTS, SCHEMA, SCHEMA_VERSION, STATES, number_name
from zeromethod.recording.source import Source
from zeromethod.recording.sums import sum_of
from zeromethod.rig.load import parse_rig
from zeromethod.rig.model import Rig
from zeromethod.sensing.residual import Residual
from zeromethod.surface import Anchor, Surface
from zeromethod.warp.grid import NodeGrid
from zeromethod.warp.rest import Rest
from zeromethod.warp.rest_pixels import RestGrid
from zeromethod.warp.warp import Warp

ROOT = (
    "zeromethod_version",
    "versions",
    "command_line",
    "started_utc",
    "seed",
    "live",
    "keep",
    "every",
    "gl_renderer",
    "rig",
    "calibration",
    "compressed",
)


class Recording:
    """One recording, open for reading; it may still be written by another process: `refresh`.

    Tables are structured arrays, one row per turn, picture, reading or drop, with the fields of
    `zeromethod.recording.schema`. Arrays are asked for by the number of their turn; None: there are none.

    Whatever is read may raise InputError, one line: the file is damaged there. Arrays that are not what was
    written are left out (None; a surface without a valid node), which each dataset warns of once:
    DamagedWarning.

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
        self.path = Path(path)
        self._folder: tempfile.TemporaryDirectory[str] | None = None
        self._source = Source(self.path)
        try:
            self._attributes = self._checked()
            if self._attributes["compressed"]:
                import hdf5plugin  # noqa: F401, PLC0415 - knows the filters
            self._measure()
        except BaseException:
            self._source.close()
            raise

    def _checked(self) -> dict[str, Any]:
        attributes = self._source.attributes()
        if attributes.get("schema") != SCHEMA:
            raise InputError(f"{self.path}: an HDF5 file, but no recording of zeromethod")
        found = attributes.get("schema_version")
        if found != SCHEMA_VERSION:
            by = attributes.get("zeromethod_version", "an unknown version")
            raise InputError(
                f"{self.path}: schema_version: {found}, written by zeromethod {by}: "
                f"{SCHEMA_VERSION} is what this version of zeromethod reads"
            )
        missing = [name for name in ROOT if name not in attributes]
        if missing or not {"rest", "turns/table"} <= self._source.names:
            raise InputError(
                f"{self.path}: a recording that was cut off while it was begun: nothing is in it"
            )
        if int(attributes.get("rig_sum", 0)) not in {0, sum_of(str(attributes["rig"]).encode())}:
            raise InputError(f"{self.path}: rig: damaged: not what was written")
        return attributes

    def close(self) -> None:
        """Close the file; may be called again."""
        self._source.close()
        if self._folder is not None:
            self._folder.cleanup()
            self._folder = None

    def __enter__(self) -> Recording:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def refresh(self) -> None:
        """Take in what was written since the file was opened, or since the last call.

        Raises InputError: it cannot be read any more.
        """
        self._source.refresh()
        self._measure()

    def _measure(self) -> None:
        self._rows: dict[str, dict[int, int]] = {}
        self._lengths = {name: self._length(name) for name in self._groups}

    @cached_property
    def _groups(self) -> list[str]:
        """Names of the groups whose items belong to turns, or pictures to rows of presentations."""
        names = self._source.names
        groups = {name.rpartition("/")[0] for name in names}
        return sorted(group for group in groups if group and number_name(group) in names)

    def _length(self, group: str) -> int:
        """Items that all datasets of a group have."""
        return min(self._source.length(name) for name in self._source.group(group))

    def _at(self, group: str, turn: int) -> int | None:
        """Index in a group of what belongs to a turn."""
        if group not in self._lengths:
            return None
        if group not in self._rows:
            self._rows[group] = {int(number): i for i, number in enumerate(self._numbers(group))}
        return self._rows[group].get(int(turn))

    def turns_kept(self, group: str) -> Ints:
        """Numbers of the turns that a group ("frames", "warps/measured", ...) has arrays of, rising."""
        numbers = self._numbers(group)
        return numbers[numbers >= 0]

    def _numbers(self, group: str) -> Ints:
        """Numbers of a group's items; -1 where they are not known."""
        if group not in self._lengths:
            return np.zeros(0, np.int64)
        name = number_name(group).rpartition("/")[2]
        return self._source.numbers(group, name, self._lengths[group])

    def is_damaged(self, group: str, number: int) -> bool:
        """Whether a group has arrays of a turn (`pictures`: of a row) that are not what was written."""
        index = self._at(group, number)
        return index is not None and self._source.is_damaged(group, index)

    def damaged(self, advance: Callable[[], None] = lambda: None) -> dict[str, int]:
        """How many items of each group are left out as damaged, as `damaged_items` has it: reads all."""
        return damaged_items(self._source, self._lengths, advance)

    # About the recording

    @property
    def complete(self) -> bool:
        """Whether it was ended in order; false while it goes on, or where it was cut off."""
        return bool(self._source.read("complete"))

    @property
    def live(self) -> bool:
        """Whether it ran in real time."""
        return bool(self._attributes["live"])

    @property
    def kept(self) -> frozenset[str]:
        """What was kept: names of `zeromethod.recording.schema.KEEP`."""
        return frozenset(str(name) for name in self._attributes["keep"])

    @property
    def every(self) -> int:
        """Arrays were kept of every so many-th frame."""
        return int(self._attributes["every"])

    @property
    def seed(self) -> int:
        """Seed of the simulated bench."""
        return int(self._attributes["seed"])

    @property
    def command_line(self) -> str:
        """How the run was started."""
        return str(self._attributes["command_line"])

    @property
    def started_utc(self) -> str:
        """When it began, ISO 8601."""
        return str(self._attributes["started_utc"])

    @property
    def gl_renderer(self) -> str:
        """Name of what drew the pattern."""
        return str(self._attributes["gl_renderer"])

    @property
    def calibration(self) -> str:
        """Text of the calibration's document; "" without."""
        return str(self._attributes["calibration"])

    @property
    def zeromethod_version(self) -> str:
        """Version that wrote it."""
        return str(self._attributes["zeromethod_version"])

    @property
    def versions(self) -> dict[str, str]:
        """Versions of Python, the machine's system and the libraries that it was made with."""
        return dict(json.loads(self._attributes["versions"]))

    @property
    def rig_text(self) -> str:
        """The rig as TOML, with all its values."""
        return str(self._attributes["rig"])

    @cached_property
    def rig(self) -> Rig:
        """The rig; files that it names lie in a folder that goes when the recording is closed."""
        self._folder = tempfile.TemporaryDirectory(prefix="zeromethod-recording-")
        folder = Path(self._folder.name)
        for name in self._source.group("files"):
            (folder / Path(name).name).write_bytes(self._source.whole(name).tobytes())
        return parse_rig(self.rig_text, folder / "rig.toml")

    @cached_property
    def grid(self) -> NodeGrid:
        """The nodes, on the rays that they had."""
        camera = self.rig.camera
        grid = NodeGrid((camera.rows, camera.columns), self.rig.target.period_px)
        pixels = self._source.whole("rest/pixels")
        if np.array_equal(pixels, np.stack(grid.mesh(), axis=-1)):
            return grid
        return RestGrid(image_shape=grid.image_shape, period_px=grid.period_px, pixels=pixels)

    @cached_property
    def rest(self) -> Rest:
        """The warp of the untouched mirror that the run started from."""
        q, flags, seen = (self._source.whole(f"rest/{name}") for name in ("q", "flags", "seen"))
        display = self.rig.display
        return Rest(self.grid, q, flags, seen, (display.columns, display.rows))

    # Tables

    @property
    def turns(self) -> Image:
        """One row per turn of the loop."""
        return self._source.table("turns/table")

    @property
    def presentations(self) -> Image:
        """One row per picture given to the panel."""
        return self._source.table("presentations/table")

    @property
    def peaks(self) -> Image:
        """Point of largest |depth| of every surface that was read."""
        return self._source.table("peaks/table")

    @property
    def drops(self) -> Image:
        """Frames that are not in the file, and why."""
        return self._source.table("drops/table")

    @property
    def notes(self) -> Image:
        """What the operator was told."""
        return self._source.table("notes/table")

    def newest(self, table: str, count: int = 1) -> Image:
        """Last rows of a table ("turns", "peaks", ...), without reading the others."""
        name = f"{table}/table"
        rows: Image = self._source.read(name, slice(max(0, self._source.length(name) - count), None))
        return rows

    @property
    def seconds(self) -> float:
        """From the first turn to the last, s of the run's clock."""
        turns = self.turns
        return 1e-9 * float(turns["time_ns"][-1] - turns["time_ns"][0]) if len(turns) else 0.0

    @staticmethod
    def state_of(row: Any) -> State:
        """State of a row of `turns`."""
        return STATES[int(row["state"])]

    @staticmethod
    def events_of(row: Any) -> tuple[Event, ...]:
        """Events of a row of `turns`."""
        bits = int(row["events"])
        return tuple(event for index, event in enumerate(EVENTS) if bits >> index & 1)

    @staticmethod
    def words(field: bytes) -> str:
        """Text of a field: a reason, a note, why frames are missing."""
        return bytes(field).decode("utf-8", "replace")

    # Arrays of a turn

    def row(self, turn: int) -> Any:
        """Row of `turns`; None where there is none of that number."""
        numbers = self.turns["number"]
        index = int(np.searchsorted(numbers, turn))
        return self.turns[index] if index < len(numbers) and numbers[index] == turn else None

    def _arrays(self, group: str, turn: int, *names: str) -> list[Any] | None:
        index = self._at(group, turn)
        if index is None:
            return None
        found = self._source.items(group, index, names)
        return [found[name] for name in names] if len(found) == len(names) else None

    def image(self, turn: int) -> Image | None:
        """(rows, cols) frame as the camera gave it, uint8 or uint16."""
        found = self._arrays("frames", turn, "image")
        return None if found is None else found[0]

    def frame(self, turn: int) -> Frame | None:
        """The frame with its time, as the loop had it."""
        image, row = self.image(turn), self.row(turn)
        if image is None or row is None:
            return None
        times = (int(row[name]) for name in ("time_ns", "exposure_ns", "frame_number", "dropped"))
        return Frame(image, *times)

    def measured(self, turn: int) -> Warp | None:
        """Warp by the turn's frame alone, from the zero that was taken last; bit for bit as it was."""
        found, row = self._arrays("warps/measured", turn, "q", "sigma", "flags"), self.row(turn)
        if found is None or row is None:
            return None
        q, sigma, flags = found
        return Warp(q, sigma, flags, int(row["time_ns"]))

    def commanded(self, turn: int) -> Single | None:
        """(rows, cols, 2) warp to be shown next, LCD px."""
        found = self._arrays("warps/commanded", turn, "q")
        return None if found is None else found[0]

    def shown(self, turn: int) -> Single | None:
        """(rows, cols, 2) mix of warps that the turn's frame saw, LCD px."""
        found = self._arrays("warps/shown", turn, "q")
        return None if found is None else found[0]

    def presented_q(self, index: int) -> Float | None:
        """(rows, cols, 2) warp of the picture in row `index` of `presentations`, LCD px, bit for bit."""
        found = self._arrays("pictures", index, "q")
        return None if found is None else found[0]

    def residual(self, turn: int) -> Residual | None:
        """Residual as single precision kept it; the carrier's amplitude is not kept: NaN."""
        found = self._arrays("residual", turn, "d", "sigma", "flags", "mean")
        if found is None:
            return None
        d, sigma, flags, mean = found
        unknown = np.full(d.shape, np.nan, np.float32)
        return Residual(d.astype(np.float64), sigma.astype(np.float64), flags, unknown, mean)

    def surface(self, turn: int) -> Surface | None:
        """Slope and depth that were read from the turn, as single precision kept them."""
        names = ("depth_mm", "slope", "x_mm", "y_mm", "sigma_depth_mm", "sigma_slope")
        found = self._arrays("surface", turn, *names, "valid", "contact", "anchor", "table")
        if found is None:
            return None if self._at("surface", turn) is None else self._unknown(turn)
        *floats, valid, contact, mask, about = found
        values = {name: array.astype(np.float64) for name, array in zip(names, floats, strict=True)}
        sigma_mm, tail_mm = float(about["anchor_sigma_mm"]), float(about["anchor_tail_mm"])
        return Surface(
            **values,
            valid=valid,
            contact=contact,
            anchor=Anchor(ANCHORS[int(about["anchor"])], mask, sigma_mm, tail_mm),
            time_ns=int(about["time_ns"]),
            iterations=int(about["iterations"]),
        )

    def _unknown(self, turn: int) -> Surface:
        row = self.row(turn)
        return unknown_surface(self.grid.shape, 0 if row is None else int(row["time_ns"]))

    def zero(self, turn: int) -> Float | None:
        """(rows, cols, 2) LCD px, the zero that `measured` of this turn starts from; None for the rest's."""
        turns = self._numbers("zeros")
        index = int(np.count_nonzero(turns <= turn)) - 1
        if index < 0:
            return None
        found = self._source.items("zeros", index, ("q",))
        if not found or turns.min() < 0:
            raise InputError(
                f"{self.path}: zeros/q: damaged: what turn {turn} was measured from is not known"
            )
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
