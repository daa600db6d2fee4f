"""Forces read around contacts, against closed forms of dents and of a layer."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from planted_dents import (
    DENTS,
    E_MPA,
    E_STAR,
    NOISE,
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
from zeromethod.arrays import Float
from zeromethod.contact import ForceReader
from zeromethod.contact.adhesion import work_of_adhesion
from zeromethod.contact.force_fit import ForceFit
from zeromethod.contact.load_fields import load_fields
from zeromethod.contact.loads import Loads
from zeromethod.mechanics.layer import wave_share
from zeromethod.optics.prism import PrismGeometry
from zeromethod.rig.tables import Rubber
from zeromethod.simulation.contact.compliance import Compliance, layer_factor


@pytest.mark.parametrize("name", list(DENTS))
def test_the_force_of_each_closed_form_dent_is_read_within_its_sigma(name):
    dent, depth_per = DENTS[name]
    depth_mm = 0.02
    force_n = depth_mm * E_STAR * RADIUS_MM / depth_per
    reader = ForceReader(rig())
    contacts, total = reader.read(surface(outwards(dent, depth_mm), (2.0, -1.0)), [round_contact(2.0, -1.0)])
    (found,) = contacts
    # beside the border cells stand for a pressure: 0.3 % of slopes there is in sigma
    assert abs(found.force_n - force_n) < 3 * found.sigma_force_n < 0.01 * force_n
    assert total.force_n == pytest.approx(found.force_n, rel=1e-9)
    assert abs(found.torque_y_nmm) < 3 * found.sigma_torque_y_nmm


def test_frames_forces_scatter_as_their_sigma_says():
    """Of a force so small that noise is nearly all of its sigma; 60 frames know theirs to a tenth."""
    reader, contact = ForceReader(rig()), [round_contact()]
    read = [
        reader.read(surface(outwards(ball, 0.0005), (0.0, 0.0), seed=seed), contact)[0][0]
        for seed in range(60)
    ]
    scatter = np.std([one.force_n for one in read], ddof=1)
    assert 0.8 < scatter / read[-1].sigma_force_n < 1.25


def test_later_frames_are_read_by_the_first_ones_kernels_until_a_contact_moves(monkeypatch):
    made, make = [], ForceFit.of
    monkeypatch.setattr(ForceFit, "of", lambda *given: made.append(given) or make(*given))
    reader, force = ForceReader(rig()), {}
    for seed, x_mm in ((3, 0.0), (4, 0.01), (5, 2.0)):
        pressed, contact = surface(outwards(ball, 0.02), (x_mm, 0.0), seed=seed), [round_contact(x_mm)]
        force[seed] = reader.read(pressed, contact)[0][0].force_n
        (own,), _ = ForceReader(rig()).read(pressed, contact)
        # moved by a border's own sigma: hundredths of a percent
        assert force[seed] == pytest.approx(own.force_n, rel=5e-4)
    # each frame's own reader makes its kernels, too
    assert len(made) == 2 + 3


def test_forces_of_contacts_side_by_side_are_told_apart_and_their_sum_is_known_better():
    force_n = 0.02 * E_STAR * RADIUS_MM / 0.75
    middles = (-1.25, 0.0), (1.25, 0.0)
    pressed = surface(outwards(ball, 0.02), *middles)
    (one, other), total = ForceReader(rig()).read(pressed, [round_contact(*middle) for middle in middles])
    for found in (one, other):
        assert found.force_n == pytest.approx(force_n, rel=0.02)
    assert total.force_n == pytest.approx(2 * force_n, rel=0.005)
    assert total.sigma_n / total.force_n < one.sigma_force_n / one.force_n


def test_a_pull_has_the_opposite_sign_of_a_push():
    """A flat punch that is pulled makes the dent of one that is pressed, upwards."""
    contacts, total = ForceReader(rig()).read(surface(outwards(punch, -0.01), (0.0, 0.0)), [round_contact()])
    assert contacts[0].force_n == pytest.approx(-0.01 * E_STAR * RADIUS_MM / 0.5, rel=0.01)
    # as far as pulls were compared with true ones
    assert contacts[0].sigma_force_n == pytest.approx(0.04 * abs(contacts[0].force_n), rel=0.05)
    assert total.sigma_n == pytest.approx(contacts[0].sigma_force_n, rel=1e-9)


@pytest.mark.parametrize("axis", [0, 1])
def test_the_torque_of_a_tilted_punch_is_read_with_its_sign(axis):
    """Tilted by t it needs 4/3 E* a^3 t. Source: Johnson 1985, 5.5; Lur'e 1964."""
    tilt, a = 0.005, RADIUS_MM
    pressed = surface(outwards(punch, 0.02), (0.0, 0.0))
    r, along = np.maximum(np.hypot(pressed.x_mm, pressed.y_mm), a), (pressed.x_mm, pressed.y_mm)
    g = 2 / np.pi * (np.arcsin(a / r) - a / r * np.sqrt(1 - (a / r) ** 2))
    by_r = -4 / np.pi * a**3 / (r**3 * np.maximum(np.sqrt(r**2 - a**2), 1e-9))
    for k in range(2):
        pressed.slope[..., k] += tilt * (along[axis] * by_r * along[k] / r + (g if k == axis else 0.0))
    (found,), _ = ForceReader(rig()).read(pressed, [round_contact()])
    torque = found.torque_y_nmm if axis == 0 else -found.torque_x_nmm
    assert torque == pytest.approx(4 / 3 * E_STAR * a**3 * tilt, rel=0.01)


