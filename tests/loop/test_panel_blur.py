"""Nulls of narrow dents against planted truth: pictures drawn, blurred at the panel and by the lens,
sensed."""

from functools import cache

import numpy as np
import pytest
from scipy import ndimage
from small_rigs import with_tables

from zeromethod.gl import create_context
from zeromethod.loop.panel_blur import PanelBlur
from zeromethod.optics import Dented, Optics
from zeromethod.pattern import PatternRenderer, Response, Target
from zeromethod.rig.load import load_rig
from zeromethod.rig.model import Noise
from zeromethod.sensing import ResidualSensor
from zeromethod.simulation.aperture import gather
from zeromethod.simulation.beams import Beam
from zeromethod.simulation.press import Dent, Mirror, Shape
from zeromethod.warp.compose import compose
from zeromethod.warp.rest import Rest

DENTS_MM = {1.5: 0.02, 3.0: 0.05, 4.0: 0.1}
"""Depth by sigma."""


class NoiseFreeBench:
    """The middle of the packaged bench at its own resolution, 16 bits and no noise."""

    def __init__(self) -> None:
        size = {"columns": 256, "rows": 208, "centre_px": (127.5, 103.5), "bits": 16}
        noise = Noise(read_grey=1.0, electrons_per_grey=None, black_grey=0.0)
        self.rig = with_tables(load_rig("simulated"), camera={**size, "noise": noise})
        self.optics = Optics(self.rig)
        self.rest = Rest.of(self.rig, self.optics)
        target, display = Target.from_spec(self.rig.target), self.rig.display
        self.sensor = ResidualSensor.from_rig(self.rig, self.rest.grid, target.light)
        self.context, self.response = create_context(), Response.from_rig(display)
        with self.context:
            self.pattern = PatternRenderer(
                self.context,
                self.rest.grid,
                self.rest.q,
                (display.columns, display.rows),
                target,
                self.response,
            )

    def nulled(self, mirror: Mirror, panel_blur_px: float, blur: PanelBlur) -> tuple[np.ndarray, np.ndarray]:
        """(measured - true warp, true - rest) at the inner nodes, (n, 2) LCD px, of the converged null."""
        grid, camera, display = self.rest.grid, self.rig.camera, self.rig.display
        surface = Dented(self.optics.rest, mirror)
        v, u = np.mgrid[: camera.rows, : camera.columns].astype(float)
        q = self.optics.trace(u, v, surface).q
        beam = Beam.of(q, np.ones(q.shape[:-1]))
        true = self.optics.trace(*grid.mesh(), surface).q
        shown = true.copy()
        for _ in range(4):
            with self.context:
                picture = self.pattern.image(shown)
            light = ndimage.gaussian_filter(self.response.light(np.arange(256))[picture], panel_blur_px)
            image = np.zeros(q.shape[:-1])
            footprint = beam.q, beam.by_u, beam.by_v, beam.gain
            gather(light, *footprint, display.fill_factor, 1, camera.psf_px, image)
            residual = self.sensor.measure(np.rint(5e4 * image).astype(np.uint16))
            measured = compose(shown, residual.d, grid.spacing_px)
            blur.add_hidden(shown, measured)
            valid = residual.valid & np.isfinite(measured).all(axis=-1)
            rms_px = float(np.sqrt(np.mean(residual.d[valid] ** 2)))
            blur.learn(shown, self.rest.q, residual, valid, rms_px)
            shown = np.where(valid[..., None], measured, shown)
        inner = (slice(6, -6), slice(6, -6))
        return (measured - true)[inner].reshape(-1, 2), (true - self.rest.q)[inner].reshape(-1, 2)


@cache
def bench() -> NoiseFreeBench:
    return NoiseFreeBench()


@cache
def raster_error(panel_blur_px: float) -> np.ndarray:
    return bench().nulled(Mirror(), panel_blur_px, PanelBlur(bench().rig, bench().rest.grid))[0]


def dent(sigma_mm: float) -> Mirror:
    return Mirror((Dent(Shape.GAUSSIAN, 42.11, 0.07, DENTS_MM[sigma_mm], sigma_mm),))


@pytest.mark.parametrize("sigma_mm", DENTS_MM)
@pytest.mark.parametrize("panel_blur_px", [0.0, 1.0])
def test_measured_warp_of_a_narrow_dent_is_as_large_as_the_true_one(sigma_mm, panel_blur_px):
    blur = PanelBlur(bench().rig, bench().rest.grid)
    error, truth = bench().nulled(dent(sigma_mm), panel_blur_px, blur)
    # the panel's grid, the same without a dent, is no matter of the dent's size
    too_large = ((error - raster_error(panel_blur_px)) * truth).sum(axis=0) / (truth**2).sum(axis=0)
    # without either mend: 4e-4 at 1.5 mm unblurred; 1.5e-3, 3e-4, 2e-4 at 1.5, 3, 4 mm blurred
    assert np.abs(too_large).max() < (2e-4 if sigma_mm == 1.5 else 6e-5)


@pytest.mark.parametrize("panel_blur_px", [0.0, 0.7, 1.0])
def test_contrast_under_a_press_distinguishes_the_panels_blur_from_the_lenss(panel_blur_px):
    blur = PanelBlur(bench().rig, bench().rest.grid)
    bench().nulled(dent(3.0), panel_blur_px, blur)
    # the apertures are 0.9 and 0.85 LCD px wide; the lens of 0.7 camera px must not count
    assert blur.variance_px2 == pytest.approx(panel_blur_px**2 + 0.064, rel=0.05, abs=0.01)


def test_a_mirror_at_rest_leaves_the_apertures_blur():
    blur = PanelBlur(bench().rig, bench().rest.grid)
    start = blur.variance_px2
    bench().nulled(Mirror(), 0.0, blur)
    assert blur.variance_px2 == pytest.approx(start, abs=1e-3)
    assert start == pytest.approx((0.9**2 + 0.85**2) / 24)
