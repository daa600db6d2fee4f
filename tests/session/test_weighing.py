"""Modulus by a weight: planted forces, as a session reads them, in order and out of order."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from command_line import run
from small_rigs import BENCH_160, small_rig_file

from zeromethod import MeasurementError, load_rig
from zeromethod.loop.state import State, Status
from zeromethod.session.weighing import GRAVITY_M_S2, for_weighing, weigh

E_MPA, GRAMS = 1.6, 20.0
PROVISIONAL_N = 1e-3 * GRAMS * GRAVITY_M_S2 / E_MPA
"""What is read as rubber of 1 MPa."""
NOISE_N = 1e-4


def steps(*forces_n: float, state: State = State.LOCKED, touching: bool = True):
    """60 per second; NaN: nothing touches."""
    draw = np.random.default_rng(0)
    for number, force in enumerate(forces_n):
        yield SimpleNamespace(
            time_s=number / 60, state=state, surface=object(), sigma_total_force_n=0.004 * force,
            touching=(1,) if touching and force > 0 else (), total_force_n=force + draw.normal(0, NOISE_N),
        )  # fmt: skip


REST, HELD = [np.nan] * 40, [PROVISIONAL_N] * 60


def test_the_modulus_makes_the_force_the_weight():
    said = []
    found = weigh(steps(*REST, *np.linspace(0, PROVISIONAL_N, 10)[1:], *HELD), GRAMS, 0.02, 60.0, said.append)
    # of 32 frames of 0.1 mN each, relative to 0.12 N
    assert found.youngs_modulus_mpa == pytest.approx(E_MPA, rel=5e-4)
    # weight 0.1 %, gravity 0.15 %, force 0.4 %
    assert found.sigma_mpa == pytest.approx(E_MPA * 0.0044, rel=0.02)
    assert said == ["put the weight of 20 g on the mirror now, and let go of it"]


@pytest.mark.parametrize(
    ("rows", "words"),
    [
        (steps(*[np.nan] * 90), "nothing was put on the mirror within 1 s"),
        (steps(*[np.nan] * 90, state=State.HOLDING), "the loop did not null the mirror at rest"),
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


@pytest.mark.parametrize(
    ("ended", "code", "words"),
    [
        ({"interrupted": True}, 130, ""),
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
    values = BENCH_160 | {"rubber.youngs_modulus_mpa": 3.0, "rubber.poisson_sigma": 0.01}
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
    assert '"contacts": 1' in (tmp_path / "w.json").read_text()
