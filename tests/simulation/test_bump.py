"""The planted motion of the simulated bench: what is drawn after it."""

import numpy as np
import pytest
from small_rigs import BENCH_160, with_tables

from zeromethod import Optics, load_rig
from zeromethod.rig.model import Faults, Rig
from zeromethod.simulation.bump import moved_rig, moved_share
from zeromethod.simulation.gpu import GpuRenderer
from zeromethod.simulation.numpy_renderer import NumpyRenderer
from zeromethod.simulation.press import Mirror


@pytest.fixture(scope="module")
def rig() -> Rig:
    faults = Faults(
        moved_at_frame=10, moved_over_frames=3, camera_turned_deg=(0.1, 0.0, 0.0), display_slid_mm=(0.5, 0.2)
    )
    return with_tables(load_rig("simulated").replace(BENCH_160), simulation={"faults": faults})


def test_it_comes_evenly_over_its_frames_and_stays(rig):
    assert [moved_share(rig, frame) for frame in (0, 9, 10, 11, 12, 13, 500)] == [0, 0, 0.25, 0.5, 0.75, 1, 1]


@pytest.mark.parametrize("renderer", [GpuRenderer, NumpyRenderer])
def test_camera_and_lcd_are_drawn_where_they_then_are(rig, renderer):
    drawn, true = renderer(rig), moved_rig(rig, 1.0)
    drawn.move(true)
    q, _ = drawn.ray_map(Mirror())
    drawn.close()
    u, v = np.meshgrid(np.arange(rig.camera.columns), np.arange(rig.camera.rows))
    expected = Optics(true).rest_map(u, v)
    # the shader's single precision
    assert np.nanmax(np.abs(q - expected)) < 0.02
    # an LCD slid by 0.5 and 0.2 mm, and a camera turned by 0.1 deg, which is 1.96 px of 1125 px focal length
    by_u = np.nanmean(np.diff(expected, axis=1), axis=(0, 1))
    away = np.nanmean(expected - Optics(rig).rest_map(u, v), axis=(0, 1))
    slid = -np.array([0.5, 0.2]) / rig.display.pitch_mm
    assert away == pytest.approx(slid + np.tan(np.radians(0.1)) * 1125 * by_u, abs=0.1)
