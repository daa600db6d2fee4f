"""The decoder on the simulated bench: rays, Fresnel light, LCD grid, response, noise, second reflections."""

import numpy as np
import pytest
from small_rigs import with_tables

from zeromethod import Optics, Rig, load_rig
from zeromethod.decoding import Reason
from zeromethod.decoding.fringes import FringeSequence, equal_shifts
from zeromethod.decoding.measuring import RestMeasurement, measure_rest
from zeromethod.decoding.noise import NoiseModel
from zeromethod.decoding.periods import choose_periods
from zeromethod.pattern import Response
from zeromethod.simulation.numpy_renderer import NumpyRenderer
from zeromethod.simulation.press import Mirror
from zeromethod.simulation.renderer import Piece
from zeromethod.simulation.sensor import Sensor

SHAPE = (72, 88)


def part_of_view(first_px: tuple[int, int], **simulation: float) -> Rig:
    """The virtual bench, of whose camera only 88 x 72 px from `first_px` (column, row) are read."""
    rig = load_rig("virtual")
    centre = tuple(c - f for c, f in zip(rig.camera.centre_px, first_px, strict=True))
    size = {"columns": SHAPE[1], "rows": SHAPE[0], "centre_px": centre}
    return with_tables(rig, camera=size, simulation=simulation)


def captured(rig: Rig, response: Response) -> RestMeasurement:
    """Rest map from six shifts of the default periods, drawn through the inverse of `response`."""
    sequence = FringeSequence(choose_periods(rig.display.columns), equal_shifts(6))
    renderer, sensor = NumpyRenderer(rig), Sensor(rig)
    share = np.ones(rig.display.rows, np.float32)
    frames = []
    for number, light in enumerate(sequence.pictures(rig.display.columns, rig.display.rows)):
        handle = renderer.upload(np.rint(response.inverse(light)).astype(np.uint8))
        seen = renderer.expose([Piece(1.0, Mirror(()), [(handle, share)])])
        renderer.release(handle)
        frames.append(sensor.image(seen, number))
    noise = rig.camera.noise
    model = NoiseModel.of_camera(noise.read_grey, noise.electrons_per_grey, noise.black_grey)
    return measure_rest(frames, sequence, size_px=(rig.display.columns, rig.display.rows), noise=model)


def errors_px(rig: Rig, found: RestMeasurement) -> np.ndarray:
    v, u = np.mgrid[: rig.camera.rows, : rig.camera.columns].astype(float)
    return found.rest_map.lcd_px - Optics(rig).rest_map(u, v)


def test_the_rest_map_of_the_bench_is_found_though_its_response_is_not_known():
    rig = part_of_view((280, 220))
    found = captured(rig, Response(1.0))
    off = errors_px(rig, found)
    assert found.rest_map.valid.all()
    # 12,672 errors know their spread to 0.6 %; gaps between the LCD's pixels and the rounding of its codes
    # are in no noise model.
    assert np.std(off / found.rest_map.sigma_px) == pytest.approx(1.0, abs=0.04)
    assert np.abs(off.mean(axis=(0, 1))).max() < 0.003
    assert found.near_px == 0
    # A panel drawn without its inverse response: harmonics past the fit's pass for a little scatter.
    assert 1.0 <= found.scatter_ratio < 1.2
    assert found.second_harmonic > 0.1


def test_second_reflections_of_the_faces_are_found_and_named():
    rig = part_of_view((80, 60), ghost_faces=0.1)
    found = captured(rig, Response.from_rig(rig.display))
    rest = found.rest_map
    # Faces reflect all over this part of the view, by a tenth of the light, three times the limit: where the
    # reflections nearly coincide their neighbours name them, and no place may pass for a good one.
    assert np.mean((rest.reason & int(Reason.SECOND_REFLECTION)) != 0) > 0.9
    assert not rest.valid.any()
    assert np.isnan(rest.lcd_px).all()
