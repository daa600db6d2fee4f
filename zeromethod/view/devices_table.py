"""Monitors and cameras as tables of plain words."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from rich.table import Table

if TYPE_CHECKING:
    from zeromethod.drivers.listing import Listing
    from zeromethod.drivers.monitors import Monitor


def monitors_table(monitors: Sequence[Monitor]) -> Table:
    """Monitors by the index that `--display` takes."""
    table = Table("--display", "monitor", "size", "refresh", "at", "", box=None, pad_edge=False)
    for monitor in monitors:
        rate = f"{monitor.refresh_hz:.2f} Hz" if monitor.refresh_hz else "not known"
        size, place = f"{monitor.columns} x {monitor.rows}", f"{monitor.x}, {monitor.y}"
        primary = "primary" if monitor.primary else ""
        table.add_row(str(monitor.index), monitor.name, size, rate, place, primary)
    return table


def cameras_table(listing: Listing) -> Table:
    """Cameras by the address that `--camera` takes."""
    table = Table("--camera", "name", box=None, pad_edge=False)
    for camera in listing.cameras:
        table.add_row(camera.address, camera.name)
    return table