@pytest.mark.parametrize("bonded", [True, False])
def test_a_layer_yields_as_its_closed_form_says(bonded):
    """The same physics by the four fields' equations here, by Johnson's formula in the simulated bench."""
    waves = np.geomspace(0.05, 25, 60)
    closed = layer_factor(waves, POISSON, bonded=bonded)
    np.testing.assert_allclose(wave_share(waves, POISSON, bonded=bonded), closed, rtol=1e-9)


def layer_slope(support: str, thickness_mm: float, force_n: float) -> Callable[[Float], Float]:
    layer = Compliance(
        Rubber(youngs_modulus_mpa=E_MPA, poisson=POISSON, support=support, thickness_mm=thickness_mm)
    )
    return lambda r: force_n * (layer.of_force(r + 1e-3) - layer.of_force(r - 1e-3)) / 2e-3


@pytest.mark.parametrize(("support", "low"), [("bonded", 0.05), ("sliding", 0.02)])
def test_a_layers_force_is_read_with_the_layer_and_low_as_a_half_space(support, low):
    slope, contact = layer_slope(support, 20.0, 0.05), [round_contact()]
    pressed = surface(slope, (0.0, 0.0), noise=0.1 * NOISE)
    right, _ = ForceReader(rig(support=support, thickness_mm=20.0)).read(pressed, contact)
    # the table of the bench's layer is linear between its points
    assert right[0].force_n == pytest.approx(0.05, rel=0.003)
    half_space, _ = ForceReader(rig()).read(pressed, contact)
    assert half_space[0].force_n < (1 - low) * 0.05


def test_where_the_rig_does_not_say_what_holds_the_prism_sigma_allows_for_a_bonded_base():
    bench = load_rig("simulated").replace({"rubber": {"youngs_modulus_mpa": E_MPA, "poisson": POISSON}})
    shape = PrismGeometry(bench.prism)
    height_mm = shape.length_mm / 2 * np.tan(shape.pattern_angle_rad)
    pressed = surface(layer_slope("bonded", float(height_mm), 0.05), (0.0, 0.0))
    (found,), _ = ForceReader(bench).read(pressed, [round_contact()])
    (sure,), _ = ForceReader(rig()).read(pressed, [round_contact()])
    assert abs(found.force_n - 0.05) < 2 * found.sigma_force_n
    assert found.sigma_force_n > sure.sigma_force_n


def test_what_is_open_of_modulus_and_thickness_is_in_sigma():
    pressed, contact = surface(outwards(ball, 0.02), (0.0, 0.0)), [round_contact()]
    known, _ = ForceReader(rig()).read(pressed, contact)
    stiff, _ = ForceReader(rig(youngs_modulus_sigma_mpa=0.05 * E_MPA)).read(pressed, contact)
    assert known[0].sigma_force_n < 0.01 * known[0].force_n
    assert stiff[0].sigma_force_n == pytest.approx(0.05 * stiff[0].force_n, rel=0.05)
    layer = {"support": "bonded", "thickness_mm": 20.0}
    thick, _ = ForceReader(rig(**layer)).read(pressed, contact)
    thicker, _ = ForceReader(rig(**layer | {"thickness_mm": 22.0})).read(pressed, contact)
    unsure, _ = ForceReader(rig(**layer, thickness_sigma_mm=2.0)).read(pressed, contact)
    assert abs(thick[0].force_n - thicker[0].force_n) < 2 * unsure[0].sigma_force_n


def test_without_a_modulus_no_force_is_read():
    bench = load_rig("simulated").replace({"rubber": {}})
    contacts, total = ForceReader(bench).read(surface(outwards(ball, 0.02), (0.0, 0.0)), [round_contact()])
    assert np.isnan([contacts[0].force_n, contacts[0].sigma_force_n, total.force_n]).all()


def test_fast_slopes_are_those_of_all_cells():
    loads = Loads.of(round_contact())
    angle = np.linspace(0, 6, 7)
    for away in (1.5, 2.2, 4.0, 9.0):
        at = away * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
        apart = at[:, None] - loads.cells
        pull = -apart / (np.hypot(*np.moveaxis(apart, -1, 0))[..., None] ** 3)
        exact = np.einsum("nck,sc->nks", pull, loads.forces)
        fast = load_fields(loads, at, np.zeros_like(at))[:, 1:]
        # cells have a size, the few forces that stand for them none
        assert np.abs(fast - exact).max() < 2e-3 * np.abs(exact[..., 0]).max()


def test_a_modulus_below_zero_is_refused():
    with pytest.raises(InputError, match="youngs_modulus_mpa"):
        rig(youngs_modulus_mpa=-1.0)


def test_force_and_outline_of_a_ball_that_sticks_give_its_work_of_adhesion():
    """JKR, doi:10.1098/rspa.1971.0141: force and radius of contact planted for 50 mJ/m^2."""
    radius_mm, a, work = 5.0, 0.6, 0.05e-3
    force_n = 4 * E_STAR * a**3 / (3 * radius_mm) - np.sqrt(8 * np.pi * work * E_STAR * a**3)
    contact = replace(
        round_contact(radius_mm=a), force_n=float(force_n), sigma_force_n=1e-4, sigma_area_mm2=1e-3
    )
    found, sigma = work_of_adhesion(contact, radius_mm, E_STAR)
    assert abs(found - 0.05) < 3 * sigma < 0.02
