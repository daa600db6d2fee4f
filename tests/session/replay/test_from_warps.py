"""Reading again what was recorded."""

from collections.abc import Iterator

import numpy as np
import pytest
from recorded_run import recorded

from benchmarks.against_peers.open_loop import coarser
from zeromethod import InputError, Optics, Recording, Session, SurfaceReader, load_rig, peak
from zeromethod.recording import DamagedWarning
from zeromethod.session.dirt import FRAMES, DirtCorrection
from zeromethod.session.replay.differences import DepthDifferences
from zeromethod.session.replay.from_warps import replay_from_warps
from zeromethod.session.replay.settings import with_settings
from zeromethod.session.replay.window import Window
from zeromethod.view.replay_table import differences_table

KNOWN_REST = "surface.known_rest=[{x_mm=[8.0, 20.0], y_mm=[-18.0, 18.0]}]"


@pytest.fixture(scope="module")
def whole(session) -> Iterator[DepthDifferences]:
    with Recording(session.path) as opened:
        yield replay_from_warps(opened, opened.rig, Window.of(opened))


def test_unchanged_readings_are_the_recorded_ones_bit_for_bit(session, whole):
    again = whole
    assert again.steps == len(session.readings) > 40
    assert again.different == []
    assert again.depth.largest == again.peak.largest == 0.0
    # and these are what the run itself had, before anything was rounded
    assert again.replayed_mm == [peak.depth_mm for _, peak in session.readings.values()]


def test_what_dirt_does_is_taken_off_again(tmp_path):
    path = tmp_path / "dirt.h5"
    rig = coarser(load_rig("simulated").replace({"simulation.nuisances.dust": 60}, scenario="none"), 8)
    with Session(rig, record=path) as run:
        list(run.run(frames=FRAMES + 8))
        assert run._dirt._off is not None
    with Recording(path) as opened:
        again = replay_from_warps(opened, opened.rig, Window.of(opened))
        assert again.steps > FRAMES
        assert again.different == []


def deeper_by(depth_mm: float, session, recording) -> tuple[int, DepthDifferences]:
    """First step that was read, and its reading held against one that much deeper."""
    again = DepthDifferences(recording, 0)
    step, (surface, deepest) = next(iter(session.readings.items()))
    surface.depth_mm[surface.valid] += depth_mm
    again.add(step, surface, deepest)
    surface.depth_mm[surface.valid] -= depth_mm
    return step, again


def test_a_reading_that_differs_is_reported(session, recording):
    step, again = deeper_by(1e-6, session, recording)
    assert again.different == [step]
    assert again.depth.largest == pytest.approx(1e-6, rel=1e-3)


def test_other_surface_settings_read_as_a_reader_with_them_does(recording):
    rig = with_settings(recording.rig, [KNOWN_REST])
    again = replay_from_warps(recording, rig, Window.of(recording, None, 0.4))
    assert len(again.different) == again.steps
    reader, dirt = SurfaceReader(rig, Optics(rig), recording.grid), DirtCorrection(recording.rest.q)
    expected = []
    for step in recording.peaks["step"][: again.steps].tolist():
        state = recording.state_of(recording.row(step))
        warp = dirt.corrected(recording.measured(step), state, recording.zero(step))
        expected.append(peak(reader.follow(warp)).depth_mm)
    assert again.replayed_mm == expected


def test_a_part_is_read_as_within_the_whole_and_reported_alone(recording, whole):
    times: list[float] = []
    part = replay_from_warps(recording, recording.rig, Window.of(recording, 0.3, 0.6), on_step=times.append)
    assert 15 < part.steps < 20
    assert min(part.time_s) >= 0.3
    assert max(part.time_s) <= 0.6
    assert part.different == []
    assert set(part.replayed_mm) <= set(whole.replayed_mm)
    # what comes before is read as well: a reader remembers
    assert times[-part.steps :] == pytest.approx(part.time_s)
    assert times == sorted(times)
    assert times[0] < 0.1


def test_every_third_warp_can_be_read(session, tmp_path):
    path = recorded(tmp_path / "r.h5", 0.3, rig=session.rig, keep=("warps", "surface"), every=3)
    with Recording(path) as opened:
        again = replay_from_warps(opened, opened.rig, Window.of(opened))
        assert 3 <= again.steps <= len(opened.peaks) / 2
        assert np.isfinite(again.replayed_mm).all()


@pytest.mark.parametrize(
    ("setting", "word"), [("camera.bits=12", "camera.bits: 12"), ("target.contrast=0.5", "target")]
)
def test_what_was_photographed_cannot_be_changed(recording, setting, word):
    with pytest.raises(InputError, match=word):
        replay_from_warps(recording, with_settings(recording.rig, [setting]), Window.of(recording))


def test_other_geometry_gives_other_rays(recording):
    rig = with_settings(recording.rig, ["display.centre_mm=[30.0, 0.5]"])
    again = replay_from_warps(recording, rig, Window.of(recording, 0.4, 0.5))
    assert len(again.different) == again.steps


def cells(figures: dict) -> dict[str, list[str]]:
    """Rows of the table by their label."""
    columns = [[str(cell) for cell in column.cells] for column in differences_table(figures).columns]
    return {label: rest for label, *rest in zip(*columns, strict=True)}


def test_what_is_damaged_is_counted_and_kept_out_of_the_shares(session, whole, damaged):
    steps = list(session.readings)
    # the newest, so that all readings before are those of a reader that saw all
    path = damaged("warps/measured/q", *steps[-2:])
    damaged("surface/slope", *steps[3:6])
    damaged("surface/depth_mm", steps[5])
    with Recording(path) as opened:
        with pytest.warns(DamagedWarning):
            again = replay_from_warps(opened, opened.rig, Window.of(opened))
        early = replay_from_warps(opened, opened.rig, Window.of(opened, None, 0.5))
    figures, undamaged = again.figures, whole.figures
    assert (figures["readings_damaged"], figures["surfaces_damaged"]) == (2, 3)
    assert figures["readings"] == undamaged["readings"] - 2
    assert again.different == []
    assert figures["read_share"]["recorded"] == figures["read_share"]["replayed"] > 0.9
    # a part counts its own
    assert (early.readings_damaged, early.surfaces_damaged) == (0, 3)
    table = cells(figures)
    assert table["left out as damaged: readings"][0] == "2"
    assert table["left out as damaged: surfaces"][0] == "3"
    assert not any("damaged" in label for label in cells(undamaged))


def test_where_all_warps_are_damaged_it_is_reported(session, damaged):
    path = damaged("warps/measured/sigma", *session.readings)
    found = f"all {len(session.readings)} warps are damaged"
    with Recording(path) as opened, pytest.warns(DamagedWarning), pytest.raises(InputError, match=found):
        replay_from_warps(opened, opened.rig, Window.of(opened))


def test_differences_over_all_nodes_are_not_the_peaks(session, recording):
    _, again = deeper_by(1e-5, session, recording)
    figures = again.figures
    assert figures["depth_difference_rms_nm"] == pytest.approx([10.0], rel=1e-2)
    assert set(figures["peaks"]) == {"time_s", "recorded_mm", "replayed_mm"}
