"""ChArUco boards: drawn for paper or an LCD, and found in pictures.

A chessboard whose white squares hold ArUco markers, so that each corner tells which one it is and a part of
the board is enough (S. Garrido-Jurado et al., Pattern Recognition 47 (2014) 2280,
doi:10.1016/j.patcog.2014.01.005). Drawn and found by OpenCV.
"""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from zeromethod.arrays import Bytes, Float, Image
from zeromethod.atomic_write import atomic_write
from zeromethod.errors import InputError

DICTIONARIES = tuple(f"{bits}X{bits}_{count}" for bits in (4, 5, 6, 7) for count in (50, 100, 250, 1000))
DEFAULT_DICTIONARY = "5X5_250"
MARKER_SHARE = 0.75
"""Side of a marker over that of its square, unless told."""

LEAST_SQUARES, MOST_SQUARES = 3, 100
LEAST_CORNERS = 8
"""Corners that a picture must show to count."""

LEAST_MARKERS = 6
"""Markers in a picture that must have corners between them, if they are the board's."""

_WINDOW_SHARE, _LEAST_WINDOW_PX, _MOST_WINDOW_PX = 0.7, 2, 12
"""Half a window to refine a corner in: of the distance from corner to marker, and its bounds."""

_LEAST_SQUARE_PX = 16
_MM_PER_INCH = 25.4


class BoardNotFoundError(Exception):
    """A picture does not show the board; the message says why, in words."""


@dataclass(frozen=True, eq=False)
class View:
    """The board in one picture. ids: (n,) of corners. pixel: (n, 2) camera px, centres at integers."""

    name: str
    ids: NDArray[np.int_]
    pixel: Float


@dataclass(frozen=True)
class Board:
    """A board of columns x rows squares, lengths in mm. dictionary: one of `DICTIONARIES`.

    Raises InputError for a board that cannot be.
    """

    columns: int
    rows: int
    square_mm: float
    marker_mm: float
    dictionary: str = DEFAULT_DICTIONARY

    def __post_init__(self) -> None:
        if not (
            LEAST_SQUARES <= min(self.columns, self.rows) <= max(self.columns, self.rows) <= MOST_SQUARES
        ):
            raise InputError(
                f"board: {self.columns}x{self.rows} squares: {LEAST_SQUARES} to {MOST_SQUARES} each way"
            )
        if not (np.isfinite(self.square_mm) and 0.0 < self.marker_mm < self.square_mm):
            raise InputError(
                f"board: square {self.square_mm:g} mm, marker {self.marker_mm:g} mm: above 0, the marker less"
            )
        if self.dictionary not in DICTIONARIES:
            raise InputError(f"board: {self.dictionary}: one of {', '.join(DICTIONARIES)}")
        have = int(self.dictionary.split("_")[1])
        if self.markers > have:
            raise InputError(
                f"board: {self.columns}x{self.rows} squares need {self.markers} markers: {self.dictionary} "
                f"has {have}"
            )

    @property
    def markers(self) -> int:
        """How many white squares there are."""
        return self.columns * self.rows // 2

    @property
    def corners(self) -> int:
        """How many inner corners there are."""
        return (self.columns - 1) * (self.rows - 1)

    def __str__(self) -> str:
        return f"{self.columns}x{self.rows} squares of {self.square_mm:g} mm, {self.dictionary}"

    def points_mm(self, ids: NDArray[np.int_]) -> Float:
        """(n, 3) places of corners on the board, z = 0."""
        return np.asarray(self._cv.getChessboardCorners(), np.float64)[ids]

    def picture(self, square_px: int) -> Bytes:
        """(rows square_px, columns square_px) picture, without a margin. Raises InputError below 16 px."""
        if square_px < _LEAST_SQUARE_PX:
            raise InputError(
                f"board: squares of {square_px} px: at least {_LEAST_SQUARE_PX}, for their markers"
            )
        size = self.columns * square_px, self.rows * square_px
        return np.asarray(self._cv.generateImage(size, marginSize=0), np.uint8)

    def find(self, name: str, image: Image) -> View:
        """Corners in a picture (rows, cols) of any integer type; raises BoardNotFoundError."""
        grey = _grey(image)
        corners, ids, _, marker_ids = self._detector.detectBoard(grey)
        if marker_ids is None or len(marker_ids) == 0:
            raise BoardNotFoundError(f"no markers of {self.dictionary}")
        strange = int(np.count_nonzero(marker_ids >= self.markers))
        if strange > 0.2 * len(marker_ids):
            raise BoardNotFoundError(
                f"markers past number {self.markers - 1}, the board's last: of another board"
            )
        count = 0 if ids is None else len(ids)
        if count == 0 and len(marker_ids) >= LEAST_MARKERS:
            raise BoardNotFoundError("markers, but none of the board's corners: of another board")
        if count < LEAST_CORNERS:
            raise BoardNotFoundError(f"{count} of {self.corners} corners: at least {LEAST_CORNERS}")
        found = np.asarray(ids).ravel().astype(int)
        pixel = np.asarray(corners, np.float64).reshape(-1, 2)
        place = self.points_mm(found)[:, :2]
        if np.linalg.matrix_rank(place - place.mean(axis=0), tol=0.1 * self.square_mm) < 2:
            raise BoardNotFoundError("all corners on one line")
        return View(name, found, self._refined(grey, found, pixel))

    def _refined(self, grey: Bytes, ids: NDArray[np.int_], pixel: Float) -> Float:
        """Corners anew from windows that end before the markers, which draw them by tenths of a px."""
        place = self.points_mm(ids)[:, :2] / self.square_mm
        apart = np.linalg.norm(place[:, None] - place, axis=-1)
        seen = np.linalg.norm(pixel[:, None] - pixel, axis=-1)
        pairs = (apart > 0.9) & (apart < 1.5)
        if not pairs.any():
            return pixel
        square_px = float((seen[pairs] / apart[pairs]).min())
        free_px = 0.5 * (1.0 - self.marker_mm / self.square_mm) * square_px
        half = int(np.clip(_WINDOW_SHARE * free_px, _LEAST_WINDOW_PX, _MOST_WINDOW_PX))
        start = pixel.astype(np.float32).reshape(-1, 1, 2)
        criteria = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 50, 1e-4)
        return np.asarray(
            cv2.cornerSubPix(grey, start, (half, half), (-1, -1), criteria), np.float64
        ).reshape(-1, 2)

    @cached_property
    def _cv(self) -> Any:
        dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, f"DICT_{self.dictionary}"))
        size = self.columns, self.rows
        return cv2.aruco.CharucoBoard(size, self.square_mm, self.marker_mm, dictionary)

    @cached_property
    def _detector(self) -> Any:
        parameters = cv2.aruco.DetectorParameters()
        parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
        return cv2.aruco.CharucoDetector(self._cv, cv2.aruco.CharucoParameters(), parameters)


