"""The zero method in light levels: reading, lock, channels that fail, recording and replay."""

import json
import re

import h5py
import numpy as np
import pytest
from command_line import run

from benchmarks import leds
from zeromethod.light_array.devices import Readings
from zeromethod.light_array.estimate import each_led, look, model_of, seen
from zeromethod.light_array.exchange import Exchange, no_record
from zeromethod.light_array.frames import FRAME_BYTES, LEVELS, READINGS, Frames, frame
from zeromethod.light_array.loop import LightLoop
from zeromethod.light_array.modes import Modes
from zeromethod.light_array.simulated import FramedMirror, SimulatedArrays
from zeromethod.light_array.start import levels_at_rest
from zeromethod.loop.state import State
from zeromethod.resources import resource

PRESS = (42.0, 0.0, 6.0, 0.2)


def test_the_optics_of_the_reader_see_what_traced_rays_see():
    rig = leds.packaged(led_spread=0.0, detector_spread=0.0)
    arrays, model = SimulatedArrays(rig), model_of(rig)
    levels = levels_at_rest(rig) / 65535
    true = arrays._seen(FramedMirror(leds.pressed([]).mirror_at(0), rig)) @ levels
    found = seen(look(model, np.zeros(rig.reading.modes)), levels)
    # apertures are combined here as a variance, there ray by ray; what is left is taken out at rest
    assert np.abs(found - true).max() < 0.003


def test_slopes_and_bends_of_the_modes_are_those_of_their_depth():
    rig = leds.packaged()
    modes = Modes.of(rig)
    points, step = np.array([[30.0, -7.0], [55.0, 11.0]]), 1e-4
    fields = modes.derivatives(points)
    for axis, first, second in ((0, 1, 3), (1, 2, 5)):
        shift = np.eye(2)[axis] * step
        ahead, behind = (modes.derivatives(points + off)[0] for off in (shift, -shift))
        np.testing.assert_allclose((ahead - behind) / (2 * step), fields[first], atol=1e-9)
        np.testing.assert_allclose((ahead - 2 * fields[0] + behind) / step**2, fields[second], atol=1e-6)
    edge = np.array([[17.0, 3.0], [67.0, 3.0], [40.0, 18.0], [40.0, -18.0]])
    np.testing.assert_allclose(modes.derivatives(edge)[0], 0, atol=1e-12)


def test_a_sudden_press_is_nulled_within_2_ms_and_read_within_2_percent():
    out = leds.run(leds.packaged(), leds.pressed([PRESS]))
    assert out.lock_s <= 0.002
    assert out.faults == {}
    assert out.end is State.LOCKED
    assert len(out.errors) > 50
    assert max(abs(error[0]) for error in out.errors) < 0.02
    # untouched, 50 readings of the whole view know the rms to a percent or so
    assert np.sqrt(np.mean(np.square(out.untouched))) < 2e-4


def test_the_levels_show_the_press_and_readings_do_not():
    rig = leds.packaged()
    arrays = SimulatedArrays(rig)
    arrays.scenario = leds.pressed([(42.0, 0.0, 8.0, 0.05)])
    loop = LightLoop(rig, arrays)
    *_, step = loop.run(seconds=0.1)
    assert step.state is State.LOCKED
    # a residual of noise alone, while levels moved by ten times as much
    assert step.light_residual < 1.5 * rig.detectors.noise
    moved = (step.shown.astype(float) - loop.start.levels) / 65535
    assert np.sqrt(np.mean(moved**2)) > 10 * rig.detectors.noise


