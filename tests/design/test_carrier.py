"""The carrier's best period: closed forms, the loop's own test of nodes, and the simulated bench's noise."""

import numpy as np
import pytest
from small_rigs import BENCH_160, SMALL_LCD, with_tables

from zeromethod import Rig, Session, load_rig
from zeromethod.design import PressKind, SampledView, press_limit
from zeromethod.design.carrier import bend_share, carrier_figures, carrier_words

from .design_benches import small, telecentric


def figures(rig: Rig) -> tuple[dict, dict]:
    found = carrier_figures(SampledView(rig))
    return found, {row["period_px"]: row for row in found["curve"]}


def blurred(psf_px: float) -> Rig:
    """A bench whose LCD is fine enough for any period."""
    fine = {"columns": 8000, "rows": 6000, "pitch_mm": 0.01, "fill_factor": (1.0, 1.0)}
    return small(camera={"psf_px": psf_px}, display=fine)


def test_blur_takes_noise_to_a_least_that_moves_with_it():
    best = []
    for psf_px in (2.0, 3.5):
        found, rows = figures(blurred(psf_px))
        left = {P: np.exp(-2 * (np.pi * psf_px / P) ** 2) * np.sinc(1 / P) for P in rows}
        noise = {P: row["displacement_px"] / rows[64]["displacement_px"] for P, row in rows.items()}
        # a node's noise is the modulation's; the window's sums depart from integrals by 1 / (2 P^2)
        assert noise == pytest.approx({P: left[64] / left[P] for P in rows}, rel=0.01)
        best.append(found["advised_px"])
        # period / modulation is least at 2 pi sigma, the pixel a twelfth more; periods 2 to 4 px apart
        least = 2 * np.pi * np.sqrt(psf_px**2 + 1 / 12)
        by_slope = min(noise, key=lambda P: P * noise[P])
        assert by_slope == pytest.approx(least, abs=2.0)
        # slopes summed over fewer nodes: depth gains the logarithm of their number
        assert by_slope <= best[-1] < 64
        assert found["because"] == "noise"
    assert best[0] < best[1]


def test_modulation_is_the_carriers_through_lens_pixel_and_lcd():
    _, rows = figures(telecentric(camera={"psf_px": 1.5}, display={"fill_factor": (0.9, 0.85)}))
    lcd_px = 0.1 / 0.063  # per camera px: parallel rays, right angles
    for period in (8, 16, 32):
        lens = np.exp(-2 * (np.pi * 1.5 / period) ** 2) * np.sinc(1 / period)
        lit = np.mean(np.sinc(np.array([0.9, 0.85]) / (lcd_px * period)))
        assert rows[period]["modulation"] == pytest.approx(0.45 * lens * lit, rel=1e-3)
        assert rows[period]["lcd_px"] == pytest.approx(lcd_px * period, rel=1e-3)


def test_a_coarse_lcd_sets_the_period():
    # 0.57 LCD px per camera px: half of what folds leaves 4 of 8 LCD px from 14.1 camera px on
    found, rows = figures(small(display=SMALL_LCD))
    assert (found["advised_px"], found["because"]) == (16, "LCD")
    assert rows[14]["drawn_share"] < 0.5 < rows[16]["drawn_share"]
    assert rows[12]["depth_rms_nm"] < rows[14]["depth_rms_nm"] < rows[16]["depth_rms_nm"]
    assert carrier_words(found) == ""
    # a bench with another period hears of it
    short, long = (carrier_words(found | {"present_px": period}) for period in (10, 32))
    assert "16 instead of 10 camera px would null bends up to 56% of the fold limit" in short
    less = 1 - rows[16]["depth_rms_nm"] / rows[32]["depth_rms_nm"]
    assert f"16 instead of 32 camera px would give {less:.0%} less noise of depth" in long


def test_what_is_drawn_is_what_the_loop_draws():
    rig = small(display=SMALL_LCD)
    view = SampledView(rig)
    middle = view.central
    limit = press_limit(view, PressKind.parse("gaussian:5"), middle.x_mm, middle.y_mm)
    share = float(np.nanmedian(bend_share(view, 16)[middle.mask]))
    # the ring is bent the other way across, and both depths are known to 3 %
    assert share == pytest.approx(limit.nulled_mm / limit.fold_mm, rel=0.05)


def test_simulated_bench_has_the_noise_predicted():
    bench = load_rig("simulated").replace({**BENCH_160, "scenario": "none", "camera.psf_px": 1.2})
    scatter, predicted = [], []
    for period in (8, 16):
        rig = with_tables(bench, target={"period_px": period})
        with Session(rig) as session:
            steps = list(session.run(seconds=0.3))
        view = SampledView(rig)
        q = np.array([step.measured.q[view.grid.inner] for step in steps if step.measured is not None][6:])
        variance = np.var(q, axis=0, ddof=1)[view.on_lcd]
        per_px = np.linalg.norm(view.lcd_per_camera, axis=-1)[view.on_lcd]
        scatter.append(float(np.sqrt(np.mean(variance / per_px**2))))
        predicted.append(figures(rig)[1][period]["displacement_px"])
    # some ten frames of 80 independent nodes, two components: 2.5 %; the target is drawn in whole codes
    np.testing.assert_allclose(scatter, predicted, rtol=0.08)
    # without the lens's blur a node's noise is alike at every period: the change is the modulation's
    assert scatter[0] / scatter[1] > 1.2
