"""Contacts' images as pictures."""

from __future__ import annotations

from matplotlib.axes import Axes

from zeromethod.arrays import Float
from zeromethod.contact import ContactImage, closed
from zeromethod.view.axes import labelled

BRIGHTEST = 2.0
"""Light over the mean of the picture that is drawn white: about the lamp's."""


def draw_contact(axis: Axes, image: ContactImage, border_mm: Float | None, title: str) -> None:
    """Draw what touches over the mirror in mm, its border as a line."""
    rows, cols = image.light.shape
    half = image.mm_per_px / 2
    left, bottom = image.x_mm - half, image.y_mm - half
    extent = (left, left + cols * image.mm_per_px, bottom, bottom + rows * image.mm_per_px)
    axis.imshow(image.light, cmap="gray", vmin=0.0, vmax=BRIGHTEST, origin="lower", extent=extent)
    if border_mm is not None:
        axis.plot(*closed(border_mm).T, color="tab:red", linewidth=0.8)
    labelled(axis, title, "x, mm", "y, mm")