def test_slopes_of_the_map_are_the_mirrors_along_x_and_along_y():
    rig = leds.packaged()
    arrays = SimulatedArrays(rig)
    arrays.scenario = leds.pressed([PRESS])
    surfaces = [step.surface for step in LightLoop(rig, arrays).run(seconds=0.1) if step.surface is not None]
    surface = surfaces[-1]
    _, *true = arrays.true_mirror(surface.time_ns).field(surface.x_mm, surface.y_mm)
    errors = (surface.slope - np.stack(true, axis=-1)) / surface.sigma_slope
    # of 512 slopes none is beyond 5 sigma by noise; the press has slopes of 20 mrad, tens of sigma
    assert np.abs(errors).max() < 5
    assert np.abs(surface.slope[..., 0] - surface.slope[..., 1]).max() > 20 * surface.sigma_slope.max()


def test_dead_channels_are_named_at_the_start_and_left_out():
    dead = {"dead_leds": (17, 120), "dead_detectors": (3, 136), "saturated_detectors": (200,)}
    out = leds.run(leds.packaged(fault_s=-10.0, **dead), leds.pressed([PRESS]))
    assert out.faults == {
        "LED 17": "dead",
        "LED 120": "dead",
        "detector 3": "dead",
        "detector 136": "dead",
        "detector 200": "saturated",
    }
    assert max(abs(error[0]) for error in out.errors) < 0.02


def test_channels_that_do_not_see_each_other_are_not_called_dead():
    # the LEDs' array is 8 mm along y from where the detectors look: four rows of each are out of view
    rig = leds.packaged().changed(leds={"centre_mm": (27.0, 8.0)}, frame={"y_mm": (-24.0, 24.0)})
    arrays = SimulatedArrays(rig)
    arrays.scenario = leds.pressed([])
    loop = LightLoop(rig, arrays)
    steps = list(loop.run(seconds=0.05))
    assert {loop.faults[f"LED {k}"] for k in range(13 * 16, 256)} == {"seen by no detector"}
    assert {loop.faults[f"detector {k}"] for k in range(3 * 16)} == {"looking beyond the LEDs"}
    assert "dead" not in loop.faults.values()
    assert steps[-1].state is State.RESTING
    sigmas = [step.peak.sigma_mm for step in steps if step.peak is not None]
    assert len(sigmas) > 40
    # what nobody can see there is no doubt about what is seen elsewhere: some micrometres, not tenths of mm
    assert np.median(sigmas) < 0.01


def test_noisy_arrays_are_read_with_the_sigma_that_they_have():
    rig = leds.packaged().changed(detectors={"noise": 0.01})
    arrays = SimulatedArrays(rig)
    arrays.scenario = leds.pressed([])
    peaks = [step.peak for step in LightLoop(rig, arrays).run(seconds=0.05) if step.peak is not None]
    # 250 frames make 50 readings; noise moves the fit so far in some that they are left out
    assert len(peaks) > 30
    assert all(abs(peak.depth_mm) < 4 * peak.sigma_mm for peak in peaks)


def test_arrays_that_are_displaced_are_found_and_nothing_is_called_dead():
    # bonded 0.7 mm off, a third of a pitch: places and gains must not pass for each other
    arrays = SimulatedArrays(leds.packaged().changed(leds={"centre_mm": (27.7, -0.5)}))
    arrays.scenario = leds.pressed([])
    loop = LightLoop(leds.packaged(), arrays)
    *_, step = loop.run(seconds=0.02)
    assert step.state is State.RESTING
    assert loop.faults == {}
    # gains that differ by 5 % shift the middle of what 256 detectors see by a few µm
    pitch_mm = loop.rig.leds.pitch_mm
    assert np.abs(pitch_mm * loop.model.off.mean(axis=0) - (-0.7, 0.5)).max() < 0.02


def test_leds_that_fail_together_are_all_named():
    out = leds.run(leds.packaged(fault_s=0.02, dead_leds=(17, 44, 120, 201)), leds.pressed([]))
    assert set(out.faults) == {"LED 17", "LED 44", "LED 120", "LED 201"}
    assert out.end is State.RESTING


