"""The contact status of made-up textures whose spots, ridges and motion are known."""

from dataclasses import replace

import numpy as np
import pytest
from planted_rubbing import BLUR_PX, planted, random_places, square_places

from zeromethod.rubbing import Motion, RubbingReader
from zeromethod.rubbing.motion import moved
from zeromethod.rubbing.spots import spots_of

FRAME_S = 1 / 60
FRAME_NS = round(1e9 * FRAME_S)
EXPOSURE_NS = 1_000_000


def followed(places_mm, radius_mm, ways_mm, exposure_ns=EXPOSURE_NS):
    """Status at each frame of a texture that is at (40, 0) + each of `ways_mm`."""
    reader = RubbingReader(BLUR_PX)
    return [
        reader.follow(
            [planted(places_mm, radius_mm, np.array([40.0, 0.0]) + way, seed=k)], k * FRAME_NS, exposure_ns
        )
        for k, way in enumerate(ways_mm)
    ]


def straight(speed_mm_s, frames, direction_deg=0.0):
    """(frames, 2) ways at a speed."""
    turn = np.radians(direction_deg)
    return speed_mm_s * FRAME_S * np.arange(frames)[:, None] * np.array([np.cos(turn), np.sin(turn)])


def test_share_number_and_size_of_spots_are_the_planted_ones():
    places = random_places(90, seed=3)
    apart = np.hypot(*(places[:, None] - places[None]).transpose(2, 0, 1)) + 9 * np.eye(len(places))
    places = places[apart.min(axis=1) > 0.3]  # spots that touch each other are one
    (status,) = followed(places, 0.1, straight(0, 1))
    reader = RubbingReader(BLUR_PX)
    reader.follow([planted(places, 0.1, np.zeros(2))], 0)
    spots = reader.spots
    rows, cols = np.nonzero(spots.looked)
    at = np.array([spots.x_mm, spots.y_mm]) + spots.pitch_mm * np.stack((cols, rows), axis=-1)
    near = np.hypot(*(at[:, None] - places[None]).transpose(2, 0, 1)).min(axis=1)
    assert abs(status.share - np.mean(near < 0.1)) < 3 * status.sigma_share
    assert status.share == pytest.approx(np.mean(near < 0.1), abs=0.02)
    # a spot's radius is 3 px: a tenth of a pixel of border is 7 % of it
    assert status.spot_mm2 == pytest.approx(np.pi * 0.1**2, rel=0.07)
    assert status.spots_per_cm2 == pytest.approx(100 * len(places) / (np.pi * 9), rel=0.25)


@pytest.mark.parametrize(("pitch_mm", "turn_deg"), [(0.4, 0.0), (0.7, 25.0), (1.2, 70.0)])
def test_pitch_and_direction_of_rows_are_the_planted_ones(pitch_mm, turn_deg):
    places = square_places(pitch_mm, 0.02 * pitch_mm, 5, turn_deg)
    (status,) = followed(places, 0.25 * pitch_mm, straight(0, 1))
    assert status.pitch_mm == pytest.approx(pitch_mm, rel=0.02)  # what is asked
    assert abs(status.pitch_mm - pitch_mm) < 3 * status.sigma_pitch_mm
    off = (status.ridge_deg - turn_deg + 45) % 90 - 45  # rows of a square array lie both ways
    assert abs(off) < 3 * status.sigma_ridge_deg


def test_random_places_have_no_pitch_and_the_reason_is_given():
    for seed in range(5):
        (status,) = followed(random_places(100, seed), 0.1, straight(0, 1))
        assert np.isnan(status.pitch_mm)
        assert "nothing regular" in status.reason


@pytest.mark.parametrize(("speed_mm_s", "direction_deg"), [(5.0, 0.0), (20.0, 130.0), (50.0, -60.0)])
def test_speed_and_direction_of_pile_are_the_planted_ones(speed_mm_s, direction_deg):
    statuses = followed(random_places(120, 7), 0.1, straight(speed_mm_s, 8, direction_deg))
    last = statuses[-1]
    assert last.motion is Motion.SLIP
    assert last.speed_mm_s == pytest.approx(speed_mm_s, rel=0.02)  # what is asked
    assert abs(last.speed_mm_s - speed_mm_s) < 3 * last.sigma_speed_mm_s
    assert abs((last.direction_deg - direction_deg + 180) % 360 - 180) < 3 * last.sigma_direction_deg
    assert not last.aliased  # random places look like themselves nowhere else


def test_a_regular_texture_is_aliased_from_half_a_pitch_per_frame_on():
    places = square_places(0.6, 0.02, 2)
    slow, fast = (followed(places, 0.15, straight(speed, 6))[-1] for speed in (15.0, 21.0))
    assert not slow.aliased  # 0.25 mm per frame
    assert fast.aliased  # 0.35 mm


def test_a_texture_that_looks_the_same_a_row_further_on_is_never_called_slow():
    """Exact arrays that jump by just less than a row look as if they went back a little."""
    places = square_places(0.5, 0.0, 2)
    statuses = followed(places, 0.12, straight(0.45 / FRAME_S, 6))
    assert all(one.aliased for one in statuses[1:])


