"""Nuisances of the simulated bench against closed forms, in both renderers."""

import numpy as np
import pytest
from scipy.integrate import quad

from zeromethod import Optics
from zeromethod.clock import SimulatedClock
from zeromethod.simulation.camera import SimulatedCamera
from zeromethod.simulation.display import SimulatedDisplay
from zeromethod.simulation.nuisances import (
    INDEX_PER_K,
    KELVIN_STEP,
    LENGTH_PER_K,
    Nuisances,
    warmed_rig,
)
from zeromethod.simulation.press import Mirror

QUIET = {"camera_jitter_s": 0.0}
NO_NOISE = {"camera.noise.read_grey": 0.0, "camera.noise.electrons_per_grey": None}
MS = 1_000_000


def rig_with(make_rig, renderer="numpy", **nuisances):
    values = {f"simulation.nuisances.{name}": value for name, value in nuisances.items()}
    changes = {**values, **NO_NOISE, "simulation.renderer": renderer, "camera.bits": 16}
    return make_rig(simulation=QUIET).replace(changes)


def frames(rig, count, code=128):
    """Images of an even picture, (count, rows, cols), as shares of full light, and the frames."""
    clock = SimulatedClock()
    display = SimulatedDisplay(rig, clock)
    camera = SimulatedCamera(rig, clock, display)
    display.show(np.full((rig.display.rows, rig.display.columns), code, np.uint8))
    clock.sleep_until_ns(100 * MS)
    found = [camera.read(1.0) for _ in range(count)]
    black = rig.camera.noise.black_grey
    peak = rig.simulation.peak_grey_share * (2**16 - 1) - black
    return np.stack([(one.image - black) / peak for one in found]), found


@pytest.mark.parametrize("hz", [100.0, 120.0, 50.0])
@pytest.mark.parametrize("exposure_ns", [2 * MS, 8 * MS, 20 * MS])
def test_mains_light_is_the_mean_of_its_wave_over_the_exposure(make_rig, hz, exposure_ns):
    nuisances = Nuisances(rig_with(make_rig, mains=0.1, mains_hz=hz))
    start_ns = 123_456_789

    def wave(time_s):
        return 0.1 * (1 + np.cos(2 * np.pi * hz * time_s))

    ends = 1e-9 * start_ns, 1e-9 * (start_ns + exposure_ns)
    expected = quad(wave, *ends, epsabs=1e-12)[0] / (ends[1] - ends[0])
    assert nuisances.mains(start_ns, start_ns + exposure_ns) == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize("renderer", ["numpy", "gpu"])
def test_frames_have_the_mains_light_of_their_exposure(make_rig, renderer):
    rig = rig_with(make_rig, renderer, mains=0.05)
    images, found = frames(rig, 4)
    plain, _ = frames(rig_with(make_rig, renderer), 4)
    nuisances = Nuisances(rig)
    for image, base, frame in zip(images, plain, found, strict=True):
        half = frame.exposure_ns // 2
        added = nuisances.mains(frame.time_ns - half, frame.time_ns + half)
        # 16 bits; float32 light
        assert (image - base).mean() == pytest.approx(added, abs=2e-5)
        assert np.ptp(image - base) < 1e-4


@pytest.mark.parametrize("renderer", ["numpy", "gpu"])
def test_the_backlight_grows_as_it_is_set(make_rig, renderer):
    images, found = frames(rig_with(make_rig, renderer, backlight_per_minute=3.0), 6)
    plain, _ = frames(rig_with(make_rig, renderer), 6)
    lit = plain[0] > 0.1
    for image, base, frame in zip(images, plain, found, strict=True):
        expected = 1 + 3.0 * frame.time_ns * 1e-9 / 60
        assert image[lit] / base[lit] == pytest.approx(expected, rel=3e-4)


def full_view(rig):
    """The same with as many pixels as the packaged camera has; nothing is drawn of it."""
    return rig.replace({"camera.columns": 1280, "camera.rows": 1024, "camera.centre_px": [639.5, 511.5]})


