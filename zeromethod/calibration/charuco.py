"""ChArUco boards by OpenCV: drawn for paper or an LCD, and found in pictures.

A chessboard whose white squares hold ArUco markers, so that each corner is known by its number and a part of
the board is enough (S. Garrido-Jurado et al., Pattern Recognition 47 (2014) 2280,
doi:10.1016/j.patcog.2014.01.005).
"""

from __future__ import annotations

import enum
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.distance import pdist

from zeromethod.arrays import Bytes, Float, Image
from zeromethod.errors import InputError

DICTIONARIES = tuple(f"{bits}X{bits}_{count}" for bits in (4, 5, 6, 7) for count in (50, 100, 250, 1000))
DEFAULT_DICTIONARY = "5X5_250"
MARKER_SHARE = 0.75
"""Default side of a marker over that of its square."""

LEAST_SQUARES, MOST_SQUARES = 3, 100
LEAST_CORNERS = 8
"""Corners that a picture must show to count."""

LEAST_MARKERS = 6
"""Markers in a picture that must have corners between them, if they are the board's."""

_LEAST_SQUARE_PX = 16
_NEIGHBOURS = 1.5
"""Squares between corners that are neighbours, diagonally at most."""

_WINDOW_SHARE, _LEAST_WINDOW_PX, _MOST_WINDOW_PX = 0.7, 2, 12
"""Half a window to refine a corner in: of the distance from corner to marker, and its bounds."""

_CRITERIA = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 50, 1e-4)
_MOST_STRANGE = 0.2
"""Share of the markers whose numbers the board does not have, from which they are another board's."""


class NoView(enum.StrEnum):
    """Reasons why a picture gives no view of a board, as a person reads them."""

    NO_MARKERS = "no markers of the board's dictionary"
    OTHER_BOARD = "markers of another board"
    FEW_CORNERS = f"fewer than {LEAST_CORNERS} of the board's corners"
    ONE_LINE = "all corners lie on one line"


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
        size, have = f"{self.columns}x{self.rows} squares", int(self.dictionary.split("_")[1])
        if not all(LEAST_SQUARES <= count <= MOST_SQUARES for count in (self.columns, self.rows)):
            raise InputError(f"board: {size}: {LEAST_SQUARES} to {MOST_SQUARES} each way")
        if not 0.0 < self.marker_mm < self.square_mm < np.inf:
            raise InputError(
                f"board: square {self.square_mm:g} mm, marker {self.marker_mm:g} mm: above 0, the marker less"
            )
        if self.markers > have:
            raise InputError(f"board: {size} need {self.markers} markers: {self.dictionary} has {have}")

    @property
    def markers(self) -> int:
        """How many white squares there are."""
        return self.columns * self.rows // 2

    def __str__(self) -> str:
        return f"{self.columns}x{self.rows} squares of {self.square_mm:g} mm, {self.dictionary}"

    def picture(self, square_px: int) -> Bytes:
        """Picture with a white margin of half a square, which markers at the border need.

        Raises InputError for squares below 16 px.
        """
        if square_px < _LEAST_SQUARE_PX:
            raise InputError(
                f"board: squares of {square_px} px: at least {_LEAST_SQUARE_PX}, for their markers"
            )
        size = self.columns * square_px, self.rows * square_px
        drawn = np.asarray(self.cv.generateImage(size, marginSize=0), np.uint8)
        return np.pad(drawn, square_px // 2, constant_values=255)

    def on_lcd(self, square_px: int, columns: int, rows: int) -> Bytes:
        """The picture in the middle of a white LCD (rows, columns); InputError where it does not fit."""
        picture = self.picture(square_px)
        height, width = picture.shape
        if height > rows or width > columns:
            raise InputError(f"board: {width} x {height} px: the LCD has {columns} x {rows}")
        lcd = np.full((rows, columns), 255, np.uint8)
        top, left = (rows - height) // 2, (columns - width) // 2
        lcd[top : top + height, left : left + width] = picture
        return lcd

    def find(self, name: str, image: Image) -> View | NoView:
        """Corners in a picture (rows, cols) of any integer type, or why there are too few."""
        grey = _grey(image)
        corners, ids, _, markers = self._detector.detectBoard(grey)
        if markers is None or len(markers) == 0:
            return NoView.NO_MARKERS
        count = 0 if ids is None else len(ids)
        strange = np.count_nonzero(markers >= self.markers) > _MOST_STRANGE * len(markers)
        if strange or (count == 0 and len(markers) >= LEAST_MARKERS):
            return NoView.OTHER_BOARD
        if count < LEAST_CORNERS:
            return NoView.FEW_CORNERS
        if self.cv.checkCharucoCornersCollinear(ids):
            return NoView.ONE_LINE
        found, pixel = np.ravel(ids).astype(int), np.asarray(corners, np.float64).reshape(-1, 2)
        return View(name, found, self._refined(grey, found, pixel))

    def _refined(self, grey: Bytes, ids: NDArray[np.int_], pixel: Float) -> Float:
        """Corners found again in windows that end before the markers, which shift OpenCV's by some 0.2 px."""
        apart, seen = pdist(self.cv.getChessboardCorners()[ids][:, :2]) / self.square_mm, pdist(pixel)
        near = apart < _NEIGHBOURS
        square_px = float((seen[near] / apart[near]).min(initial=np.inf))
        free_px = 0.5 * (1.0 - self.marker_mm / self.square_mm) * square_px
        half = int(np.clip(_WINDOW_SHARE * free_px, _LEAST_WINDOW_PX, _MOST_WINDOW_PX))
        start = pixel.astype(np.float32).reshape(-1, 1, 2)
        refined = cv2.cornerSubPix(grey, start, (half, half), (-1, -1), _CRITERIA)
        return np.asarray(refined, np.float64).reshape(-1, 2)

    @cached_property
    def cv(self) -> Any:
        """The same board as OpenCV's `CharucoBoard`."""
        dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, f"DICT_{self.dictionary}"))
        return cv2.aruco.CharucoBoard((self.columns, self.rows), self.square_mm, self.marker_mm, dictionary)

    @cached_property
    def _detector(self) -> Any:
        parameters = cv2.aruco.DetectorParameters()
        parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
        return cv2.aruco.CharucoDetector(self.cv, cv2.aruco.CharucoParameters(), parameters)


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


def _grey(image: Image) -> Bytes:
    """Eight bits that span what a picture holds."""
    if image.dtype == np.uint8:
        return np.ascontiguousarray(image)
    low, high = (float(level) for level in np.percentile(image, (0.1, 99.9)))
    scaled = (image.astype(np.float32) - low) * (255.0 / max(high - low, 1.0))
    return np.asarray(np.clip(np.rint(scaled), 0, 255), np.uint8)
