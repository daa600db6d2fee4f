import numpy as np
import pytest
from scipy.fft import fft2, ifft2

from benchmarks.rigs import changed, small_rig
from zeromethod.fine.footprint import Footprint, regularised_inverse, response
from zeromethod.fine.lattice import PixelLattice
from zeromethod.optics import Optics
from zeromethod.optics.pupil import footprint_terms, quadratic_terms
from zeromethod.warp.grid import NodeGrid

SIGMA_PX = 2.0


@pytest.mark.parametrize("across", [-0.8, -0.4, 0.0, 0.4, 0.8])
def test_a_dent_is_divided_by_the_footprint_of_its_place(across):
    rig = changed(small_rig(4), camera={"pupil_mm": 5.0})
    lattice = PixelLattice(NodeGrid.of_rig(rig))
    rows, cols = lattice.shape
    v, u = np.mgrid[:rows, :cols]
    at = round((0.5 + 0.5 * across) * (cols - 1))
    dent = np.exp(-0.5 * ((u - at) ** 2 + (v - rows // 2) ** 2) / SIGMA_PX**2)
    # the footprint there, which is all that a narrow dent sees of those in the view
    place = 2.0 * (at + lattice.box[1].start) / (lattice.grid.image_shape[1] - 1) - 1.0
    terms = quadratic_terms(np.array([place]), np.zeros(1))
    half_px = np.einsum("rk,kij->rij", terms, footprint_terms(rig))[0]
    k = np.stack(np.meshgrid(*(2 * np.pi * np.fft.fftfreq(n) for n in (cols, rows))))
    radius = np.linalg.norm(np.tensordot(half_px.T, k, 1), axis=0)
    share = response(radius)
    seen = np.real(ifft2(fft2(dent) * share)).astype(np.float32)
    expected = np.real(ifft2(fft2(dent) * share * regularised_inverse(radius)))[rows // 2, at]
    assert expected == pytest.approx(1.0, abs=0.03)
    # footprints in between are those of two, right to second order in the wave number
    assert Footprint(rig, Optics(rig), lattice).applied(seen)[rows // 2, at] == pytest.approx(
        expected, abs=0.005
    )


def test_waves_that_the_pupil_shows_inverted_are_noise():
    r = np.linspace(0.0, 12.0, 1201)
    gain, shown = regularised_inverse(r), response(r)
    inverted_first = r[np.flatnonzero(shown <= 0.0)[0]]
    assert np.all(gain[r >= inverted_first] == 0.0)
    # up to there what is divided never exceeds the true wave, and is half of it where c = F / (1 - F)
    whole = (gain * shown)[r < inverted_first]
    assert np.all((whole >= 0.0) & (whole <= 1.0))
    half = np.interp(0.5, whole[::-1], r[: len(whole)][::-1])
    assert float(response(np.array(half))) == pytest.approx(0.15 / 1.15, abs=1e-3)


def test_waves_of_the_lcds_pixels_are_smoothed_away_and_longer_ones_stay():
    rig = changed(small_rig(4), camera={"pupil_mm": 0.0})
    lattice = PixelLattice(NodeGrid.of_rig(rig))
    rows, cols = lattice.shape
    usable = np.ones((rows, cols), bool)
    usable[:, 80] = False
    u = np.arange(cols)
    left = []
    for cycles_per_px in (0.432, 1 / 12):
        wave = np.cos(2 * np.pi * cycles_per_px * u)
        d = np.repeat(np.tile(wave, (rows, 1))[..., None], 2, axis=-1).astype(np.float32)
        out = Footprint(rig, Optics(rig), lattice, divide=False).without_grid(d, usable)
        left.append(float(out[rows // 2, 10:60, 0] @ wave[10:60] / (wave[10:60] @ wave[10:60])))
        # next to a pixel that is not usable nothing is mixed
        assert out[rows // 2, 79, 0] == np.float32(wave[79])
    # on the packaged bench they are seen as 0.432 cycles per px, within a hundredth
    assert abs(left[0]) < 0.05
    assert left[1] == pytest.approx(1.0, abs=1e-3)
