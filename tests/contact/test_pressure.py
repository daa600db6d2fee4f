"""Pressure inside a contact from the slopes around it, against closed forms."""

from __future__ import annotations

from dataclasses import asdict

import numpy as np
import pytest
from planted_dents import (
    DENTS,
    E_STAR,
    POISSON,
    RADIUS_MM,
    ball,
    outwards,
    punch,
    rig,
    round_contact,
    surface,
)

from zeromethod import InputError, load_rig
from zeromethod.contact import Contact, PressureMap, evenly, pressure_map
from zeromethod.mechanics.yielding import Layer
from zeromethod.recording.columns import CONTACTS, OUTLINE_POINTS, row_dtype

DEPTH_MM = 0.02


def pressure(name: str) -> tuple[PressureMap, float, np.ndarray]:
    """The map of a dent's pressure; its force; pressure on nine rings from the middle, over the mean."""
    dent, depth_per = DENTS[name]
    force_n = DEPTH_MM * E_STAR * RADIUS_MM / depth_per
    found = pressure_map(rig(), surface(outwards(dent, DEPTH_MM), (2.0, -1.0)), [round_contact(2.0, -1.0)])
    return found, force_n, found.pressure_mpa.reshape(9, -1).mean(axis=1) * found.area_mm2.sum() / force_n


def test_a_balls_pressure_has_its_maximum_and_its_sum():
    """Hertz: 3/2 of the mean in the middle; Johnson 1985, 4.22."""
    found, force_n, _ = pressure("ball")
    assert found.force_n == pytest.approx(force_n, rel=0.01)
    largest = 1.5 * force_n / (np.pi * RADIUS_MM**2)
    assert found.pressure_mpa.max() == pytest.approx(largest, rel=0.05)
    assert not found.sticks
    rho = np.hypot(found.x_mm - 2.0, found.y_mm + 1.0) / RADIUS_MM
    hertz = largest * np.sqrt(np.maximum(1 - rho**2, 0.0))
    assert np.mean(np.abs(found.pressure_mpa - hertz) > 2 * found.sigma_mpa) < 0.05


@pytest.mark.parametrize(
    ("name", "middle", "border"), [("punch", (0.4, 0.6), (3.5, 4.3)), ("cone", (1.6, 5.0), (0.0, 0.4))]
)
def test_where_a_punch_and_a_cone_press_most_is_seen_from_outside(name, middle, border):
    """0.5 and 2.6 times the mean near the middle, 3.9 and 0.1 times beside the rim."""
    found, force_n, rings = pressure(name)
    assert found.force_n == pytest.approx(force_n, rel=0.01)
    assert middle[0] <= rings[1] <= middle[1]
    assert border[0] <= rings[-2] <= border[1]
    assert (found.pressure_mpa > -1e-9).all()
    assert not found.sticks


@pytest.mark.parametrize("name", list(DENTS))
def test_what_may_press_otherwise_is_in_sigma(name):
    """Of a tip nothing is seen around it: a ball's map does not exclude a cone's."""
    found, force_n, _ = pressure(name)
    rho = np.hypot(found.x_mm - 2.0, found.y_mm + 1.0) / RADIUS_MM
    within = rho < 0.95
    shapes = {
        "ball": 1.5 * np.sqrt(np.maximum(1 - rho**2, 0.0)),
        "punch": 0.5 / np.sqrt(np.maximum(1 - rho**2, 0.01)),
        "cone": np.arccosh(np.maximum(1 / rho, 1.0)),
    }
    true = shapes[name] * force_n / (np.pi * RADIUS_MM**2)
    z = ((found.pressure_mpa - true) / found.sigma_mpa)[within]
    assert np.sqrt(np.mean(z**2)) < 1.5
    assert np.abs(z).max() < 3


def jkr(force_n: float, pull: float) -> tuple[PressureMap, np.ndarray, np.ndarray]:
    """The map of a ball's pressure with a flat punch's of some part of the force off; the true one; where.

    Within 0.92 of the radius: at the border it is infinite, and a percent of the radius is open.
    """
    pushes, pulls = (
        outwards(dent, depth_per * part * force_n / (E_STAR * RADIUS_MM))
        for (dent, depth_per), part in ((DENTS["ball"], 1 + pull), (DENTS["punch"], pull))
    )
    pressed = surface(lambda r: pushes(r) - pulls(r), (2.0, -1.0))
    found = pressure_map(rig(), pressed, [round_contact(2.0, -1.0)])
    depth2 = 1 - (np.hypot(found.x_mm - 2.0, found.y_mm + 1.0) / RADIUS_MM) ** 2
    within = depth2 > 0.15
    steep = np.sqrt(np.maximum(depth2, 0.15))
    return found, force_n / (np.pi * RADIUS_MM**2) * (1.5 * (1 + pull) * steep - 0.5 * pull / steep), within


