"""ROS 2 message definitions (common_interfaces), as MCAP wants them: each with those that it is made of."""

from __future__ import annotations

_TIME = "int32 sec\nuint32 nanosec\n"
_HEADER = "builtin_interfaces/Time stamp\nstring frame_id\n"
_POINT = "float64 x\nfloat64 y\nfloat64 z\n"
_POINT_STAMPED = "std_msgs/Header header\ngeometry_msgs/Point point\n"
_STRING = "string data\n"
_IMAGE = """std_msgs/Header header
uint32 height
uint32 width
string encoding
uint8 is_bigendian
uint32 step
uint8[] data
"""
_POINT_FIELD = """uint8 INT8=1
uint8 UINT8=2
uint8 INT16=3
uint8 UINT16=4
uint8 INT32=5
uint8 UINT32=6
uint8 FLOAT32=7
uint8 FLOAT64=8
string name
uint32 offset
uint8 datatype
uint32 count
"""
_POINT_CLOUD = """std_msgs/Header header
uint32 height
uint32 width
sensor_msgs/PointField[] fields
bool is_bigendian
uint32 point_step
uint32 row_step
uint8[] data
bool is_dense
"""

_STAMP = {"std_msgs/Header": _HEADER, "builtin_interfaces/Time": _TIME}


def _with(definition: str, parts: dict[str, str]) -> str:
    """A definition followed by those of its parts, rule by rule as MCAP's registry has it."""
    rule = "=" * 80
    return definition + "".join(f"{rule}\nMSG: {name}\n{part}" for name, part in parts.items())


DEFINITIONS = {
    "std_msgs/msg/String": _STRING,
    "sensor_msgs/msg/Image": _with(_IMAGE, _STAMP),
    "sensor_msgs/msg/PointCloud2": _with(_POINT_CLOUD, {**_STAMP, "sensor_msgs/PointField": _POINT_FIELD}),
    "geometry_msgs/msg/PointStamped": _with(_POINT_STAMPED, {**_STAMP, "geometry_msgs/Point": _POINT}),
}
"""By message type."""
