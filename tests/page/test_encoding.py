"""Maps and messages as viewers get them."""

import json
import struct

import cv2
import numpy as np
import pytest

from zeromethod.operating.rates import Rate
from zeromethod.page.access import Access, Right
from zeromethod.page.encoding import Encoded, jpeg, packed, run_lengths
from zeromethod.page.fine_maps import reduced
from zeromethod.page.message import Content, compact


def test_a_map_comes_back_within_half_a_step_and_keeps_what_is_not_known():
    values = np.linspace(-3.0, 250.0, 600, dtype=np.float32).reshape(20, 30)
    values[3, 4:9] = np.nan
    codes, offset, step = compact(values)
    back = np.where(codes == 65535, np.nan, offset + step * codes.astype(float))
    assert np.array_equal(np.isnan(back), np.isnan(values))
    assert np.nanmax(np.abs(back - values)) <= 0.51 * step
    # 253 um in 16 bits: 4 nm
    assert step == pytest.approx(253 / 65534, rel=1e-6)


@pytest.mark.parametrize("value", [0.0, -2.5, np.nan])
def test_a_map_of_one_value_comes_back(value):
    codes, offset, step = compact(np.full((3, 4), value))
    assert np.array_equal(codes == 65535, np.full((3, 4), np.isnan(value)))
    if not np.isnan(value):
        assert np.allclose(offset + step * codes, value)


def test_runs_of_kinds_come_back():
    kinds = np.array([[1, 1, 0], [0, 0, 3], [3, 3, 3]], np.uint8)
    runs = np.array(run_lengths(kinds)).reshape(-1, 2)
    assert np.array_equal(np.repeat(runs[:, 1], runs[:, 0]), kinds.ravel())


def test_parts_of_a_message_begin_at_multiples_of_eight():
    data = packed({"values": {"µ": 1}}, {"a": ({"x": 1}, b"12345"), "b": ({}, b"123456789")})
    (length,) = struct.unpack("<I", data[:4])
    header = json.loads(data[4 : 4 + length])
    begin = 4 + length
    assert begin % 8 == 0
    assert header["values"] == {"µ": 1}
    for name, wanted in (("a", b"12345"), ("b", b"123456789")):
        part = header["parts"][name]
        assert part["start"] % 8 == 0
        assert data[begin + part["start"] :][: part["length"]] == wanted


def test_a_picture_of_more_bits_is_shown_by_its_upper_ones_and_a_wide_one_smaller():
    image = np.tile(np.arange(1280, dtype=np.uint16) * 3, (1024, 1))
    shown = cv2.imdecode(np.frombuffer(jpeg(image, 12), np.uint8), cv2.IMREAD_GRAYSCALE)
    assert shown.shape == (512, 640)
    assert np.abs(shown[256].astype(int) - np.arange(640) * 6 // 16).max() <= 4


def test_a_map_with_more_pixels_than_a_screen_is_shown_by_the_means_of_whole_squares():
    values = np.arange(7 * 9, dtype=np.float32).reshape(7, 9)
    values[0, 0] = np.nan
    shown = reduced(values, 2)
    assert shown.shape == (3, 4)
    assert np.isnan(shown[0, 0])
    assert np.isnan(shown).sum() == 1
    assert shown[1, 2] == values[2:4, 4:6].mean()


def test_a_node_outside_has_no_figures():
    maps = {name: np.zeros((3, 4), np.float32) for name in ("depth", "sigma", "x", "y")}
    maps |= {"slope": np.zeros((3, 4, 2), np.float32), "kind": np.ones((3, 4), np.uint8)}
    content = Content({}, [], 0, {"surface": maps}, {"surface": {"time_s": 1.0}})
    encoded = Encoded(1, frozenset({"surface"}), content)
    assert encoded.probe(3, 2) is not None
    assert encoded.probe(4, 2) is None
    assert encoded.probe(-1, 0) is None


def test_a_server_of_the_whole_network_is_asked_by_address_or_its_own_name_only():
    access = Access("0.0.0.0", ("control", "view"))
    assert access.serves_host("192.168.1.7:8470")
    assert access.serves_host("[fe80::1]:8470")
    assert not access.serves_host("evil.example:8470")
    assert not Access("127.0.0.1", ("a", "b")).serves_host("192.168.1.7:8470")
    assert [access.right_of(token) for token in ("control", "view", "", "contro", "wörd")] == [
        Right.CONTROL, Right.VIEW, Right.NONE, Right.NONE, Right.NONE,
    ]  # fmt: skip


def test_a_rate_falls_when_nothing_comes_any_more():
    rate = Rate()
    assert rate.at(0.0) is None
    for number in range(120):
        rate.note(number / 60)
    assert rate.at(119 / 60) == pytest.approx(60)
    assert rate.at(119 / 60 + 1.0) < 45  # type: ignore[operator]
    assert rate.at(119 / 60 + 5.0) is None
