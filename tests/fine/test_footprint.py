import numpy as np
import pytest
from scipy.fft import fft2, ifft2

from benchmarks.rigs import changed, small_rig
from zeromethod.fine.footprint import Footprint, regularised_inverse, response
from zeromethod.fine.lattice import PixelLattice
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
    share = response(np.linalg.norm(np.tensordot(half_px.T, k, 1), axis=0))
    seen = np.real(ifft2(fft2(dent) * share)).astype(np.float32)
    expected = np.real(ifft2(fft2(dent) * share * regularised_inverse(share)))[rows // 2, at]
    assert expected == pytest.approx(1.0, abs=0.03)
    # footprints in between are those of two, right to second order in the wave number
    assert Footprint(rig, lattice).divided(seen)[rows // 2, at] == pytest.approx(expected, abs=0.005)
