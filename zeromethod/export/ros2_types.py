"""ROS 2 message definitions (common_interfaces), as MCAP wants them: each with those that it is made of."""

from __future__ import annotations


def _message(*fields: str) -> str:
    """Definition of a message by its fields and constants."""
    return "".join(f"{field}\n" for field in fields)


_NUMBERS = ("INT8", "UINT8", "INT16", "UINT16", "INT32", "UINT32", "FLOAT32", "FLOAT64")
_TIME = _message("int32 sec", "uint32 nanosec")
_HEADER = _message("builtin_interfaces/Time stamp", "string frame_id")
_POINT = _message("float64 x", "float64 y", "float64 z")
_POINT_STAMPED = _message("std_msgs/Header header", "geometry_msgs/Point point")
_SIZE = ("std_msgs/Header header", "uint32 height", "uint32 width")
_IMAGE = _message(*_SIZE, "string encoding", "uint8 is_bigendian", "uint32 step", "uint8[] data")
_POINT_FIELD = _message(
    *(f"uint8 {name}={number}" for number, name in enumerate(_NUMBERS, start=1)),
    *("string name", "uint32 offset", "uint8 datatype", "uint32 count"),
)
_POINT_CLOUD = _message(
    *(*_SIZE, "sensor_msgs/PointField[] fields", "bool is_bigendian", "uint32 point_step"),
    *("uint32 row_step", "uint8[] data", "bool is_dense"),
)

_STAMP = {"std_msgs/Header": _HEADER, "builtin_interfaces/Time": _TIME}


def _with(definition: str, parts: dict[str, str]) -> str:
    """A definition followed by those of its parts, rule by rule as MCAP's registry has it."""
    rule = "=" * 80
    return definition + "".join(f"{rule}\nMSG: {name}\n{part}" for name, part in parts.items())


DEFINITIONS = {
    "std_msgs/msg/String": _message("string data"),
    "sensor_msgs/msg/Image": _with(_IMAGE, _STAMP),
    "sensor_msgs/msg/PointCloud2": _with(_POINT_CLOUD, {**_STAMP, "sensor_msgs/PointField": _POINT_FIELD}),
    "geometry_msgs/msg/PointStamped": _with(_POINT_STAMPED, {**_STAMP, "geometry_msgs/Point": _POINT}),
}
"""By message type."""
