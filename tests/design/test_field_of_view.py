"""Field of view: known spans of parallel rays, and where the rest goes."""

import numpy as np
import pytest

from zeromethod.design import SampledView
from zeromethod.design.figures import field_of_view
from zeromethod.rig.load import load_rig

from .design_benches import PIXEL_MM, telecentric


def test_the_span_on_the_mirror_is_that_of_the_nodes(view):
    found = field_of_view(view)
    span = np.ptp(view.u_px) * PIXEL_MM / np.cos(np.radians(50.0))
    assert np.ptp(found["mirror_x_mm"]) == pytest.approx(span)
    assert np.ptp(found["mirror_y_mm"]) == pytest.approx(np.ptp(view.v_px) * PIXEL_MM)
    assert found["lcd_px_per_camera_px"] == pytest.approx([PIXEL_MM / 0.063] * 2)
    assert found["sees_lcd_share"] == 1.0
    assert found["lost_share"] == {}


def test_lost_rays_are_counted_by_reason():
    # parallel rays over 1.5 times the 60 mm of the camera face
    view = SampledView(telecentric(pixel_mm=90.0 / 320, display={"columns": 3000, "rows": 2000}))
    found = field_of_view(view)
    lost = found["lost_share"]
    assert sum(lost.values()) + found["sees_lcd_share"] == pytest.approx(1.0)
    assert max(lost, key=lost.__getitem__) == "misses_camera_face"


def test_a_saw_whose_teeth_were_left_out_shows_as_a_thick_prism():
    saw = load_rig("thin")
    thick = saw.replace({"prism.teeth": None})
    found = [field_of_view(SampledView(rig)) for rig in (saw, thick)]
    assert [one["teeth"] for one in found] == [10, None]
    # a triangle with both angles of 41 degrees is half its base times their tangent high
    high = np.tan(np.radians(41.0)) / 2
    assert [one["thickness_mm"] for one in found] == pytest.approx([3.395 + 8.3 * high, 83.0 * high])
