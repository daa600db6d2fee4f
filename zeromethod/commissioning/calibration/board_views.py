"""Views of a board: from picture files, or live, whenever the board stands still somewhere new."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from zeromethod.calibration.charuco import Board, BoardNotFoundError, View, margined, on_lcd
from zeromethod.commissioning.calibration.prompts import Silence, Teller
from zeromethod.devices.abilities import poll_of
from zeromethod.devices.opening import Devices
from zeromethod.devices.protocols import CameraLost, CameraTimeout
from zeromethod.errors import InputError, MeasurementError
from zeromethod.passive.measure import read_grey
from zeromethod.rig.model import Rig

STILL_PX = 0.5
"""Movement of the corners from frame to frame, rms, up to which the board stands still."""

NEW_SHARE = 0.03
"""Mean movement of the corners since every view before, of the picture's width, from which a view is new."""

LEAST_COMMON = 4
_LCD_TOLERANCE = 1e-3


@dataclass(frozen=True, eq=False)
class Views:
    """Views of a board. shape: (rows, columns) of the pictures. refused: name and reason of the others."""

    views: tuple[View, ...]
    shape: tuple[int, int]
    refused: tuple[tuple[str, str], ...] = ()


def views_in_files(
    paths: Sequence[Path], board: Board, least: int, advance: Callable[[], object] = lambda: None
) -> Views:
    """Look for the board in image files.

    Raises InputError for files that are no images or of several sizes, and, naming the files, where fewer
    than `least` show the board.
    """
    views, refused = [], []
    shape: tuple[int, int] | None = None
    for path in paths:
        image = read_grey(path)
        rows, columns = image.shape
        shape = shape or (rows, columns)
        if (rows, columns) != shape:
            raise InputError(f"{path}: {columns} x {rows} px: the first picture has {shape[1]} x {shape[0]}")
        try:
            views.append(board.find(path.name, image))
        except BoardNotFoundError as error:
            refused.append((path.name, str(error)))
        advance()
    assert shape is not None
    if len(views) < least:
        raise InputError(
            f"FRAMES: {len(views)} of {len(paths)} show the board ({board}), at least {least} must; "
            + _told(refused)
        )
    return Views(tuple(views), shape, tuple(refused))


def _told(refused: Sequence[tuple[str, str]]) -> str:
    """Names by reason, on one line."""
    by_reason: dict[str, list[str]] = {}
    for name, why in refused:
        by_reason.setdefault(why, []).append(name)
    return "; ".join(f"{', '.join(names)}: {why}" for why, names in by_reason.items()) or "take more"


def board_for_lcd(board: Board, rig: Rig) -> int:
    """LCD px of a square. Raises InputError where squares are not whole LCD px, saying which ones are."""
    pitch = rig.display.pitch_mm
    square_px = max(round(board.square_mm / pitch), 1)
    if abs(square_px * pitch / board.square_mm - 1.0) > _LCD_TOLERANCE:
        raise InputError(
            f"--board: squares of {board.square_mm:g} mm are not whole LCD px of {pitch:g} mm: "
            f"{square_px * pitch:.6g} mm are"
        )
    return square_px


def live_views(
    devices: Devices,
    rig: Rig,
    board: Board,
    count: int,
    patience_s: float,
    *,
    shown: bool,
    tell: Teller | None = None,
) -> Views:
    """Take `count` views from the open camera, each where the board stands still and was not before.

    shown: whether the board is put on the display. After `patience_s` without a new view, and on Ctrl-C, the
    views that there are are given. Raises MeasurementError for a camera that is lost.
    """
    tell = tell or Silence()
    if shown:
        square_px = board_for_lcd(board, rig)
        picture = margined(board.picture(square_px), square_px)
        devices.display.show(on_lcd(picture, rig.display.columns, rig.display.rows))
    taken: list[View] = []
    with tell.part("views of the board", count) as advance:
        tell.say("show the board to the camera, tilted, and hold it still until the view is taken")
        try:
            _take(devices, rig, board, count, patience_s, taken, tell, advance)
        except KeyboardInterrupt:
            tell.say("stopped: going on with the views there are")
        except CameraLost as error:
            raise MeasurementError(f"intrinsics: the camera is lost: {error}") from error
    return Views(tuple(taken), (rig.camera.rows, rig.camera.columns))


def _take(
    devices: Devices,
    rig: Rig,
    board: Board,
    count: int,
    patience_s: float,
    taken: list[View],
    tell: Teller,
    advance: Callable[[], object],
) -> None:
    poll = poll_of(devices.display)
    before: View | None = None
    last_ns = devices.clock.now_ns()
    why = "no frame came"
    while len(taken) < count:
        if devices.clock.now_ns() - last_ns > 1e9 * patience_s:
            tell.say(f"no new view within {patience_s:g} s ({why}): going on with the {len(taken)} there are")
            return
        if poll is not None:
            poll()
        try:
            image = devices.camera.read(rig.control.timeout_s).image
            view = board.find(f"view {len(taken) + 1}", image)
        except CameraTimeout:
            continue
        except BoardNotFoundError as error:
            before, why = None, str(error)
            continue
        still = before is not None and _moved_px(view, before) < STILL_PX
        new = all(_moved_px(view, one) > NEW_SHARE * rig.camera.columns for one in taken)
        before, why = view, "the board moves" if not still else "the board is where it was before"
        if still and new:
            taken.append(view)
            last_ns = devices.clock.now_ns()
            advance()
            if len(taken) < count:
                tell.say(f"view {len(taken)} of {count} taken: tilt and turn the board another way")


def _moved_px(one: View, other: View) -> float:
    """Rms distance of the corners both views show; infinite where they share few."""
    _, a, b = np.intersect1d(one.ids, other.ids, return_indices=True)
    if len(a) < LEAST_COMMON:
        return float("inf")
    return float(np.sqrt(np.mean(np.sum((one.pixel[a] - other.pixel[b]) ** 2, axis=-1))))
