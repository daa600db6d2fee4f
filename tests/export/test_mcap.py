"""The MCAP file as the reference reader decodes it: ROS 2 types, metres, Unix time."""

from datetime import datetime
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

from zeromethod.export import prepare
from zeromethod.recording.recording import Recording


def decoded(path: Path) -> dict[str, list]:
    """(schema, message, log time) of every message by topic."""
    found: dict[str, list] = {}
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
        assert reader.get_header().profile == "ros2"
        for schema, channel, message, said in reader.iter_decoded_messages():
            found.setdefault(channel.topic, []).append((schema.name, said, message.log_time))
    return found


def test_messages_are_standard_types_in_metres(planted, recording, tmp_path):
    prepare(recording, tmp_path / "a.mcap").write()
    topics = decoded(tmp_path / "a.mcap")
    assert {topic: (messages[0][0], len(messages)) for topic, messages in topics.items()} == {
        "/zeromethod/state": ("std_msgs/msg/String", 8),
        "/zeromethod/camera/image": ("sensor_msgs/msg/Image", 8),
        "/zeromethod/depth/image": ("sensor_msgs/msg/Image", 8),
        "/zeromethod/points": ("sensor_msgs/msg/PointCloud2", 8),
        "/zeromethod/peak": ("geometry_msgs/msg/PointStamped", 8),
    }
    point = topics["/zeromethod/peak"][-1][1].point
    assert (point.x, point.y, point.z) == pytest.approx((0.042, 0.003, -0.0002))
    surface, inner = recording.surface(9), recording.grid.inner

    image = topics["/zeromethod/depth/image"][-1][1]
    depth_m = np.frombuffer(image.data, "<f4").reshape(image.height, image.step // 4)
    assert image.encoding == "32FC1"
    assert depth_m == pytest.approx(1e-3 * surface.depth_mm[inner].astype(np.float32), rel=1e-6, nan_ok=True)

    cloud = topics["/zeromethod/points"][-1][1]
    names = [field.name for field in cloud.fields]
    assert names == ["x", "y", "z", "depth", "sigma"]
    assert [(field.offset, field.datatype) for field in cloud.fields] == [(4 * k, 7) for k in range(5)]
    points = np.frombuffer(cloud.data, "<f4").reshape(cloud.width, cloud.point_step // 4)
    assert len(points) == surface.valid.sum()
    assert points[:, 0] == pytest.approx(1e-3 * surface.x_mm[surface.valid], rel=1e-6)
    assert points[:, 2] == pytest.approx(-points[:, 3])
    assert points[:, 4] == pytest.approx(1e-7, rel=1e-6)


def test_frames_come_as_they_were_at_their_unix_time(planted, recording, tmp_path):
    prepare(recording, tmp_path / "a.mcap").write()
    messages = decoded(tmp_path / "a.mcap")["/zeromethod/camera/image"]
    started = datetime.fromisoformat(recording.started_utc).timestamp()
    for (_, image, log_ns), time_s in zip(messages, planted.time_s[1:], strict=True):
        assert image.encoding == "mono8"
        assert np.array_equal(np.frombuffer(image.data, np.uint8).reshape(256, 320), planted.image)
        # A double holds today's Unix time to 0.2 us.
        assert 1e-9 * log_ns - started == pytest.approx(time_s, abs=1e-6)
        assert image.header.stamp.sec * 10**9 + image.header.stamp.nanosec == log_ns


def test_what_was_not_kept_is_left_out(with_only, tmp_path):
    with Recording(with_only("surface")) as recording:
        prepare(recording, tmp_path / "a.mcap").write()
    topics = decoded(tmp_path / "a.mcap")
    assert "/zeromethod/camera/image" not in topics
    assert len(topics["/zeromethod/points"]) == 8
