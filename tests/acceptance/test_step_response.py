"""A sudden press of 0.2 mm: locked within two corrections, whatever the clocks do."""

import pytest

from benchmarks import step_response as step


def test_a_step_at_full_size_locks_within_two_corrections():
    response = step.full_size_step(11)
    # 34 ms from mid-exposure to the answer half lit: a refresh or two, half the scan-out, half the exposure
    assert response.delay_frames == pytest.approx(2.05, abs=0.3)
    assert response.lock_frames <= 2 * response.delay_frames + 4
    assert response.stays


@pytest.mark.parametrize(
    ("refresh_hz", "exposure_s", "delay_frames", "phase"),
    [(59.94, 0.016, 2, 0.7), (60.0, 0.016, 4, 0.5)],
)
def test_no_timing_starves_or_destabilises_the_loop(refresh_hz, exposure_s, delay_frames, phase):
    mix = step.Mix(refresh_hz, exposure_s, delay_frames, phase)
    response = step.timed_step(mix, step.COMPOSITION, frames=60)
    assert response.lock_frames is not None
    assert response.stable, response
    assert response.longest_gap <= 4
    assert response.state == "locked"


def test_the_integrator_diverges_where_the_composition_locks():
    mix = step.Mix(59.94, 0.008, 3, 0.3)
    composed = step.timed_step(mix, step.COMPOSITION, frames=60)
    integrated = step.timed_step(mix, step.integrator(0.6), frames=60)
    assert composed.stable
    assert integrated.lock_frames is None
    # 20 times the lock's bar, or nothing left to be read
    assert not integrated.late_px < 1.0
