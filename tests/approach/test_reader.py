from dataclasses import replace

import numpy as np
import pytest
from watched import APPEARS_S, RIG, coming, watched

from zeromethod.approach import Watching, WatchReader
from zeromethod.approach.body import Body
from zeromethod.approach.spot import Spot, spot_of
from zeromethod.approach.track import CUT_SHARE, UNEVEN, Track, _radius
from zeromethod.clock import SimulatedClock
from zeromethod.errors import InputError
from zeromethod.rig.load import load_rig
from zeromethod.simulation.contact.objects import Form
from zeromethod.simulation.watch_camera import SimulatedWatchCamera


def test_rays_are_those_that_the_simulated_camera_traces_by_itself():
    points, directions = SimulatedWatchCamera(RIG, SimulatedClock())._rest
    for view, exits in enumerate(WatchReader(RIG).exits):
        cols = slice(160 * view, 160 * (view + 1))
        valid = exits.valid
        np.testing.assert_array_equal(valid, np.isfinite(directions[:, cols, 0]))
        slopes = directions[:, cols, :2] / directions[:, cols, 2:]
        # two ways to write Snell's law, to rounding
        np.testing.assert_allclose(exits.foot[valid], points[:, cols][valid][:, :2], atol=1e-10)
        np.testing.assert_allclose(exits.tangent[valid], slopes[valid], atol=1e-12)


@pytest.mark.parametrize(
    ("form", "diameter_mm", "length_mm"),
    [(Form.BALL, 16.0, 0.0), (Form.PUNCH, 16.0, 0.0), (Form.BALL, 4.0, 0.0), (Form.EDGE, 12.0, 30.0)],
)
def test_time_place_and_size_of_a_touch_are_known_before_it(form, diameter_mm, length_mm):
    touch_s = APPEARS_S + 60.0 / 80.0
    thing = coming(form, diameter_mm, 80.0, 60.0, length_mm=length_mm)
    last = [one for _, one in watched(thing, seconds=touch_s - 0.1)][-1]
    left_s = touch_s - 1e-9 * last.time_ns
    assert last.armed
    # as benchmark contactless finds for 95 %; a ball taken for a plate would be off by its radius: 0.1 s
    assert last.contact_s == pytest.approx(left_s, rel=0.02)
    assert abs(last.contact_s - left_s) < 3 * last.sigma_contact_s
    assert np.hypot(last.x_mm - 70.0, last.y_mm - 3.0) < 0.5
    assert last.diameter_mm == pytest.approx(diameter_mm, abs=3 * last.sigma_diameter_mm)


def test_a_fast_one_arms_within_its_first_tenth_of_a_second():
    states = [(t, one.watching) for t, one in watched(coming(Form.BALL, 10.0, 300.0, 100.0), seconds=0.5)]
    # three frames are needed for a speed, and at 30 Hz they take 0.1 s
    assert min(t for t, state in states if state is Watching.COMING) < APPEARS_S + 0.13


def test_what_hangs_still_or_goes_away_arms_nothing():
    going = coming(Form.BALL, 10.0, 40.0, 40.0)
    back = type(going)(going.solid, (*going.points[:2], *reversed_path(going.points)))
    still = type(going)(going.solid, going.points[:3])
    for path in (back, still):
        states = {one.watching for _, one in watched(path, seconds=1.1)}
        assert Watching.SEEN in states
        assert Watching.COMING not in states


def reversed_path(points):
    (_, _, appears, touches) = points
    low = type(appears)(appears.time_ns, touches.x_mm, touches.y_mm, -5.0)
    return low, type(appears)(touches.time_ns, appears.x_mm, appears.y_mm, appears.depth_mm)


def test_shadows_and_light_arm_nothing():
    nuisances = {"simulation.nuisances.room_light": 0.2, "simulation.nuisances.room_shadows": 3}
    restless = [one for _, one in watched(seconds=6.0, rig=RIG.replace(nuisances))]
    assert not any(one.armed for one in restless)


def test_a_part_of_a_large_thing_still_arms():
    rod = coming(Form.EDGE, 18.0, 60.0, 50.0, length_mm=200.0, angle_deg=0.0)
    last = [one for _, one in watched(rod, seconds=0.9)][-1]
    assert last.armed
    # its sides are seen, its ends are not: how wide it is is known, its middle along y is not
    assert last.diameter_mm == pytest.approx(18.0, abs=3 * last.sigma_diameter_mm)
    assert last.sigma_y_mm > 0.2 * 18.0


