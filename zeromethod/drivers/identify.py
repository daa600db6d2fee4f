"""A picture on each monitor that shows its index, how it lies and whether its pixels are exact."""

from __future__ import annotations

import time
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass

import cv2
import numpy as np

from zeromethod.arrays import Bytes
from zeromethod.devices.protocols import DisplayLost
from zeromethod.drivers.monitors import Monitor, by_index, monitors
from zeromethod.drivers.window import WindowDisplay

_BACKGROUND, _INK = 96, 255
_FONT = cv2.FONT_HERSHEY_SIMPLEX
_POLL_S = 0.02
_UNKNOWN_RATE_HZ = 60.0


@dataclass(frozen=True)
class Identified:
    """A monitor that showed its picture, and the warnings of its window."""

    monitor: Monitor
    warnings: tuple[str, ...]


def identify(
    seconds: float, index: int | None = None, turn_deg: float = 0.0, mirrored: bool = False
) -> tuple[Identified, ...]:
    """Show the identify picture on one monitor, or on all, for a time or until a key is pressed there.

    To be called in the main thread. A window that is closed ends it too.

    Parameters
    ----------
    seconds : float
        How long to show it.
    index : int, optional
        Of the monitor; all by default.
    turn_deg : float
        How the display is turned, as in the rig file.
    mirrored : bool
        Whether it is mirrored, as in the rig file.

    Returns
    -------
    tuple of Identified
        The monitors that showed it, with what their windows warned of.

    Raises
    ------
    InputError
        For an unknown index, without a screen, or when a window cannot be opened.
    """
    known = monitors()
    chosen = known if index is None else (by_index(known, index, "--identify"),)
    with ExitStack() as stack:
        displays = []
        for monitor in chosen:
            rate_hz = monitor.refresh_hz or _UNKNOWN_RATE_HZ
            display = WindowDisplay(monitor.columns, monitor.rows, rate_hz, monitor.index)
            stack.callback(display.close)
            displays.append(display)
        try:
            for monitor, display in zip(chosen, displays, strict=True):
                display.show(identify_picture(monitor, turn_deg, mirrored))
            _wait(displays, seconds)
        except DisplayLost:
            pass  # closed by hand, or unplugged: no longer to be shown
        warnings = [display.warnings for display in displays]
    return tuple(map(Identified, chosen, warnings))


def identify_picture(monitor: Monitor, turn_deg: float = 0.0, mirrored: bool = False) -> Bytes:
    """Grey codes (rows, cols) of the identify picture.

    On it: the monitor's index, name and mode; a line of one pixel along the outermost pixels; arrows along
    growing columns and rows; "P0" at the edge that lies towards P0 when the display is mounted with
    `turn_deg` and `mirrored` as in the rig file; and a checkerboard of single pixels, which looks evenly
    grey unless pixels are scaled or interpolated.
    """
    rows, columns = monitor.rows, monitor.columns
    image = np.full((rows, columns), _BACKGROUND, np.uint8)
    image[[0, -1], :] = _INK
    image[:, [0, -1]] = _INK
    unit = min(rows, columns) / 12
    _arrow(image, (unit, unit), (4 * unit, unit), "columns", unit)
    _arrow(image, (unit, unit), (unit, 4 * unit), "rows", unit)
    _text(image, (columns / 2, 0.36 * rows), str(monitor.index), 4 * unit)
    name = monitor.name.encode("ascii", "replace").decode()
    rate = f", {monitor.refresh_hz:.2f} Hz" if monitor.refresh_hz else ""
    _text(image, (columns / 2, 0.56 * rows), name, unit)
    _text(image, (columns / 2, 0.64 * rows), f"{columns} x {rows}{rate}", 0.6 * unit)
    _text(image, p0_place(monitor, turn_deg, mirrored, 0.7 * unit), "P0", 0.8 * unit)
    _checker(image, round(1.2 * unit))
    _text(image, (columns / 2, 0.89 * rows), "even grey: pixels are exact; bands: scaled", 0.35 * unit)
    return image


def p0_place(monitor: Monitor, turn_deg: float, mirrored: bool, margin_px: float) -> tuple[float, float]:
    """Middle of the edge towards P0, `margin_px` inside, as (column, row).

    Columns grow away from P0 at turn 0 (mirrored: towards it); `turn_deg` turns columns towards rows.
    """
    turn, first = np.deg2rad(turn_deg), -1 if mirrored else 1
    along_columns, along_rows = -first * np.cos(turn), first * np.sin(turn)
    half = np.array([monitor.columns, monitor.rows]) / 2
    towards = np.array([along_columns, 0.0] if abs(along_columns) >= abs(along_rows) else [0.0, along_rows])
    column, row = half + np.sign(towards) * (half - margin_px)
    return float(column), float(row)


def _wait(displays: Sequence[WindowDisplay], seconds: float) -> None:
    until = time.monotonic() + seconds
    while time.monotonic() < until and not any(display.key_pressed for display in displays):
        for display in displays:
            display.poll()
        time.sleep(_POLL_S)


def _text(image: Bytes, centre: tuple[float, float], text: str, height_px: float) -> None:
    thickness = max(1, round(height_px / 12))
    scale = cv2.getFontScaleFromHeight(_FONT, max(1, round(height_px)), thickness)
    (width, height), _ = cv2.getTextSize(text, _FONT, scale, thickness)
    widest = 0.95 * image.shape[1]
    if width > widest:
        scale, width, height = scale * widest / width, round(widest), round(height * widest / width)
    at = round(centre[0] - width / 2), round(centre[1] + height / 2)
    cv2.putText(image, text, at, _FONT, scale, _INK, thickness, cv2.LINE_AA)


def _arrow(
    image: Bytes, start: tuple[float, float], end: tuple[float, float], text: str, unit: float
) -> None:
    first, last = (round(start[0]), round(start[1])), (round(end[0]), round(end[1]))
    cv2.arrowedLine(image, first, last, _INK, max(1, round(unit / 12)), cv2.LINE_AA, tipLength=0.15)
    offset = 0.45 * unit
    middle = (start[0] + end[0]) / 2, (start[1] + end[1]) / 2
    shift = (0.0, offset) if start[1] == end[1] else (1.6 * offset + unit / 4, 0.0)
    _text(image, (middle[0] + shift[0], middle[1] + shift[1]), text, unit / 3)


def _checker(image: Bytes, size_px: int) -> None:
    rows, columns = image.shape
    top, left = round(0.77 * rows - size_px / 2), (columns - size_px) // 2
    row, column = np.mgrid[:size_px, :size_px]
    image[top : top + size_px, left : left + size_px] = 255 * ((row + column) % 2)