def test_dirt_is_as_much_as_was_asked_for_and_stays(make_rig):
    rig = full_view(rig_with(make_rig, dust=3))
    dirt = Nuisances(rig).dirt
    assert dirt.passes.min() == pytest.approx(0.2, abs=0.2)
    assert dirt.passes.max() == 1.0
    assert not dirt.astray.any()
    again = Nuisances(rig).dirt
    assert (again.passes == dirt.passes).all()
    more = Nuisances(full_view(rig_with(make_rig, dust=30))).dirt
    assert (more.passes < 0.9).mean() > 3 * (dirt.passes < 0.9).mean()
    assert Nuisances(rig_with(make_rig)).dirt is None


def test_a_bubble_is_dark_at_its_rim_and_sees_something_else_in_its_middle(make_rig):
    """Rays that meet a sphere of air beyond the critical angle, at 1 / index of its radius, are lost."""
    rig = full_view(rig_with(make_rig, bubbles=1))
    dirt = Nuisances(rig).dirt
    lost = np.count_nonzero(dirt.passes < 0.5)
    clear = np.count_nonzero(dirt.astray > 0.5)
    assert lost > 20
    # areas of discs of a few pixels
    assert clear / lost == pytest.approx(1 / rig.prism.index**2, rel=0.25)


@pytest.mark.parametrize("renderer", ["numpy", "gpu"])
@pytest.mark.parametrize("kind", ["dust", "scratches", "bubbles"])
def test_dirt_takes_its_share_of_the_light(make_rig, renderer, kind):
    rig = rig_with(make_rig, renderer, **{kind: 40})
    (image,), (plain,) = frames(rig, 1)[0], frames(rig_with(make_rig, renderer), 1)[0]
    dirt = Nuisances(rig).dirt
    expected = plain * dirt.passes + plain.mean() * dirt.astray
    assert image == pytest.approx(expected, abs=5e-5)
    assert (image < 0.9 * plain).any()


def test_both_renderers_show_the_same_nuisances(make_rig):
    all_of_them = {"mains": 0.03, "backlight_per_minute": 1.0, "dust": 30, "scratches": 9, "bubbles": 20}
    one, other = (frames(rig_with(make_rig, name, **all_of_them), 2)[0] for name in ("numpy", "gpu"))
    assert np.abs(one - other).max() < 2e-3


@pytest.mark.parametrize("renderer", ["numpy", "gpu"])
def test_warm_rubber_shows_the_lcd_where_its_index_and_lengths_have_it(make_rig, renderer):
    rig = rig_with(make_rig, renderer, kelvin_per_minute=600.0)
    clock = SimulatedClock()
    display = SimulatedDisplay(rig, clock)
    camera = SimulatedCamera(rig, clock, display)
    cold_q = display.renderer.ray_map(Mirror())[0].copy()
    frame = camera.read(1.0)
    start_ns = frame.time_ns - frame.exposure_ns // 2
    kelvin = Nuisances(rig).kelvin(start_ns)
    assert kelvin == pytest.approx(600 / 60 * 1e-9 * start_ns, abs=KELVIN_STEP / 2)
    q = display.renderer.ray_map(Mirror())[0]
    prism = {
        "prism.index": rig.prism.index + INDEX_PER_K * kelvin,
        "prism.pattern_length_mm": rig.prism.pattern_length_mm * (1 + LENGTH_PER_K * kelvin),
        "prism.width_mm": rig.prism.width_mm * (1 + LENGTH_PER_K * kelvin),
    }
    optics = Optics(rig.replace(prism))
    v, u = np.mgrid[: rig.camera.rows, : rig.camera.columns].astype(float)
    expected = optics.trace(u, v, optics.rest).q
    both = np.isfinite(q[..., 0]) & np.isfinite(expected[..., 0])
    # the shaders' own rays are within 0.02 LCD px
    assert np.abs(q - expected)[both].max() < 0.02
    assert kelvin == 0 or np.abs(q - cold_q)[both].max() > 0


def test_ten_degrees_move_the_image_by_what_the_index_does(make_rig):
    rig = make_rig()
    # off the middle: there both faces of a prism with equal angles undo each other
    u, v = np.array([4.0]), np.array([4.0])
    optics = [Optics(warmed_rig(rig, kelvin)) for kelvin in (0.0, 10.0, 20.0)]
    q = [one.trace(u, v, one.rest).q[0] for one in optics]
    # to first order twice as warm is twice as far
    assert q[2] - q[0] == pytest.approx(2 * (q[1] - q[0]), rel=0.02, abs=1e-3)
    assert np.hypot(*(q[1] - q[0])) > 0.02
