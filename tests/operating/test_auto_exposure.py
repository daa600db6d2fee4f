"""The exposure follows the light of simulated runs, as recorded calls, and spoils no reading."""

from collections.abc import Iterator
from contextlib import contextmanager
from itertools import pairwise

import numpy as np
from recorded_run import small_rig

from zeromethod import Session, Step, open_devices
from zeromethod.loop.call import Call
from zeromethod.loop.state import NULLED
from zeromethod.operating.auto_exposure import EVERY_S, MOST_LONGER, SOURCE, WITHIN, AutoExposure
from zeromethod.operating.run_controls import RunControls
from zeromethod.session.summary import summarise


@contextmanager
def followed(
    folder, seconds, scenario="none", *, settable=True, said=None, **light
) -> Iterator[tuple[Iterator[Step], list[Call]]]:
    """Steps of a run with its exposure left to follow the light, and the calls of its methods.

    said: gets what the run's summary says of it.
    """
    rig = small_rig(scenario).replace({f"light.{key}": value for key, value in light.items()})
    with open_devices(rig) as devices, Session(rig, devices=devices) as session:
        calls: list[Call] = []
        session.note_call = calls.append
        devices.camera.exposure_settable = settable
        run = RunControls(session, devices, folder)
        exposure = AutoExposure(rig, run.controls)
        session.loop.on_wait = run.controls.attend

        def steps() -> Iterator[Step]:
            for step in session.run(seconds=seconds):
                exposure.see(step)
                yield step

        yield steps(), calls
        session.result.exposure = exposure.figures
        if said is not None:
            said.append(summarise(session.result)["auto_exposure"])


def test_a_dim_lcd_is_exposed_longer_step_by_step_until_a_frame_has_no_more(tmp_path):
    said = []
    with followed(tmp_path, 2.5, said=said, brightness=0.4) as (steps, calls):
        lengths = [step.exposure_ns for step in steps if step.exposure_ns]
    wanted = {"exposure_ms": lengths[-1] / 1e6, "changes": len(calls)}
    assert said == [wanted | {"reason": "more light is wanted than a whole frame brings"}]
    assert lengths[0] == 8_000_000
    assert 1e9 / 60 / WITHIN < lengths[-1] <= 1e9 / 60 * (1 + 1e-6)
    changes = [(a, b) for a, b in pairwise(lengths) if a != b]
    assert 3 <= len(changes) <= 2.5 / EVERY_S
    assert all(b <= MOST_LONGER * a * (1 + 1e-6) for a, b in changes)
    assert [call.source for call in calls] == [SOURCE] * len(changes)
    assert {call.outcome for call in calls} == {"done"}


def test_no_frame_saturates_and_nothing_is_named_while_the_exposure_follows(tmp_path):
    """A press comes and stays under clouds: nulled readings within their sigma, no contact."""
    beyond, full, lengths = [], 0.0, set()
    with followed(tmp_path, 2.5, "hold", sun=3.0, cloud_s=4.0, brightness=0.6) as (steps, _):
        for step in steps:
            if step.image is None:
                continue
            lengths.add(step.exposure_ns)
            if len(lengths) > 1:
                full = max(full, float(np.mean(step.image == 255)))
            assert not step.contacts
            if step.truth is not None and step.state in NULLED:
                error = abs(step.truth.depth_peak_error_percent)
                beyond.append(error / step.truth.depth_peak_error_sigma_percent)
    assert len(lengths) > 2
    assert full < 0.002
    # with the exposure as it was 1 of 135 peaks is beyond 3 sigma, and their rms is 1.12
    assert len(beyond) > 30
    assert np.mean(np.array(beyond) > 3) < 0.02
    assert np.sqrt(np.mean(np.square(beyond))) < 1.25


def test_a_camera_that_refuses_is_not_asked_again(tmp_path):
    with followed(tmp_path, 2.0, brightness=0.4, settable=False) as (steps, calls):
        assert {step.exposure_ns for step in steps} <= {0, 8_000_000}
    (call,) = calls
    assert "cannot change it during a run" in call.outcome
