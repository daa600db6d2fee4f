import json

import numpy as np
import pytest

from benchmarks.rigs import changed, pressed, small_rig
from zeromethod import InputError, Session, load_rig
from zeromethod.errors import MeasurementError
from zeromethod.fine.integrate import PixelIntegrator
from zeromethod.session.fine import STEP, with_moving_target
from zeromethod.session.summary import summarise

NARROW_MM = 1.2


def test_a_run_reads_every_pixel_of_a_dent_that_its_nodes_smear():
    rig = small_rig(4)
    with pressed(rig, [(0.1, 0.0), (0.12, 8e-3)], NARROW_MM) as narrow, Session(narrow, fine=True) as session:
        surfaces = [step.fine for step in session.run(frames=60) if step.fine is not None]
        figures = summarise(session.result)["fine"]
    # pixels of 0.2 mm see a dent of 1.2 mm; their noise is 0.1 um, and nodes every 1.6 mm see nearly none
    assert len(surfaces) == figures["surfaces"] >= 1
    assert figures["depth_peak_mm"] == pytest.approx(8e-3, rel=0.05)
    assert abs(figures["truth"]["depth_peak_error_percent"]) < 5.0
    assert figures["truth"]["depth_rms_error_um"] < 0.3
    assert (figures["rows"], figures["cols"]) == surfaces[-1].depth_mm.shape
    assert np.mean(surfaces[-1].valid) > 0.95
    json.dumps(figures)


def test_coded_strips_do_not_enter():
    """As every real device has them; read with their codes, depth at rest was off by micrometres."""
    with Session(
        changed(small_rig(4), control={"strips": "edges"}).replace(scenario="none"), fine=True
    ) as session:
        surfaces = [step.fine for step in session.run(frames=30) if step.fine is not None]
    for one in surfaces:
        z = (one.depth_mm / one.sigma_depth_mm)[one.valid]
        assert np.sqrt(np.mean(one.depth_mm[one.valid] ** 2)) < 1e-4
        # a few smooth waves make most of one surface's error
        assert np.sqrt(np.mean(z**2)) < 2.0
    assert surfaces


def test_a_depth_that_is_not_found_is_no_surface_and_said(monkeypatch):
    def unsolved(*_):
        raise MeasurementError("not solved")

    monkeypatch.setattr(PixelIntegrator, "solve", unsolved)
    with Session(small_rig(4).replace(scenario="none"), fine=True) as session:
        steps = list(session.run(frames=30))
    assert all(step.fine is None for step in steps)
    assert any("fine surface is left out: not solved" in note for step in steps for note in step.notes)


def test_without_it_the_target_stands_and_nothing_fine_is_read():
    with Session(small_rig(4)) as session:
        assert session.rig.target.step == 0
        assert all(step.fine is None for step in session.run(frames=3))
        assert summarise(session.result)["fine"] is None


def test_the_target_moves_as_far_as_the_rig_says_or_by_sixteenths():
    rig = load_rig("simulated")
    assert with_moving_target(rig).target.step == STEP
    assert with_moving_target(changed(rig, target={"step": 20})).target.step == 20


def test_a_target_without_two_carriers_is_refused():
    with pytest.raises(InputError, match="cosines"):
        with_moving_target(changed(load_rig("simulated"), target={"kind": "checker"}))