def test_a_long_exposure_in_which_it_moves_over_half_a_pitch_is_aliased():
    places = square_places(0.6, 0.02, 2)
    status = followed(places, 0.15, straight(10.0, 3), exposure_ns=40_000_000)[-1]
    assert status.aliased


def test_stick_and_slip_are_named_within_three_frames_and_once_each():
    steps = np.concatenate([np.zeros(6), np.full(7, 0.2), np.zeros(7), np.full(6, 0.3)])
    ways = np.stack((np.cumsum(steps), np.zeros(steps.size)), axis=-1)
    statuses = followed(random_places(120, 4), 0.1, ways)
    named = [(k, one.event) for k, one in enumerate(statuses) if one.event]
    assert [event for _, event in named] == ["slip", "stick", "slip"]
    for (frame, _), began in zip(named, (6, 13, 20), strict=True):
        assert 0 <= frame - began < 3
    speeds = [one.speed_mm_s for one in statuses[8:13]]
    np.testing.assert_allclose(speeds, 12.0, rtol=0.02)


def test_a_depth_that_is_off_in_a_frame_moves_nothing():
    """Depth inside a contact is carried in; off by 14 um it placed an image 24 um further on."""
    places, reader = random_places(120, 4), RubbingReader(BLUR_PX)
    for k in range(8):
        contact = planted(places, 0.1, np.array([40.0, 0.0]), seed=k)
        off = 0.024 if k in (1, 5) else 0.0
        image = replace(contact.image, x_mm=contact.image.x_mm + off, sunk_x_mm=0.2 + off)
        status = reader.follow([replace(contact, x_mm=contact.x_mm + off, image=image)], k * FRAME_NS)
        assert status.motion is (Motion.STICK if k >= 2 else Motion.UNKNOWN)
        assert not status.event


def test_a_texture_that_is_not_lit_in_a_frame_is_known_again():
    places, reader = random_places(120, 4), RubbingReader(BLUR_PX)
    ways = 0.2 * np.minimum(np.arange(10), 6)
    seen = []
    for k, way in enumerate(ways):
        contact = planted(places, 0.1, np.array([40.0 + way, 0.0]), seed=k)
        if k == 5:
            contact = replace(contact, image=replace(contact.image, light=0.5 * contact.image.light))
        seen.append(reader.follow([contact], k * FRAME_NS))
    assert seen[5].reason == "the LCD does not light it yet"
    assert seen[6].motion is Motion.SLIP
    assert seen[6].speed_mm_s == pytest.approx(12.0, rel=0.02)
    assert [one.event for one in seen[7:9]].count("stick") == 1


def test_the_life_of_spots_that_let_go_at_random_is_the_planted_one():
    draw = np.random.default_rng(0)
    life_s, frames = 0.2, 40
    places = square_places(0.6, 0.05, 6)  # where one lets go, no other is near
    ends = draw.exponential(life_s, len(places))
    reader = RubbingReader(BLUR_PX)
    for k in range(frames):
        there = places[ends > k * FRAME_S]
        if len(there) < 10:
            break
        status = reader.follow([planted(there, 0.12, np.array([40.0, 0.0]), seed=k)], k * FRAME_NS)
    assert abs(status.spot_life_s - life_s) < 3 * status.sigma_spot_life_s
    assert status.sigma_spot_life_s < 0.4 * life_s


def test_spots_that_stay_have_no_life_and_the_reason_is_given():
    statuses = followed(random_places(120, 4), 0.1, straight(10.0, 12))
    assert np.isnan(statuses[-1].spot_life_s)
    assert "life: fewer than 3 spots ended in view" in statuses[-1].reason


def test_a_patch_in_which_nothing_is_in_contact_any_more_is_not_counted_and_says_why():
    reader = RubbingReader(BLUR_PX)
    reader.follow([planted(square_places(0.7, 0.01, 1), 0.2, np.zeros(2))], 0)
    contact = planted(square_places(0.7, 0.01, 1), 0.2, np.zeros(2))
    white = replace(contact.image, light=np.full_like(contact.image.light, 1.9))
    lifted = reader.follow([replace(contact, image=white)], FRAME_NS)
    assert np.isnan(lifted.share)
    assert lifted.reason


def test_another_contact_begins_anew_and_none_has_no_status():
    reader = RubbingReader(BLUR_PX)
    places = random_places(100, 1)
    for k in range(4):
        reader.follow([planted(places, 0.1, np.array([40 + 0.2 * k, 0.0]))], k * FRAME_NS)
    assert reader.follow([], 4 * FRAME_NS) is None
    status = reader.follow([planted(places, 0.1, np.array([30.0, 0.0]), number=2)], 5 * FRAME_NS)
    assert status.motion is Motion.UNKNOWN
    assert "speed: first frame" in status.reason


def test_a_movement_that_was_not_found_in_the_steps_allowed_is_none():
    """Begun 0.2 mm off, four steps of a pixel end 0.07 mm off, which was called 0.006 mm sure."""
    places, way = random_places(120, seed=3), np.array([0.25, 0.0])
    first, second = (
        spots_of(planted(places, 0.12, at, seed=k), BLUR_PX) for k, at in enumerate((0 * way, way))
    )
    assert moved(first, second, np.array([0.45, 0.0])) is None
    found = moved(first, second, np.array([0.3, 0.0]))
    assert abs(found.dx_mm - way[0]) < 3 * found.sigma_mm
