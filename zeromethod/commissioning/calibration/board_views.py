"""Views of a board: from picture files, or live, whenever the board stands still somewhere new."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from zeromethod.calibration.charuco import Board, NoView, View
from zeromethod.commissioning.calibration.prompts import Prompts, Silent
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
    """Views of a board. shape: (rows, columns) of the pictures. refused: reason by name of the others."""

    views: tuple[View, ...]
    shape: tuple[int, int]
    refused: dict[str, NoView]


def views_in_files(
    paths: Sequence[Path], board: Board, least: int, advance: Callable[[], object] = lambda: None
) -> Views:
    """Look for the board in image files.

    Raises InputError for files that are no images or of several sizes, and, naming the files, where fewer
    than `least` show the board.
    """
    views, refused, size = [], {}, (0, 0)
    for path in paths:
        image = read_grey(path)
        rows, columns = image.shape
        size = size if any(size) else (rows, columns)
        if (rows, columns) != size:
            raise InputError(f"{path}: {columns} x {rows} px: the first picture has {size[1]} x {size[0]}")
        found = board.find(path.name, image)
        if isinstance(found, View):
            views.append(found)
        else:
            refused[path.name] = found
        advance()
    if len(views) < least:
        lines = [
            f"{', '.join(name for name, why in refused.items() if why is reason)}: {reason}"
            for reason in dict.fromkeys(refused.values())
        ]
        raise InputError(
            f"FRAMES: {len(views)} of {len(paths)} show the board ({board}), at least {least} must; "
            + ("; ".join(lines) or "take more")
        )
    return Views(tuple(views), size, refused)


def square_on_lcd_px(board: Board, rig: Rig) -> int:
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
    prompts: Prompts | None = None,
) -> Views:
    """Take `count` views from the open camera, each where the board stands still and was not before.

    shown: whether the board is put on the display. After `patience_s` without a new view, and on Ctrl-C, the
    views that there are are given. Raises MeasurementError for a camera that is lost.
    """
    prompts = prompts or Silent()
    if shown:
        display = rig.display
        devices.display.show(board.on_lcd(square_on_lcd_px(board, rig), display.columns, display.rows))
    taken: list[View] = []
    with prompts.part("views of the board", count) as advance:
        prompts.say("show the board to the camera, tilted, and hold it still until the view is taken")
        try:
            for view in _still_views(devices, rig, board, patience_s, taken, prompts):
                taken.append(view)
                advance()
                if len(taken) == count:
                    break
                prompts.say(f"view {len(taken)} of {count} taken: tilt and turn the board another way")
        except KeyboardInterrupt:
            prompts.say("stopped: going on with the views there are")
        except CameraLost as error:
            raise MeasurementError(f"intrinsics: the camera is lost: {error}") from error
    return Views(tuple(taken), (rig.camera.rows, rig.camera.columns), {})


def _still_views(
    devices: Devices, rig: Rig, board: Board, patience_s: float, taken: Sequence[View], prompts: Prompts
) -> Iterable[View]:
    """Views where the board stands still, away from those `taken`, until none comes in time."""
    poll = poll_of(devices.display) or (lambda: None)
    before: View | NoView | None = None
    last_ns, why = devices.clock.now_ns(), "no frame came"
    while devices.clock.now_ns() - last_ns <= 1e9 * patience_s:
        poll()
        try:
            view = board.find(f"view {len(taken) + 1}", devices.camera.read(rig.control.timeout_s).image)
        except CameraTimeout:
            continue
        if isinstance(view, NoView):
            before, why = view, str(view)
            continue
        still = isinstance(before, View) and _moved_px(view, before) < STILL_PX
        before, why = view, "the board is where it was before" if still else "the board moves"
        if still and all(_moved_px(view, one) > NEW_SHARE * rig.camera.columns for one in taken):
            last_ns = devices.clock.now_ns()
            yield view
    prompts.say(f"no new view within {patience_s:g} s ({why}): going on with the {len(taken)} there are")


def _moved_px(one: View, other: View) -> float:
    """Rms distance of the corners both views show; infinite where they share few."""
    _, a, b = np.intersect1d(one.ids, other.ids, return_indices=True)
    if len(a) < LEAST_COMMON:
        return float("inf")
    return float(np.sqrt(np.mean(np.sum((one.pixel[a] - other.pixel[b]) ** 2, axis=-1))))
