"""A target that steps from picture to picture: the loop sees and does what it does with one that stands."""

import numpy as np
import pytest
from node_bench import LCD_PER_CAMERA, PERIOD_PX, NodeBench, dent, panel, rest_warp

REST = rest_warp(128)
INNER = REST.grid.inner
FREE = {"camera_hz": 59.94, "display": panel(rise_s=0.004)}
"""Every phase of the two clocks comes by: two pictures share most exposures."""


def pressed(peak_lcd_px: float, at_s: float = 0.2):
    bump = dent(REST, peak_lcd_px, sigma_px=30.0)
    return lambda t: bump * (t > at_s)


def frames(bench: NodeBench, count: int, after: int = 0) -> list:
    return list(bench.run(count))[after:]


@pytest.mark.parametrize("upwards", [False, True])
def test_a_standing_mirror_is_read_the_same_whatever_is_mixed(upwards):
    display = panel(scan="up" if upwards else "down")
    bench = NodeBench(REST, lambda t: 0 * REST.q, display, camera_hz=57.0, noise=0.0, step=16)
    seen = frames(bench, 30, after=2)
    contrast = [one.observation.target.contrast.min() for one in seen if one.observation.target is not None]
    assert min(contrast) < 0.96  # two pictures 1/8 period apart, half each: cos(pi / 8) = 0.924
    # the bench sums 150 instants: the light of a change of 2 px within 8 ms is known to 2 px / 150 / 2
    assert max(np.abs(one.residual.d[INNER]).max() for one in seen) < 0.008
    assert max(np.abs(np.mean([one.residual.d[INNER] for one in seen], axis=0)).ravel()) < 1e-3


def test_a_press_is_nulled_in_the_same_frames_and_as_well():
    def run(step: int) -> tuple[np.ndarray, np.ndarray]:
        bench = NodeBench(REST, pressed(6.0), **FREE, step=step, noise=0.004)
        taken = frames(bench, 50)
        error = bench.error_px() / LCD_PER_CAMERA
        return np.array([one.residual_rms_px for one in taken]), error

    (standing, error), (moving, error_moving) = run(0), run(16)
    assert np.nanmax(standing) > 1.0
    locked = [np.flatnonzero(~(one < 0.1))[-1] for one in (standing, moving)]
    assert locked[0] == locked[1]
    # 0.004 px of noise at each node; what a moving target adds is the bench's own sum of instants
    assert np.median(moving[-15:]) == pytest.approx(np.median(standing[-15:]), rel=0.3)
    assert error_moving.std() < 1.3 * error.std() + 1e-3


def test_a_sliding_dent_is_followed_as_well():
    def truth(t):
        return dent(REST, 3.0, sigma_px=30.0, shift_px=20.0 * (t - 0.3))

    def residual(step: int) -> float:
        bench = NodeBench(REST, truth, **FREE, step=step, noise=0.004)
        return float(np.median([one.residual_rms_px for one in frames(bench, 50, after=20)]))

    assert residual(16) < 1.1 * residual(0) + 1e-3


def test_a_wrong_delay_is_a_phase_error_by_the_known_rate_and_averages_out_there_and_back():
    late_s = 1e-4

    def bench(one_way: bool, late_s: float) -> NodeBench:
        return NodeBench(
            REST,
            lambda t: 0 * REST.q,
            display=panel(rise_s=0.004),
            camera_hz=60.0,
            phase=0.45,
            noise=0.0,
            step=16,
            one_way=one_way,
            late_s=late_s,
        )

    def phases(one_way: bool) -> np.ndarray:
        late, right = (frames(bench(one_way, by), 2 + 64, after=2) for by in (late_s, 0.0))
        found = []
        for one, other in zip(late, right, strict=True):
            apart = (one.measured.q - other.measured.q)[INNER] / LCD_PER_CAMERA / PERIOD_PX * 2 * np.pi
            target = one.observation.target
            expected = late_s * (0.0 if target is None else target.node_late_rad_per_s[INNER])
            assert np.abs(apart - expected).max() < 0.003  # rad
            found.append(apart)
        return np.array(found)

    there_and_back, one_way = phases(False), phases(True)
    # 1/16 and 1/8 period per 1/60 s, 0.1 ms: 2.4 and 4.7 mrad, twice that where each change is exposed for
    # half of a refresh
    assert np.abs(one_way.mean(axis=(0, 1, 2))) == pytest.approx([4.7e-3, 9.4e-3], rel=0.1)
    assert np.abs(there_and_back.mean(axis=0)).max() < 0.08 * np.abs(one_way.mean(axis=0)).max()
