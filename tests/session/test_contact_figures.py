"""Contacts of a run in its summary, beside the true ones."""

import pytest

from zeromethod import Session, binned, load_rig
from zeromethod.view.live import contact_words
from zeromethod.view.table import summary_table


@pytest.fixture(scope="module")
def session():
    rig = binned(load_rig("simulated"), 2).replace({"camera.pupil_mm": 1.25}, scenario="punch")
    with Session(rig) as session:
        for _ in session.run(seconds=0.5):
            pass
        yield session


def test_the_summary_has_each_contact_once_beside_the_true_one(session):
    figures = session.figures
    (read,), (true,) = figures["contacts"], figures["truth"]["contacts"]
    assert (read["id"], true["id"]) == (1, 1)
    assert read["area_mm2"] == pytest.approx(true["area_mm2"], rel=0.05)
    assert (read["x_mm"], read["y_mm"]) == pytest.approx((true["x_mm"], true["y_mm"]), abs=0.03)
    assert true["force_n"] == pytest.approx(2 * 1.5 * 0.03 / (1 - 0.49**2), rel=3e-3)
    # from its second frame on, until the end
    assert read["from_s"] == pytest.approx(0.32, abs=0.04)
    assert read["to_s"] > 0.45
    assert read["frames"] >= 10


def test_table_and_live_line_say_so(session):
    cells = list(summary_table(session.figures).columns[0].cells)
    assert "contact 1" in cells
    assert "true contact 1" in cells
    touching = next(record.touching for record in reversed(session.result.records) if record.touching)
    assert contact_words(touching) == f"contact 1 of {touching[0].area_mm2:.2f} mm²"
    assert contact_words(touching * 2).startswith("2 contacts of ")
    assert contact_words(()) == ""
