"""One picture of a moment: camera, residual and depth side by side, on the scales of the whole video."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import cv2
import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import Colormap, LogNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.image import AxesImage

from zeromethod.arrays import Bytes, Float, Image
from zeromethod.export.lattice import MapLattice, Resampler
from zeromethod.sensing.residual import Residual
from zeromethod.surface import Surface
from zeromethod.warp.grid import NodeGrid

WIDTH_PX = 1920
_DPI = 100
_ROWS = 0
"""Axis of a lattice along y, which a picture has upwards."""
_LEFT_PX, _RIGHT_PX, _ABOVE_PX, _BELOW_PX = 62, 96, 62, 46
_TALLEST_PX = 900
_UNKNOWN = 191
"""Grey level of what was not measured."""


@dataclass(frozen=True, slots=True)
class Scales:
    """Ends of the three colour scales: grey levels, residual in camera px (from, to), depth in mm (+-)."""

    grey: float
    residual_px: tuple[float, float]
    depth_mm: float

    @classmethod
    def of(cls, images: Iterable[Image], rms_px: Float, peaks_mm: Float) -> Scales:
        """Scales for some frames, the residuals of all steps, and all peaks."""
        grey = max(float(np.percentile(image, 99.9)) for image in images)
        rms = rms_px[np.isfinite(rms_px) & (rms_px > 0.0)]
        quiet, loud = (float(np.percentile(rms, 5)), float(rms.max())) if rms.size else (0.01, 1.0)
        low = 10.0 ** math.floor(math.log10(quiet))
        high = max(10.0 ** math.ceil(math.log10(loud)), 10.0 * low)
        peaks = np.abs(peaks_mm[np.isfinite(peaks_mm)])
        return cls(max(grey, 1.0), (low, high), max(float(peaks.max(initial=0.0)), 1e-6))


@dataclass(frozen=True, slots=True)
class _Look:
    """How a map is shown: title, unit of its values and of its axes, borders, colours."""

    title: str
    unit: str
    axes_unit: str
    extent: tuple[float, float, float, float]
    norm: Normalize
    colours: str

    def put(self, axis: Axes) -> AxesImage:
        """An empty map with its axes and colour bar."""
        colours = mpl.colormaps[self.colours].with_extremes(bad=str(_UNKNOWN / 255))
        image = axis.imshow(np.full((2, 2), np.nan), cmap=colours, norm=self.norm, extent=self.extent)
        axis.set_aspect("auto")
        axis.set_title(self.title)
        across, down = ("x", "y") if self.axes_unit == "mm" else ("u", "v")
        axis.set_xlabel(f"{across}, {self.axes_unit}", labelpad=2)
        axis.set_ylabel(f"{down}, {self.axes_unit}", labelpad=2)
        width_px = axis.get_window_extent().width
        bar = axis.inset_axes((1.0 + 10 / width_px, 0.0, 16 / width_px, 1.0))
        assert axis.figure is not None
        axis.figure.colorbar(image, cax=bar, label=self.unit)
        return image


@dataclass(frozen=True, slots=True)
class _Panel:
    """Where a map goes: rows and columns of the picture, colours, and whether its first row is at the top."""

    rows: slice
    cols: slice
    norm: Normalize
    colours: Colormap
    flips: tuple[int, ...]

    @classmethod
    def over(cls, image: AxesImage, norm: Normalize, height_px: int, flips: tuple[int, ...]) -> _Panel:
        """The inside of the axes that an image fills, in a drawn picture of this height."""
        box = image.axes.get_window_extent()
        rows = slice(round(height_px - box.y1) + 1, round(height_px - box.y0))
        return cls(rows, slice(round(box.x0) + 1, round(box.x1)), norm, image.cmap, flips)

    @property
    def shape(self) -> tuple[int, int]:
        """(rows, cols) of the place."""
        return self.rows.stop - self.rows.start, self.cols.stop - self.cols.start

    def paint(self, picture: Bytes, values: Image, *, smooth: bool) -> None:
        """Colour a map into its place; grey where NaN."""
        size = self.shape[::-1]
        values = np.flip(values, self.flips)
        if smooth:
            values = cv2.resize(values, size, interpolation=cv2.INTER_AREA)
            colours = self.colours(self.norm(values), bytes=True)
        else:
            colours = self.colours(self.norm(np.ma.masked_invalid(values)), bytes=True)
            colours = cv2.resize(colours, size, interpolation=cv2.INTER_NEAREST)
        picture[self.rows, self.cols] = colours[..., :3]


class Picture:
    """Draws the steps of one recording; axes, colour bars and titles are drawn once."""

    def __init__(self, grid: NodeGrid, lattice: MapLattice, scales: Scales) -> None:
        """Lay the picture out: camera pixels with v downwards, mm with y upwards as in all pictures."""
        self._grid = grid
        self._resampled = Resampler(lattice)
        unit, self._per_mm = ("µm", 1e3) if scales.depth_mm < 0.1 else ("mm", 1.0)
        limit = self._per_mm * scales.depth_mm
        rows, cols = grid.image_shape
        camera = (-0.5, cols - 0.5, rows - 0.5, -0.5)
        looks = [
            _Look("camera", "grey levels", "px", camera, Normalize(0.0, scales.grey), "gray"),
            _Look("residual", "camera px", "px", camera, LogNorm(*scales.residual_px), "viridis"),
            _Look("depth", unit, "mm", _extent(lattice), Normalize(-limit, limit), "RdBu_r"),
        ]
        shares = [cols / rows, cols / rows, lattice.shape[1] / lattice.shape[0]]
        # All three equally high; even sides, as video wants them.
        tall = min((WIDTH_PX - len(shares) * (_LEFT_PX + _RIGHT_PX)) / sum(shares), _TALLEST_PX)
        self.shape = (2 * round(0.5 * (tall + _ABOVE_PX + _BELOW_PX)), WIDTH_PX)
        with mpl.rc_context({"font.size": 10, "axes.titlesize": 11}):
            self._figure = Figure(figsize=(WIDTH_PX / _DPI, self.shape[0] / _DPI), dpi=_DPI)
            canvas: Any = FigureCanvasAgg(self._figure)
            left, images = 0.0, []
            for look, share in zip(looks, shares, strict=True):
                x, width = (left + _LEFT_PX) / WIDTH_PX, tall * share / WIDTH_PX
                axis = self._figure.add_axes((x, _BELOW_PX / self.shape[0], width, tall / self.shape[0]))
                images.append(look.put(axis))
                left += _LEFT_PX + tall * share + _RIGHT_PX
            self._words = self._figure.text(
                _LEFT_PX / WIDTH_PX, 0.98, "", va="top", family="monospace", fontsize=13, animated=True
            )
            canvas.draw()
        self._canvas, self._empty = canvas, canvas.copy_from_bbox(self._figure.bbox)
        self._panels = [
            _Panel.over(image, look.norm, self.shape[0], turned)
            for image, look, turned in zip(images, looks, ((), (), (_ROWS,)), strict=True)
        ]

    @property
    def places(self) -> list[tuple[slice, slice]]:
        """Rows and columns of the picture that camera, residual and depth fill."""
        return [(panel.rows, panel.cols) for panel in self._panels]

    def draw(self, image: Image, residual: Residual | None, surface: Surface | None, words: str) -> Bytes:
        """Picture (rows, cols, 3) of a moment; what there is none of stays grey."""
        self._canvas.restore_region(self._empty)
        self._words.set_text(words)
        self._figure.draw_artist(self._words)
        picture = np.array(self._canvas.buffer_rgba())[..., :3]
        self._panels[0].paint(picture, image.astype(np.float32), smooth=True)
        for panel in self._panels[1:]:
            picture[panel.rows, panel.cols] = _UNKNOWN
        if residual is not None:
            self._panels[1].paint(picture, self._on_camera(residual), smooth=False)
        if surface is not None:
            self._panels[2].paint(picture, self._on_lattice(surface), smooth=False)
        return np.ascontiguousarray(picture)

    def _on_camera(self, residual: Residual) -> Float:
        """Length of the residual for every pixel of its panel, by the nearest node; NaN where not valid."""
        grid = self._grid
        length = np.where(residual.valid, np.linalg.norm(residual.d, axis=-1), np.nan)
        nodes = []
        for first_px, pixels, shown in zip(
            (grid.v_px[0], grid.u_px[0]), grid.image_shape, self._panels[1].shape, strict=True
        ):
            at_px = (np.arange(shown) + 0.5) * pixels / shown - 0.5
            nodes.append(np.rint((at_px - first_px) / grid.spacing_px).astype(int))
        # No logarithm of zero; beyond the measurable nodes lie those of the padding, which are not valid.
        return np.maximum(length, np.finfo(float).tiny)[np.ix_(*nodes)]

    def _on_lattice(self, surface: Surface) -> Float:
        inner = self._grid.inner
        depth = self._per_mm * surface.depth_mm[inner][..., None]
        return self._resampled(surface.x_mm[inner], surface.y_mm[inner], surface.valid[inner], depth)[..., 0]


def _extent(lattice: MapLattice) -> tuple[float, float, float, float]:
    """Borders (left, right, bottom, top) in mm of the lattice's pixels: x to the right, y upwards."""
    rows, cols = lattice.shape
    half = 0.5 * lattice.pitch_mm
    right, top = (
        start + (count - 0.5) * lattice.pitch_mm
        for start, count in ((lattice.x0_mm, cols), (lattice.y0_mm, rows))
    )
    return lattice.x0_mm - half, right, lattice.y0_mm - half, top
