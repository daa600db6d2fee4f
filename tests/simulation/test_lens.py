"""The lens's Gaussian as the shader gets it, and what it does for the measurement."""

from functools import cache

import numpy as np
import pytest
from numpy.polynomial.polynomial import polyval2d, polyvander2d
from numpy.typing import NDArray
from scipy.special import ndtr
from small_rigs import with_tables

from zeromethod import NodeGrid, Optics, load_rig
from zeromethod.gl import create_context
from zeromethod.pattern import Target
from zeromethod.rig.model import Noise, Rig
from zeromethod.sensing import ResidualSensor
from zeromethod.simulation.gpu import GpuRenderer
from zeromethod.simulation.gpu_lens import LEAST_PSF_PX, before, lens_defines
from zeromethod.simulation.numpy_renderer import NumpyRenderer
from zeromethod.simulation.press import Mirror
from zeromethod.simulation.renderer import BenchRenderer, Piece

COLUMNS, ROWS = 192, 128


@pytest.mark.parametrize("psf_px", [LEAST_PSF_PX, 0.1, 0.175, 0.7, 1.3, 5.0])
def test_shaders_polynomial_is_box_times_gaussian(psf_px):
    defines = lens_defines(psf_px)
    reach = float(defines["REACH"])
    x = np.linspace(-reach, reach, 1001).astype(np.float32)
    t = np.float32(2) * (x / np.float32(reach)) ** 2 - np.float32(1)
    got = x * eval(str(defines["RESPONSE"]), {"t": t})  # a polynomial in GLSL is Python as well
    box = (np.arange(4000) + 0.5) / 4000 - 0.5
    expected = np.array([ndtr((at - box) / psf_px).mean() for at in x.astype(float)]) - 0.5
    np.testing.assert_allclose(before(x.astype(float), psf_px) - 0.5, expected, atol=1e-6)
    np.testing.assert_allclose(got, expected, atol=1e-5)


def test_no_lens_is_the_bare_pixel():
    # a box of 1 px has that standard deviation
    assert lens_defines(0.0) == {"LENS": 0, "REACH": 0.5, "SPREAD": pytest.approx(12**-0.5)}


def _crop(psf_px: float) -> Rig:
    """A window of the simulated rig at its own resolution, on a linear LCD."""
    camera = {"columns": COLUMNS, "rows": ROWS, "centre_px": (130.0, 70.0), "psf_px": psf_px}
    return with_tables(load_rig("simulated"), camera=camera, display={"gamma": 1.0})


@cache
def _panel() -> NDArray[np.uint16]:
    """16-bit codes of every LCD pixel that show the target at rest; 0 outside the view."""
    rig = _crop(0.0)
    u, v = (
        a.ravel() for a in np.meshgrid(np.linspace(-12, COLUMNS + 12, 30), np.linspace(-12, ROWS + 12, 30))
    )
    optics = Optics(rig)
    q = optics.trace(u, v, optics.rest).q
    middle, half = (q.max(axis=0) + q.min(axis=0)) / 2, np.ptp(q, axis=0) / 2
    x, y = ((q - middle) / half).T
    degree = [6, 6]
    fits = [np.linalg.lstsq(polyvander2d(x, y, degree), side, rcond=None)[0].reshape(7, 7) for side in (u, v)]
    row, column = np.mgrid[0 : rig.display.rows, 0 : rig.display.columns]
    x, y = (column - middle[0]) / half[0], (row - middle[1]) / half[1]
    inside = (np.abs(x) <= 1) & (np.abs(y) <= 1)
    codes = np.zeros(row.shape, np.uint16)
    at = [polyval2d(x[inside], y[inside], fit) for fit in fits]
    codes[inside] = np.rint(65535 * Target.from_spec(rig.target).light(*at))
    return codes


def _bias_px(renderer: BenchRenderer, rig: Rig) -> float:
    """Root mean square of the residual at rest, camera px, without noise."""
    codes = _panel()
    ones = np.ones(rig.display.rows, np.float32)
    # 8 bits on the LCD would leave 0.002 px: the high and the low byte share the exposure, 256 to 1
    bytes_and_weights = ((codes >> 8, 256 / 257), (codes & 255, 1 / 257))
    pieces = [
        Piece(weight, Mirror(), [(renderer.upload(part.astype(np.uint8)), ones)])
        for part, weight in bytes_and_weights
    ]
    light = renderer.expose(pieces)
    grid = NodeGrid((ROWS, COLUMNS), rig.target.period_px)
    quiet = Noise(read_grey=0.0, electrons_per_grey=None, black_grey=0.0)
    sensor = ResidualSensor(grid, rig.target.kind, quiet, 16)
    residual = sensor.measure(np.rint(40000 * light).astype(np.uint16))
    assert residual.valid[grid.inner].all()
    return float(np.sqrt(np.mean(residual.d[grid.inner] ** 2)))


@pytest.mark.parametrize("kind", ["gpu", "numpy"])
def test_lens_takes_away_the_bias_of_the_lcd_grid(kind):
    """The grid of apertures beats with the camera's pixels, unless the lens blurs it before they sample."""
    bias = []
    for psf_px in (0.0, 0.7):
        rig = _crop(psf_px)
        if kind == "numpy":
            bias.append(_bias_px(NumpyRenderer(rig), rig))
            continue
        with create_context() as context:
            renderer = GpuRenderer(rig, context)
            bias.append(_bias_px(renderer, rig))
            renderer.close()
        context.release()
    assert bias[1] < 1e-4  # the lens passes 1 % of the beat, the sensing's windows less of that
    assert bias[0] > 0.005
