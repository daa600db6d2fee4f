"""Contacts of a run in its summary, beside the true ones."""

import math
from dataclasses import replace

import numpy as np
import pytest
from small_rigs import HALF_LCD

from zeromethod import Session, binned, export_recording, load_rig, open_recording, report
from zeromethod.session.contact_figures import force_figures
from zeromethod.view.live import contact_words
from zeromethod.view.table import summary_table


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    return tmp_path_factory.mktemp("contacts") / "punch.h5"


@pytest.fixture(scope="module")
def session(recording):
    view = {"camera.columns": 480, "camera.rows": 384, "camera.centre_px": [239.5, 191.5]}
    rig = binned(load_rig("simulated"), 2).replace(
        {**HALF_LCD, **view, "camera.pupil_mm": 1.25}, scenario="punch"
    )
    with Session(rig, record=recording) as session:
        for _ in session.run(seconds=0.5):
            pass
    return session


def test_the_summary_has_each_contact_once_beside_the_true_one(session):
    figures = session.figures
    (read,), (true,) = figures["contacts"], figures["truth"]["contacts"]
    assert (read["id"], true["id"]) == (1, 1)
    assert read["area_mm2"] == pytest.approx(true["area_mm2"], rel=0.05)
    assert (read["x_mm"], read["y_mm"]) == pytest.approx((true["x_mm"], true["y_mm"]), abs=0.03)
    assert true["force_n"] == pytest.approx(2 * 1.5 * 0.03 / (1 - 0.49**2), rel=3e-3)
    # 1 %: pixels twice as large, and half of the frames come while the press still moves
    assert read["force_n"] == pytest.approx(true["force_n"], rel=0.01)
    assert abs(read["force_n"] - true["force_n"]) < 3 * read["sigma_force_n"]
    assert figures["force"]["force_n"] == pytest.approx(read["force_n"], rel=0.01)
    # from its second frame on, until the end
    assert read["from_s"] == pytest.approx(0.32, abs=0.04)
    assert read["to_s"] > 0.45
    assert read["frames"] >= 7


def test_table_and_live_line_say_so(session):
    cells = list(summary_table(session.figures).columns[0].cells)
    assert "contact 1" in cells
    assert "true contact 1" in cells
    touching = next(record.touching for record in reversed(session.result.records) if record.touching)
    force = f"{touching[0].force_n:.3f} N"
    assert contact_words(touching) == f"contact 1 of {touching[0].area_mm2:.2f} mm², {force}"
    assert contact_words((replace(touching[0], force_n=math.nan),)).endswith(" mm²")
    assert contact_words(touching * 2).startswith("2 contacts of ")
    assert contact_words(()) == ""


def test_where_no_force_is_read_the_table_says_why(session):
    figures = session.figures
    (contact,) = figures["contacts"]
    unknown = {name: None for name in contact if "force" in name or "torque" in name}
    reason = force_figures(session.result.records, session.rig.replace({"rubber": {}}))
    table = summary_table(figures | {"contacts": [contact | unknown], "force": reason})
    words = dict(zip(*(column.cells for column in table.columns), strict=True))
    assert words["contact 1"].endswith(" deep")
    assert words["force"] == "not read: the rig file has no rubber.youngs_modulus_mpa"


def test_recording_and_export_keep_every_contact_with_its_border(session, recording, tmp_path):
    with open_recording(recording) as kept:
        contacts, peaks = kept.contacts, kept.peaks
    areas = [one.area_mm2 for record in session.result.records for one in record.touching]
    np.testing.assert_array_equal(contacts["area_mm2"], areas)
    forces = [one.force_n for record in session.result.records for one in record.touching]
    np.testing.assert_array_equal(contacts["force_n"], forces)
    totals = peaks["total_force_n"][np.isin(peaks["step"], contacts["step"])]
    np.testing.assert_allclose(totals, forces, rtol=1e-9)
    assert set(contacts["id"]) == {1}
    x, y = np.moveaxis(contacts["outline_mm"].astype(float), -1, 0)
    polygon = 0.5 * np.sum(x * np.roll(y, -1, axis=1) - np.roll(x, -1, axis=1) * y, axis=1)
    # 64 corners of a circle lack 2 pi^2 / 3 / 64^2 = 0.2 % of its area
    np.testing.assert_allclose(polygon, areas, rtol=4e-3)
    export_recording(recording, tmp_path / "punch.npz")
    with np.load(tmp_path / "punch.npz") as exported:
        np.testing.assert_array_equal(exported["contacts"], contacts)


def test_the_report_names_the_contact_and_draws_its_border(session, recording, tmp_path):
    figures = report(recording, tmp_path / "punch.html")
    (one,) = figures["contacts"]
    (read,) = session.figures["contacts"]
    assert one["area_mm2"] == pytest.approx(read["area_mm2"], rel=0.02)
    text = (tmp_path / "punch.html").read_text()
    assert "contact 1" in text
    assert f"{one['force_n']:.4f} ± {one['sigma_force_n']:.4f} N" in text