def test_frames_that_say_nothing_are_named():
    camera, reader = SimulatedWatchCamera(RIG, SimulatedClock()), WatchReader(RIG)
    image = camera.image(0, 0)
    assert reader.take(image, 0).watching is Watching.CLEAR
    for one, words in (
        (image[:100], "rows"),
        (np.zeros_like(image), "dark"),
        (np.full_like(image, 255), "bright"),
    ):
        found = reader.take(one, 1)
        assert found.watching is Watching.BLIND
        assert words in found.reason
    repeated = [reader.take(image, n) for n in range(6)]
    assert "again and again" in repeated[-1].reason


def test_a_rig_without_a_watch_camera_or_with_a_blind_one_is_refused():
    with pytest.raises(InputError, match="watch: missing"):
        WatchReader(load_rig("simulated"))
    with pytest.raises(InputError, match=r"watch\.look_at_mm"):
        WatchReader(RIG.replace({"watch.look_at_mm": [75.0, 0.0, -500.0]}))
    with pytest.raises(InputError, match=r"watch\.baseline_mm"):
        WatchReader(RIG.replace({"watch.baseline_mm": 8000.0}))


def test_a_part_of_the_sensor_and_12_bits_are_read_as_the_whole_of_8_bits_is():
    part = {"watch.region_px": [8, 8, 320, 240], "watch.driver": "opencv", "camera.driver": "opencv"}
    reader, cut = WatchReader(RIG), WatchReader(RIG.replace(part))
    np.testing.assert_array_equal(cut.exits[1].foot, reader.exits[1].foot)
    deep = RIG.replace({"watch.bits": 12, "watch.noise.black_grey": 16 * RIG.watch.noise.black_grey})
    images = [SimulatedWatchCamera(rig, SimulatedClock()).image(0, 0) for rig in (RIG, deep)]
    # white is 0.8 of 255 and of 4095, and 8 bits round to one of some 130 levels
    assert np.median(images[1]) / np.median(images[0]) == pytest.approx(16.0, rel=0.01)
    assert WatchReader(deep).take(images[1], 0).watching is Watching.CLEAR


def test_a_thing_mostly_as_light_as_the_room_behind_it_is_followed_whole():
    white = coming(Form.PUNCH, 22.0, 60.0, 60.0)
    white = type(white)(replace(white.solid, albedo=0.88), white.points)
    last = [one for _, one in watched(white, seconds=APPEARS_S + 0.9)][-1]
    assert last.armed
    # its outline counts where it is seen: a part taken for all of it would be smaller by some mm
    assert last.diameter_mm == pytest.approx(22.0, rel=0.05)
    assert last.contact_s == pytest.approx(APPEARS_S + 1.0 - 1e-9 * last.time_ns, rel=0.1)


def test_what_comes_is_still_known_where_a_border_leaves_a_third_of_it_in_one_view():
    plate = coming(Form.PUNCH, 20.0, 60.0, 40.0)
    camera, reader = SimulatedWatchCamera(RIG, SimulatedClock()), WatchReader(RIG)
    camera.scenario = replace(camera.scenario, objects=(plate,))
    looks = []
    for frame, time_ns in enumerate((0, 300_000_000, 310_000_000)):
        halves = np.split(camera.image(time_ns, frame).astype(np.float32), 2, axis=1)
        looks.append([one.look(half) for one, half in zip(reader._backgrounds, halves, strict=True)])
    (left,), (right,) = looks[1]
    before = spot_of(reader.exits, (left, right))
    (left,), (right,) = looks[2]
    whole = spot_of(reader.exits, (left, right))
    kept = right.cover.shape[0] // 3
    rows = slice(right.rows.start, right.rows.start + kept)
    arrays = {key: getattr(right, key)[:kept] for key in ("cover", "seen_grey", "behind_grey")}
    pair = left, replace(right, rows=rows, cut=True, **arrays)
    assert spot_of(reader.exits, pair) is None
    again = spot_of(reader.exits, pair, before)
    # four of its sigmas of noise, and 0.05 mm for where the fit stops
    assert np.all(np.abs(again.flat.place - whole.flat.place) < 4 * again.flat.sigma_mm + 0.05)
    assert again.flat.radius_mm == pytest.approx(10.0, abs=4 * again.flat.sigma_radius_mm + 0.05)


def test_one_lens_whose_frames_have_the_shape_of_two_views_arms_nothing_and_is_named():
    one = RIG.replace({"watch.columns": 160})
    camera, reader = SimulatedWatchCamera(RIG, SimulatedClock()), WatchReader(one)
    camera.scenario = replace(camera.scenario, objects=(coming(Form.BALL, 10.0, 60.0, 80.0),))
    # the left lens's view alone; it armed the loop before
    found = [
        reader.take(camera.image(round(1e9 * frame / 30), frame)[:, :160], round(1e9 * frame / 30))
        for frame in range(48)
    ]
    assert not any(each.armed for each in found)
    assert any("views of two lenses are needed" in each.words for each in found)