def test_detectors_that_the_pattern_at_rest_saturates_are_named():
    rig = leds.packaged(detector_spread=0.1, seed=2)
    arrays = SimulatedArrays(rig)
    arrays.scenario = leds.pressed([])
    loop = LightLoop(rig, arrays)
    for step in loop.run(seconds=0.05):
        assert step.counts is None or step.counts[loop._channels.alive].max() < 65535
    assert "saturated" in loop.faults.values()


@pytest.mark.parametrize(
    ("values", "name"),
    [
        ({"dead_leds": (119,)}, "LED 119 is dead"),
        ({"dead_detectors": (100,)}, "detector 100 is dead"),
        ({"drifting_detectors": (150,)}, "detector 150 is drifting"),
    ],
)
def test_a_channel_that_fails_at_rest_is_named_and_no_other(values, name):
    out = leds.run(leds.packaged(fault_s=0.02, **values), leds.pressed([PRESS], 0.25), 0.28)
    assert [key for key in out.counts if key.endswith(("dead", "drifting"))] == [name]
    assert len(out.faults) == 1
    assert max(abs(error[0]) for error in out.errors) < 0.02


@pytest.mark.parametrize("dent", [(42.0, 0.0, 2.0, 0.05), (32.0, 9.0, 2.0, 0.01), (27.0, 3.0, 3.0, 0.01)])
def test_a_dent_finer_than_the_modes_is_said_and_not_read(dent):
    rig = leds.packaged()
    arrays = SimulatedArrays(rig)
    arrays.scenario = leds.pressed([dent])
    steps = list(LightLoop(rig, arrays).run(seconds=rig.simulation.begin_s + 0.09))
    # from 4 ms after it came; these would be read 30 to 70 % too shallow, and were called resting
    late = [step for step in steps if arrays.scenario_ns(step.time_ns) > 1e9 * (leds.PRESS_S + 0.004)]
    assert len(late) > 150
    assert all(step.modes is None for step in late)
    assert all(step.state in {State.NULLING, State.LOST} for step in late)
    assert late[-1].state is State.LOST
    if dent[3] == 0.01:  # of the deepest nothing is left to find its place by
        assert late[-1].reason.startswith("a dent finer than the depth modes")
        x, y = (float(word) for word in late[-1].reason.split(" at ")[1].removesuffix(" mm").split(", "))
        assert np.hypot(x - dent[0], y - dent[1]) < 2


@pytest.mark.parametrize("sigma", [2.0, 3.0])
def test_a_dent_below_the_noise_is_within_sigma(sigma):
    # 1 µm: a few sigma of one reading, at single detectors
    out = leds.run(leds.packaged(), leds.pressed([(42.0, 3.0, sigma, 0.001)]))
    assert len(out.errors) > 20
    # of 66 readings of noise one is beyond 3 sigma in every sixth run, and beyond 4 in none of 200
    assert all(abs(error[1]) < 4 for error in out.errors)
    assert np.mean([abs(error[1]) > 3 for error in out.errors]) < 0.05


def test_detectors_that_are_turned_are_found_to_look_elsewhere():
    loop = LightLoop(rig := leds.packaged(turned_mrad=2.0), SimulatedArrays(rig))
    next(loop.run())
    # 2 mrad over some 60 mm of path, by 2 mm of pitch: 0.05 of a pitch; noise of a place 0.003
    assert np.abs(loop.model.off[:, 0] + 0.057).max() < 0.03
    assert np.abs(loop.model.off[:, 1]).max() < 0.015


