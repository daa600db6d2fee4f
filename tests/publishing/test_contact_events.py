from dataclasses import replace

import numpy as np
import pytest
from planted_contact import planted

from zeromethod.publishing import ContactEvent, ContactWatch

from .readings import dent

# Of the planted dents: 5 sigma is 0.5 um, so 1 um is the limit and 0.8 um ends a touch.
TOUCH_MM = 1e-3


def watched(depths_mm, watch: ContactWatch | None = None, **more) -> list[ContactEvent]:
    watch = watch or ContactWatch()
    events = (watch.update(*dent(depth, time_ns, **more)) for time_ns, depth in enumerate(depths_mm))
    return [event for event in events if event is not None]


def test_a_press_begins_with_the_first_of_three_frames_and_ends_likewise():
    began, ended = watched([0, 0, 0.01, 0.05, 0.1, 0.2, 0.1, 0, 0, 0, 0])
    assert (began.number, began.kind, began.time_ns) == (1, "began", 2)
    # The peak's fit is within 0.01 %, as in all tests here.
    assert began.depth_mm == pytest.approx(0.1, rel=1e-4)
    assert (began.x_mm, began.y_mm) == pytest.approx((9.75, 7.25), abs=1e-3)
    assert (ended.number, ended.kind, ended.time_ns) == (2, "ended", 7)
    assert ended.depth_mm == pytest.approx(0.2, rel=1e-4)


def test_two_frames_are_no_touch_and_two_without_do_not_end_one():
    assert not watched([0.1, 0.1, 0, 0.1, 0.1, 0])
    assert [event.kind for event in watched([0.1, 0.1, 0.1, 0, 0, 0.1, 0, 0])] == ["began"]


def test_between_the_two_limits_a_touch_neither_begins_nor_ends():
    between = 0.9 * TOUCH_MM
    assert not watched([between] * 10)
    assert [event.kind for event in watched([2 * TOUCH_MM] * 3 + [between] * 10)] == ["began"]


def test_a_noisy_reading_must_be_deeper():
    sigma_mm = 1e-3
    assert not watched([4.9 * sigma_mm] * 5, sigma_mm=sigma_mm)
    assert len(watched([5.1 * sigma_mm] * 5, sigma_mm=sigma_mm)) == 1


def test_noise_alone_is_no_touch_and_does_not_keep_one_up():
    generator = np.random.default_rng(3)
    noisy = {"sigma_mm": 2e-3, "generator": generator}
    assert not watched([0.0] * 300, **noisy)
    began, ended = watched([0.1] * 5 + [0.0] * 20, **noisy)
    assert (began.kind, ended.kind) == ("began", "ended")


def test_a_bulge_is_no_touch():
    assert not watched([-0.1] * 5)


def test_lost_light_is_a_touch_without_depth():
    watch = ContactWatch()
    assert not watched([0.0], watch)
    (began,) = watched([0.0] * 3, watch, dark=np.s_[10:13, 20:23])
    assert (began.x_mm, began.y_mm) == pytest.approx((10.5, 5.5))  # of node (21, 11), 0.5 mm apart
    assert np.isnan(began.depth_mm)
    assert watch.touching
    (ended,) = watched([0.0] * 3, watch)
    assert ended.kind == "ended"
    assert not watch.touching


def test_a_speck_is_no_touch():
    watch = ContactWatch()
    assert not watched([0.0], watch)
    assert not watched([0.0] * 5, watch, dark=np.s_[10:12, 20:24])


def test_what_is_in_contact_touches_from_when_it_was_first_seen_until_it_is_gone():
    watch, contact = ContactWatch(), replace(planted(lambda x, _: x), age_s=4e-9)
    assert not watched([0.0] * 5, watch)
    began = watch.update(*dent(0.0, 5), [contact])
    assert (began.kind, began.time_ns, began.x_mm) == ("began", 1, contact.x_mm)
    for time_ns in range(6, 20):
        assert watch.update(*dent(0.0, time_ns), [contact]) is None
        assert watch.touching
    (ended,) = watched([0.0] * 3, watch)
    assert ended.kind == "ended"


def test_what_was_dark_from_the_start_is_no_touch():
    assert not watched([0.0] * 10, dark=np.s_[2:10, 2:10])


def test_a_touch_found_by_light_alone_gets_its_depth_once_it_has_one():
    watch = ContactWatch()
    assert not watched([0.0], watch)
    dark = np.s_[4:8, 4:8]
    watched([0.0, 0.0, 0.0, 0.1, 0.0], watch, dark=dark)
    (ended,) = watched([0.0] * 3, watch)
    assert ended.depth_mm == pytest.approx(0.1, rel=1e-4)


def test_the_second_touch_does_not_remember_the_first():
    press, lift = [0.05] * 3, [0.0] * 3
    *_, ended = watched([0.2] * 3 + lift + press + lift)
    assert ended.number == 4
    assert ended.depth_mm == pytest.approx(0.05, rel=1e-4)


def test_a_reading_without_a_single_node_is_no_touch():
    everything = np.s_[:, :]
    assert not watched([0.1] * 5, dark=everything)
