import numpy as np
import pytest

from zeromethod import Peak, State
from zeromethod.approach import Approach, Watching
from zeromethod.contact import Contact, Probability
from zeromethod.publishing import ContactEvent
from zeromethod.publishing.message import encode

from .readings import a_step, decoded, dent


def message(step, contacts=()):
    return decoded(encode(step, session="s", unix_time_ns=1234, touching=bool(contacts), contacts=contacts))


def test_the_maps_come_back_with_their_values_and_holes():
    surface, deepest = dent(0.2, time_ns=2**60 + 1)
    _, maps = message(a_step(7, (surface, deepest)))
    for name in ("depth_mm", "sigma_depth_mm", "slope", "x_mm", "y_mm"):
        assert maps[name].dtype == np.dtype("<f4")
        # Half a unit in the last place of a 32-bit float; NaN where nothing was read.
        np.testing.assert_allclose(maps[name], getattr(surface, name), rtol=2**-24, atol=1e-30)
    np.testing.assert_array_equal(maps["valid"], surface.valid)
    np.testing.assert_array_equal(maps["contact"], surface.contact)


def test_the_header_has_time_state_peak_and_where_it_is():
    step = a_step(
        7, dent(0.2), time_ns=2**60 + 1, frame_number=11, dropped=2, residual_rms_px=0.013, valid_share=0.9
    )
    header, _ = message(step)
    found = {name: header[name] for name in ("schema_version", "session", "step", "frame", "time_ns")}
    assert found == {"schema_version": 2, "session": "s", "step": 7, "frame": 11, "time_ns": 2**60 + 1}
    assert header["unix_time_ns"] == 1234
    assert (header["state"], header["reason"]) == ("locked", "as planted")
    assert (header["events"], header["dropped"]) == (["frames dropped"], 2)
    assert (header["residual_rms_px"], header["valid_share"]) == (0.013, 0.9)
    # The dent's middle lies between the nodes; the peak's own fit is within 0.01 %.
    assert header["peak"]["depth_mm"] == pytest.approx(0.2, rel=1e-4)
    assert header["peak"]["x_mm"] == pytest.approx(9.75, abs=1e-3)
    assert header["peak"]["y_mm"] == pytest.approx(7.25, abs=1e-3)
    # the node's, and what the fit may be off by
    assert header["peak"]["depth_sigma_mm"] == pytest.approx(1e-4, rel=1e-3)
    assert header["pose"]["frame_id"] == "zeromethod/P0"
    assert header["pose"]["matrix"] == [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]


def test_a_step_without_a_reading_has_its_state_and_has_no_maps():
    header, maps = message(a_step(3, state=State.FAULT))
    assert header["state"] == "fault"
    assert header["peak"] is None
    assert header["frame"] is None
    assert header["residual_rms_px"] is None  # NaN, which JSON has not
    assert not maps


def test_what_comes_has_its_time_and_place():
    coming = Approach(watching=Watching.COMING, time_ns=5, contact_s=0.25, x_mm=61.0, y_mm=2.0)
    header, _ = message(a_step(3, approach=coming))
    found = header["approach"]
    assert (found["watching"], found["contact_s"], found["x_mm"], found["diameter_mm"]) == (
        "coming",
        0.25,
        61.0,
        None,
    )
    assert message(a_step(3))[0]["approach"] is None


def test_what_touches_has_its_border_and_figures():
    nothing = Probability(0, 0, np.zeros((0, 0), np.float32))
    sizes = {"area_mm2": 3.0, "major_mm": 2.0, "minor_mm": 1.9, "angle_deg": 30.0, "scattered": 0.06}
    sigmas = dict.fromkeys(("sigma_x_mm", "sigma_y_mm", "sigma_area_mm2", "sigma_edge_mm"), 0.01)
    outline = np.array([[9.0, 7.0], [11.0, 7.0], [10.0, 8.12345]])
    contact = Contact(
        id=3, x_mm=10.0, y_mm=7.5, **sizes, **sigmas,
        outline_mm=outline, outline_px=outline, probability=nothing,
    )  # fmt: skip
    header, _ = message(a_step(7, dent(0.2), contacts=(contact,)))
    (found,) = header["in_contact"]
    np.testing.assert_allclose(found.pop("outline_mm"), outline, atol=5e-5)
    unknown = ("depth_mm", "force_n", "torque_x_nmm", "torque_y_nmm")
    unknown = dict.fromkeys((*unknown, *(f"sigma_{name}" for name in unknown)))
    assert (
        found == {"id": 3, "x_mm": 10.0, "y_mm": 7.5, "age_s": 0.0, "leak_mm": 0.0} | sizes | sigmas | unknown
    )
    assert header["total_force_n"] is None
    forces = {"total_force_n": 0.5, "sigma_total_force_n": 0.01}
    header, _ = message(a_step(7, dent(0.2), contacts=(contact,), **forces))
    assert {name: header[name] for name in forces} == forces


def test_what_is_not_known_is_null():
    surface, _ = dent()
    nan = float("nan")
    dark = ContactEvent(4, "began", 17, 1.0, 2.0, nan)
    header, _ = message(a_step(1, (surface, Peak(nan, nan, nan, nan))), [dark])
    assert header["peak"].pop("where") == "measured"
    assert set(header["peak"].values()) == {None}
    place = {"x_mm": 1.0, "y_mm": 2.0, "depth_mm": None}
    assert header["contacts"] == [{"number": 4, "kind": "began", "time_ns": 17} | place]