def test_a_recording_repeats_bit_for_bit_and_says_so_where_it_does_not(tmp_path):
    file, summary, press = (tmp_path / name for name in ("run.h5", "run.json", "press.toml"))
    # at once, and as wide as the packaged press of this rig
    step = resource("calibration", "presses", "step.toml").read_text()
    press.write_text(step.replace("width_mm = 3.54", "width_mm = 5.0"))
    ran = run("run --rig leds --scenario", press, "--seconds 0.25 --record", file, "--summary", summary)
    assert ran.code == 0, ran.err
    figures = json.loads(summary.read_text())
    assert figures["state"] == "locked"
    assert figures["frames"] > 1000
    deepest = figures["deepest"]
    assert abs(deepest["depth_mm"] - 0.2) < 3 * deepest["sigma_mm"]
    assert f"{deepest['depth_mm']:.5f} mm" in ran.out
    again = run("replay", file)
    assert again.code == 0
    assert "the same, bit for bit" in again.out
    assert re.search(r"frames +(\d+)", again.out)[1] == re.search(r"frames \(lost\) +(\d+)", ran.out)[1]
    with h5py.File(file, "r+") as recorded:
        # one reading of the press, by one count
        row = recorded["readings"][-600]
        row["counts"][100] += 1
        recorded["readings"][-600] = row
    assert "not the same" in run("replay", file).out
    refused = run("report", file)
    assert (refused.code, "only `zeromethod replay` can read it" in refused.err) == (2, True)
    assert "not with a recording of arrays" in run("replay", file, "--gain 0.5").err
    assert run("run --rig leds --record", file).code == 2


def test_frames_come_through_noise_on_the_line():
    levels = np.arange(256, dtype=np.uint16)
    frames = Frames(LEVELS)
    one, two = (frame(LEVELS, Readings(k, 0, 0, of)) for k, of in ((7, levels), (8, levels[::-1])))
    broken = bytearray(frame(LEVELS, Readings(9, 0, 0, levels)))
    broken[50] ^= 1
    stream = b"ZLx" + one[:100] + one + b"Z" + bytes(broken) + two
    found = [each for k in range(0, len(stream), 33) for each in frames.add(stream[k : k + 33])]
    assert [each.number for each in found] == [7, 8]
    np.testing.assert_array_equal(found[1].counts, levels[::-1])
    assert frames.broken == 2
    assert len(one) == FRAME_BYTES == 536
    assert Frames(READINGS).add(one) == []
    assert Frames(READINGS).add(frame(READINGS, found[0]))[0].number == 7


def test_clocks_and_numbers_of_any_size_are_taken():
    sent = Readings(2**32 + 3, 2**32 - 1, -5, np.arange(256, dtype=np.uint16))
    (came,) = Frames(READINGS).add(frame(READINGS, sent))
    assert (came.number, came.shown) == (3, 2**32 - 1)
    # a clock beyond 2^63 ns: as a number that tables of 64 bits with a sign can hold
    assert came.time_ns == -5


def test_levels_are_numbered_as_32_bits_can_return_them():
    exchange = Exchange(SimulatedArrays(leds.packaged()), 1.0, no_record)
    exchange._number = 2**32 - 2
    levels = np.arange(256, dtype=np.uint16)
    exchange.send(levels)
    exchange.send(levels + 1)
    assert exchange.levels(0)[0] == 1


def test_what_is_named_is_the_channel_that_explains_most():
    rig = leds.packaged()
    arrays = SimulatedArrays(rig)
    arrays.scenario = leds.pressed([])
    loop = LightLoop(rig, arrays)
    *_, step = loop.run(frames=30)
    at_rest = look(loop.model, np.zeros(rig.reading.modes))
    lit = step.shown / 65535
    of_88 = seen(at_rest, np.where(np.arange(256) == 88, lit, 0.0)) / loop.model.sigma
    channels, columns = loop._channels, each_led(at_rest) * lit / loop.model.sigma
    assert channels._dead(columns, -of_88, step.counts, of_88 > 6) == ["LED 88 is dead and left out"]
    assert channels.led[88] == 0
    # 0.4 % darker each: what is left over is the modes' to tell, too
    for left, found in (
        (-0.004 * of_88, (88, True)),
        (-np.eye(256)[100], (100, False)),
    ):
        assert loop._finer.channel(left, 500) == found