def board_of(text: str, dictionary: str = DEFAULT_DICTIONARY) -> Board:
    """Board as it is typed: COLUMNSxROWS:SQUARE or COLUMNSxROWS:SQUARE:MARKER, mm. Raises InputError."""
    size, *lengths = text.split(":")
    columns, _, rows = size.lower().partition("x")
    try:
        count, (square, *marker) = (int(columns), int(rows)), [float(one) for one in lengths]
        (marker_mm,) = marker or [MARKER_SHARE * square]
    except ValueError:
        raise InputError(
            f"--board: {text}: COLUMNSxROWS:SQUARE, or with :MARKER, in mm, as 12x9:10 or 12x9:10:7.5"
        ) from None
    try:
        return Board(*count, square, marker_mm, dictionary)
    except InputError as error:
        raise InputError(f"--{error}") from None


def margined(picture: Bytes, square_px: int) -> Bytes:
    """The picture within white of half a square, which markers at the border need."""
    return np.pad(picture, square_px // 2, constant_values=255)


def on_lcd(picture: Bytes, columns: int, rows: int) -> Bytes:
    """The picture in the middle of a white LCD. Raises InputError where it does not fit."""
    height, width = picture.shape
    if height > rows or width > columns:
        raise InputError(f"board: {width} x {height} px: the LCD has {columns} x {rows}")
    lcd = np.full((rows, columns), 255, np.uint8)
    top, left = (rows - height) // 2, (columns - width) // 2
    lcd[top : top + height, left : left + width] = picture
    return lcd


def write_png(path: Path, picture: Bytes, px_per_mm: float) -> None:
    """Write a picture that programs print at its true size (PNG with pHYs), in one move."""
    data = cv2.imencode(".png", picture)[1].tobytes()
    per_m = round(1000.0 * px_per_mm)
    body = b"pHYs" + struct.pack(">IIB", per_m, per_m, 1)
    chunk = struct.pack(">I", 9) + body + struct.pack(">I", zlib.crc32(body))
    header = 8 + 25  # signature, IHDR
    with atomic_write(path) as part:
        part.write_bytes(data[:header] + chunk + data[header:])


def px_per_mm(dpi: float) -> float:
    """Pixels per mm of a printer."""
    return dpi / _MM_PER_INCH


def _grey(image: Image) -> Bytes:
    """Eight bits that span what a picture holds."""
    if image.dtype == np.uint8:
        return np.ascontiguousarray(image)
    low, high = (float(level) for level in np.percentile(image, (0.1, 99.9)))
    scaled = (image.astype(np.float32) - low) * (255.0 / max(high - low, 1.0))
    return np.asarray(np.clip(np.rint(scaled), 0, 255), np.uint8)
