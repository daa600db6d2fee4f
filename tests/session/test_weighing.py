"""Modulus by a weight: planted forces, as a session reads them, in order and out of order."""

from __future__ import annotations

import json
from types import SimpleNamespace

import numpy as np
import pytest
from command_line import run
from small_rigs import BENCH_160, small_rig_file

from zeromethod import MeasurementError, load_rig
from zeromethod.loop.state import State, Status
from zeromethod.session.weighing import GRAVITY_M_S2, for_weighing, weigh
from zeromethod.surface import Peak

E_MPA, GRAMS = 1.6, 20.0
PROVISIONAL_N = 1e-3 * GRAMS * GRAVITY_M_S2 / E_MPA
"""What is read as rubber of 1 MPa."""
NOISE_N = 1e-4


def steps(
    *forces_n: float,
    state: State = State.LOCKED,
    unread_from: float = np.inf,
    truth=None,
    dented_from: float = np.inf,
):
    """60 per second; NaN: nothing touches, but from frame `unread_from` on. Dented, from another one on."""
    draw = np.random.default_rng(0)
    for number, force in enumerate(forces_n):
        yield SimpleNamespace(
            time_s=number / 60, state=state, surface=object(), sigma_total_force_n=0.004 * force, truth=truth,
            touching=(1,) if force > 0 or number >= unread_from else (),
            total_force_n=force + draw.normal(0, NOISE_N),
            peak=Peak(0.03 if number >= dented_from else 1e-6, 42.0, 0.0, 1e-5),
        )  # fmt: skip


REST, HELD = [np.nan] * 40, [PROVISIONAL_N] * 60


def test_the_modulus_makes_the_force_the_weight():
    said = []
    found = weigh(steps(*REST, *np.linspace(0, PROVISIONAL_N, 10)[1:], *HELD), GRAMS, 0.02, 60.0, said.append)
    # of 32 frames of 0.1 mN each, relative to 0.12 N
    assert found.youngs_modulus_mpa == pytest.approx(E_MPA, rel=5e-4)
    assert np.isnan(found.true_force_n)
    # weight 0.1 %, gravity 0.15 %, force 0.4 %
    assert found.sigma_mpa == pytest.approx(E_MPA * 0.0044, rel=0.02)
    assert said == ["put the weight of 20 g on the mirror now, and let go of it"]


@pytest.mark.parametrize(
    ("rows", "words"),
    [
        (steps(*[np.nan] * 90), "nothing was put on the mirror within 1 s"),
        (steps(*[np.nan] * 90, state=State.HOLDING), "the loop did not null the mirror at rest"),
        (steps(*[np.nan] * 90, unread_from=40), "no force was read where it touches within 1 s"),
        (steps(*[np.nan] * 40), "nothing was put on the mirror before the run ended"),
        (steps(*[np.nan] * 90, dented_from=40), "dented, but nothing is seen to touch: .* 9 camera pixels"),
        (steps(*[np.nan] * 40, state=State.HOLDING), "null the mirror at rest before the run ended"),
        (steps(*REST, *HELD[:20]), "the force did not keep still before the run ended"),
        (steps(*REST, *[1e4] * 60), "1.96e-05 MPa are no rubber's .* 20 g weigh 0.1962 N.* 1e[+]04 N in"),
        (steps(*HELD), "something touches the mirror already"),
        (steps(*REST, *np.linspace(0.5, 1.5, 90) * PROVISIONAL_N), "the force did not keep still"),
    ],
)
def test_what_is_no_weighing_is_refused(rows, words):
    with pytest.raises(MeasurementError, match=words):
        weigh(rows, GRAMS, 0.02, 1.0, lambda _: None)


def test_a_rig_is_weighed_without_what_its_file_says_of_the_rubber():
    rig = load_rig("simulated").replace({"rubber.youngs_modulus_mpa": 3.0, "rubber.poisson_sigma": 0.01})
    assert for_weighing(rig).rubber == for_weighing(load_rig("simulated")).rubber


def plant(monkeypatch, *forces_n, interrupted=False, status=None):
    class Weighing:
        """A session that reads planted forces, whatever the rig says of its rubber."""

        result, loop = SimpleNamespace(interrupted=interrupted), SimpleNamespace(status=status or Status())

        def __init__(self, rig, devices):
            assert rig.rubber.youngs_modulus_mpa == 1.0

        def __enter__(self):
            return self

        def __exit__(self, *_):
            pass

        def run(self):
            return steps(*forces_n)

    monkeypatch.setattr("zeromethod.cli.calibrate_weight.Session", Weighing)


def test_a_simulated_bench_says_what_truly_pressed():
    truth = SimpleNamespace(contacts=(SimpleNamespace(force_n=0.15), SimpleNamespace(force_n=0.05)))
    assert weigh(steps(*REST, *HELD, truth=truth), GRAMS, 0.02, 60.0, str).true_force_n == pytest.approx(0.2)


@pytest.mark.parametrize(
    ("ended", "code", "words"),
    [
        ({"interrupted": True}, 130, "interrupted: nothing was stored\n"),
        ({"status": Status(State.FAULT, "the camera is lost")}, 1, "weight: the camera is lost"),
    ],
)
def test_a_run_that_ends_before_writes_nothing_and_says_why(tmp_path, monkeypatch, ended, code, words):
    file = small_rig_file(tmp_path / "my.toml", BENCH_160)
    before = file.read_text()
    plant(monkeypatch, *REST, **ended)
    outcome = run("calibrate weight --grams 20 --rig", file)
    assert outcome.code == code
    assert words in outcome.err
    assert file.read_text() == before


def test_what_is_found_is_written_into_the_rig_file(tmp_path, monkeypatch):
    had = {"rubber.youngs_modulus_mpa": 3.0, "rubber.youngs_modulus_sigma_mpa": 0.03}
    values = BENCH_160 | had | {"rubber.poisson": 0.49, "rubber.poisson_sigma": 0.01}
    file = small_rig_file(tmp_path / "my.toml", values)

    plant(monkeypatch, *REST, *HELD)
    outcome = run(
        "calibrate weight --grams 20 --grams-sigma 0.02 --rig", file, "--summary", tmp_path / "w.json"
    )
    assert outcome.code == 0
    assert "Young's modulus 1.6 MPa, sigma 0.007" in outcome.out
    rubber = load_rig(file).rubber
    assert rubber.youngs_modulus_mpa == pytest.approx(E_MPA, rel=1e-3)
    assert rubber.youngs_modulus_sigma_mpa == pytest.approx(E_MPA * 0.0044, rel=0.05)
    assert rubber.poisson_sigma == 0.0
    figures = json.loads((tmp_path / "w.json").read_text())
    assert (figures["contacts"], figures["truth"]) == (1, None)
    # what was open of E / (1 - nu^2): 1 % of E, and 2 nu 0.01 / (1 - nu^2) of Poisson's ratio
    sigma = 3.0 * np.hypot(0.01, 0.98 * 0.01 / (1 - 0.49**2))
    off = (E_MPA - 3.0) / np.hypot(sigma, E_MPA * 0.0044)
    assert figures["before"] == pytest.approx(
        {"youngs_modulus_mpa": 3.0, "sigma_mpa": sigma, "off_sigmas": off}, rel=2e-3
    )
    assert f"was 3 ± 0.049 MPa: now -1.4 MPa, {-off:.1f} of both sigmas" in outcome.out
    assert outcome.err.count("! not the rubber that the rig file had") == 1
