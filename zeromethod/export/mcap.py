"""Messages for robots: an MCAP file of standard ROS 2 types, in SI units."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from zeromethod.arrays import Image
from zeromethod.atomic_write import atomic_write
from zeromethod.export.mesh import surface_points
from zeromethod.export.ros2_types import DEFINITIONS
from zeromethod.export.selection import SelectedSteps, needed
from zeromethod.optics.mirror import HeightField, rest_surface
from zeromethod.recording.recording import Recording
from zeromethod.surface import Surface

FRAME = "zeromethod/P0"
CAMERA_FRAME = "zeromethod/camera"

_METRES = 1e-3
_FLOAT32 = 7
"""PointField.FLOAT32."""
_FIELDS = ("x", "y", "z", "depth", "sigma")


def export_mcap(
    recording: Recording, selected: SelectedSteps, path: Path, advance: Callable[[], None]
) -> dict[str, Any]:
    """Write what every moment has: camera image, depth image, point cloud, peak and state.

    Lengths are in metres, stamps in Unix time. Returns the number of messages by topic.
    """
    writer_of = needed("mcap_ros2.writer").Writer
    rest = rest_surface(recording.rig)
    inner = recording.grid.inner
    peaks = {int(row["step"]): row for row in recording.peaks}
    with atomic_write(path) as part, part.open("wb") as file, writer_of(file) as writer:
        topics = _Topics(writer)
        writer.add_metadata("zeromethod", {"started_utc": recording.started_utc, "rig": recording.rig_text})
        for step, unix_ns, state in zip(selected.steps, selected.unix_ns, selected.states, strict=True):
            topics.at(int(unix_ns), int(step))
            topics.write("/zeromethod/state", "std_msgs/msg/String", {"data": state})
            if (image := recording.image(step)) is not None:
                topics.write("/zeromethod/camera/image", *_image(topics.header(CAMERA_FRAME), image))
            if (surface := recording.surface(step)) is not None:
                depth_m = _METRES * np.where(surface.valid, surface.depth_mm, np.nan)[inner]
                topics.write(
                    "/zeromethod/depth/image", *_image(topics.header(CAMERA_FRAME), depth_m.astype("<f4"))
                )
                topics.write("/zeromethod/points", *_cloud(topics.header(FRAME), surface, rest))
            if (peak := peaks.get(int(step))) is not None and np.isfinite(peak["depth_mm"]):
                topics.write("/zeromethod/peak", *_peak(topics.header(FRAME), peak, rest))
            advance()
    return {"times": len(selected.steps), "messages": topics.counts}


class _Topics:
    """Topics that are there once something was written to them."""

    def __init__(self, writer: Any) -> None:
        self._writer = writer
        self._schemas: dict[str, Any] = {}
        self._unix_ns = 0
        self._step = 0
        self.counts: dict[str, int] = {}

    def at(self, unix_ns: int, step: int) -> None:
        """Stamp what follows."""
        self._unix_ns, self._step = unix_ns, step

    def header(self, frame_id: str) -> dict[str, Any]:
        """Header of a message of now."""
        seconds, nanoseconds = divmod(self._unix_ns, 1_000_000_000)
        return {"stamp": {"sec": seconds, "nanosec": nanoseconds}, "frame_id": frame_id}

    def write(self, topic: str, kind: str, message: dict[str, Any]) -> None:
        """Write a message of type `kind`."""
        if kind not in self._schemas:
            self._schemas[kind] = self._writer.register_msgdef(kind, DEFINITIONS[kind])
        self._writer.write_message(
            topic, self._schemas[kind], message, log_time=self._unix_ns, sequence=self._step
        )
        self.counts[topic] = self.counts.get(topic, 0) + 1


def _image(header: dict[str, Any], image: Image) -> tuple[str, dict[str, Any]]:
    """Grey of 8 or 16 bits, or 32-bit floats."""
    encoding = {1: "mono8", 2: "mono16", 4: "32FC1"}[image.dtype.itemsize]
    rows, cols = image.shape
    message = {
        "header": header,
        "height": rows,
        "width": cols,
        "encoding": encoding,
        "is_bigendian": 0,
        "step": cols * image.dtype.itemsize,
        "data": np.ascontiguousarray(image, image.dtype.newbyteorder("<")).tobytes(),
    }
    return "sensor_msgs/msg/Image", message


def _cloud(header: dict[str, Any], surface: Surface, rest: HeightField) -> tuple[str, dict[str, Any]]:
    """The valid nodes, with depth and its standard deviation as fields to colour by."""
    points = surface_points(surface, rest)
    known = np.isfinite(points).all(axis=-1)
    columns = (points[known], surface.depth_mm[known, None], surface.sigma_depth_mm[known, None])
    values = (_METRES * np.concatenate(columns, axis=-1)).astype("<f4")
    message = {
        "header": header,
        "height": 1,
        "width": len(values),
        "fields": [
            {"name": name, "offset": 4 * k, "datatype": _FLOAT32, "count": 1}
            for k, name in enumerate(_FIELDS)
        ],
        "is_bigendian": False,
        "point_step": 4 * len(_FIELDS),
        "row_step": 4 * len(_FIELDS) * len(values),
        "data": values.tobytes(),
        "is_dense": True,
    }
    return "sensor_msgs/msg/PointCloud2", message


def _peak(header: dict[str, Any], peak: Any, rest: HeightField) -> tuple[str, dict[str, Any]]:
    x_mm, y_mm, depth_mm = (float(peak[name]) for name in ("x_mm", "y_mm", "depth_mm"))
    z_mm = float(rest.height(np.array(x_mm), np.array(y_mm))) - depth_mm
    point = {"x": _METRES * x_mm, "y": _METRES * y_mm, "z": _METRES * z_mm}
    return "geometry_msgs/msg/PointStamped", {"header": header, "point": point}