def test_a_body_that_does_not_fit_takes_no_part_in_size_and_velocity():
    def spot(z_mm, radius_mm, rough):
        one = Body(
            np.array([70.0, 0.0, z_mm]), np.full(3, 0.02), radius_mm, 0.02, 5.0, 1.0, rough, 100, np.zeros(6)
        )
        return Spot(one, one, cut=False)

    track = Track(0, spot(40.0, 5.0, 0.01))
    for k in range(1, 12):
        track.add(round(1e9 * k / 30), spot(40.0 - 2.0 * k, 5.0, 0.01))
    plain = track.approach()
    track.add(round(1e9 * 12 / 30), spot(3.0, 9.0, 0.6))
    found = track.approach()
    assert plain.armed
    assert found.armed
    assert found.contact_s == pytest.approx(plain.contact_s - 1 / 30, abs=1e-6)
    assert found.diameter_mm == plain.diameter_mm


def test_what_comes_and_is_seen_no_more_is_expected_for_half_a_second():
    plate = coming(Form.PUNCH, 10.0, 40.0, 60.0)
    camera, reader = SimulatedWatchCamera(RIG, SimulatedClock()), WatchReader(RIG)
    armed = []
    for frame in range(48):
        # it vanishes 0.9 s after it came
        camera.scenario = replace(camera.scenario, objects=(plate,) if frame < 33 else ())
        armed.append(reader.take(camera.image(round(1e9 * frame / 30), frame), round(1e9 * frame / 30)).armed)
    assert all(armed[30:46])
    assert not any(armed[47:])


def test_what_both_lenses_still_see_is_expected_until_its_touch_though_no_body_fits():
    def spot(z_mm):
        one = Body(np.array([70.0, 0.0, z_mm]), np.full(3, 0.02), 5.0, 0.02, 5.0, 1.0, 0.01, 100, np.zeros(6))
        return Spot(one, one, cut=False)

    track = Track(0, spot(40.0))
    for k in range(1, 12):
        track.add(round(1e9 * k / 30), spot(40.0 - 0.5 * k))
    last = track.approach()
    assert track.kept_s(still_seen=True) > last.contact_s > 1.0 > track.kept_s(still_seen=False)
    # meanwhile its time to contact runs on: a second later there is a second less
    later = track.missed(last.time_ns + 10**9)
    assert later.armed
    assert later.contact_s == pytest.approx(last.contact_s - 1.0)
    assert later.height_mm == pytest.approx(last.height_mm - last.speed_mm_s)
    assert later.sigma_height_mm > last.sigma_height_mm


def test_a_wrong_size_now_and_then_does_not_keep_the_loop_from_arming():
    # of a ball 2.4 mm wide, whose fit ends in a wrong place in three of 14 frames
    ball = [1.54, 1.23, 1.28, 1.29, 1.27, 1.26, 1.47, 1.25, 1.49, 1.28, 1.26, 1.25, 1.28, 1.24]
    shadow = [1.3, 1.9, 1.2, 0.9, 1.4, 2.1]
    uneven = [
        _radius(
            [Body(np.zeros(3), np.full(3, 0.1), one, 0.02, one, 1.0, 0.0, 100, np.zeros(6)) for one in radii],
            np.zeros(len(radii)),
        )[2]
        for radii in (ball, shadow)
    ]
    assert uneven[0] < UNEVEN < uneven[1]


def test_a_wrong_size_while_a_view_cuts_it_does_not_keep_a_fast_ball_from_arming():
    # of two bodies that the border cut the radius was 20 % off, and a fast one is not seen much longer
    radii = [10.85, 14.28, 11.86, *[14.28] * 9]
    bodies = [Body(np.zeros(3), np.full(3, 0.1), one, 0.1, one, 1.0, 0.0, 100, np.zeros(6)) for one in radii]
    cut = np.where(np.arange(12) < 4, CUT_SHARE * 14.0, 0.0)
    assert _radius(bodies[:5], np.zeros(5))[2] > UNEVEN
    radius, sigma, uneven = _radius(bodies, cut)
    assert uneven < UNEVEN
    assert radius == pytest.approx(14.28, abs=3 * sigma)
    # shadows at the border are never seen whole: their sizes have to agree
    assert _radius(bodies[:4], cut[:4])[2] > UNEVEN