@pytest.mark.parametrize("force_n", [0.005, 0.1])
def test_a_ball_that_sticks_pulls_at_its_border(force_n):
    """Johnson, Kendall & Roberts 1971."""
    found, true, within = jkr(force_n, pull=1.0)
    assert found.sticks
    assert found.force_n == pytest.approx(force_n, rel=0.03)
    # 2.5 of the mean pressure; a tenth of the force by a punch in place of a ball changes that by 4 %
    assert found.pressure_mpa[:40].mean() == pytest.approx(true[:40].mean(), rel=0.1)
    assert np.mean((np.abs(found.pressure_mpa - true) > 2 * found.sigma_mpa)[within]) < 0.05
    assert (found.pressure_mpa[~within] < 0).all()


def test_a_pull_too_weak_to_be_sure_of_is_within_sigma():
    found, true, within = jkr(0.03, pull=0.3)
    assert not found.sticks
    # all of it is off together
    assert np.abs((found.pressure_mpa - true) / found.sigma_mpa)[within].max() < 3


def test_a_border_that_is_too_wide_makes_no_contact_stick():
    for name in ("ball", "cone"):
        dent, depth_per = DENTS[name]
        pressed = surface(outwards(dent, 0.1 * depth_per / (E_STAR * RADIUS_MM)), (2.0, -1.0))
        assert not pressure_map(rig(), pressed, [round_contact(2.0, -1.0, 1.03 * RADIUS_MM)]).sticks


def test_what_is_open_of_the_body_is_not_taken_for_pressure():
    """A layer of 20 mm that is said to be 22 +- 2 mm thick."""
    force_n, said = 0.05, {"support": "bonded", "thickness_mm": 22.0, "thickness_sigma_mm": 2.0}
    layer, other = Layer(20.0, POISSON, True), lambda r: force_n * E_STAR**-1 / np.pi
    hertz = outwards(ball, 0.75 * force_n / (E_STAR * RADIUS_MM))
    pressed = surface(lambda r: hertz(r) + other(r) * layer.slope_outwards(r), (0.0, 0.0))
    found = pressure_map(rig(**said), pressed, [round_contact()])
    largest = 1.5 * force_n / (np.pi * RADIUS_MM**2)
    assert found.pressure_mpa.max() == pytest.approx(largest, rel=0.1)
    assert found.force_n == pytest.approx(force_n, rel=0.03)


def recorded(*contacts: Contact) -> np.ndarray:
    """Rows of a recording's table, with its 64 points of the border."""
    rows = np.zeros(len(contacts), row_dtype(CONTACTS))
    for row, contact in zip(rows, contacts, strict=True):
        for name, value in asdict(contact.figures).items():
            row[name] = value
        row["outline_mm"] = evenly(contact.outline_mm, OUTLINE_POINTS)
    return rows


def test_rows_of_a_recording_make_the_map_of_the_steps_contacts():
    """Borders are kept as 64 points in single precision: chords are shorter by a thousandth."""
    pressed, one = surface(outwards(ball, DEPTH_MM), (0.0, 0.0)), round_contact()
    live, kept = (pressure_map(rig(), pressed, each) for each in ([one], recorded(one)))
    assert kept.pressure_mpa.max() == pytest.approx(live.pressure_mpa.max(), rel=0.01)
    assert kept.force_n == pytest.approx(live.force_n, rel=0.001)


def test_there_is_no_map_of_a_pull_or_without_a_modulus():
    pulled = surface(outwards(punch, -0.01), (0.0, 0.0))
    with pytest.raises(InputError, match="the contact pulls"):
        pressure_map(rig(), pulled, [round_contact()])
    with pytest.raises(InputError, match=r"rubber\.youngs_modulus_mpa"):
        pressure_map(load_rig("simulated").replace({"rubber": {}}), pulled, [round_contact()])


def test_what_is_no_rig_surface_or_contact_is_refused_by_name():
    pressed, one = surface(outwards(ball, DEPTH_MM), (0.0, 0.0)), round_contact()
    for given, words in (
        (("nowhere.toml", pressed, [one]), "nowhere.toml"),
        ((rig(), None, [one]), "surface: NoneType"),
        ((rig(), pressed, []), "contacts: nothing touches"),
        ((rig(), pressed, None), "contacts: a step's"),
        ((rig(), pressed, np.zeros(1, [("x_mm", "f8")])), "contacts: a step's"),
        ((rig(), pressed, recorded()), "contacts: nothing touches"),
        ((rig(), pressed, [one], 1), "number: 1: from 0 to 0"),
        ((rig(), pressed, [one], -1), "number: -1: from 0 to 0"),
    ):
        with pytest.raises(InputError, match=words):
            pressure_map(*given)
