"""Frames from a sudden press to lock, and whether any timing starves or destabilises the loop.

A step of 0.2 mm (sigma 5 mm) at full size, twenty seeds; the seed also draws when in a frame the press
comes. Counted from the first frame whose exposure saw the press to the first of three consecutive frames with
a residual rms under 0.05 camera px over usable nodes, of which 98 % must be valid. The bar is twice the
physical delay, as the loop measured it, and 5 frames.

Then a smaller bench (camera and LCD binned by 4) under every mix of camera phase, display refresh, exposure
and camera delay, 120 frames each: of 10 phases x 2 x 4 x 4 three phases per mix are run, so that every
phase meets every refresh and exposure (phase 1.0 is phase 0.0 one frame on). It starves where it never
locks, and is unstable where one of the last 60 frames is not nulled or the warp found is not the true one.
Frames above 0.05 px after the first lock are counted apart: with delay, commands older than those that made
the lock are still to come. The integrator, which takes each residual for one of its latest command, runs
also without its leak, which is kinder to it: its packaged leak of 0.01 leaves a residual for good.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass

import click
import numpy as np

from benchmarks.report import Figure, Report, benchmark, figure, start
from benchmarks.rigs import changed, opened, pressed, small_rig, step_path, usable_residual_px
from benchmarks.salt import generator, salt_option, seed
from zeromethod.cli.numbers import Whole
from zeromethod.loop.state import LOCK_FRAMES, LOCK_RESIDUAL_PX
from zeromethod.rig.load import load_rig
from zeromethod.rig.model import Rig
from zeromethod.view.progress import Advance, progress

TITLE = "Step response: 0.2 mm, sigma 5 mm"
PRESS_S = 0.15
CORRECTIONS, EXTRA_FRAMES = 2, 5
VALID_SHARE = 0.98
HELD_FRAMES = 120
LAST_FRAMES = 60
BASELINE_FRAMES = 90
WARP_WITHIN_LCD_PX = 0.1
"""A whole period of the carrier read wrong would be 13 LCD px; noise is 0.01."""

REFRESHES_HZ = (59.94, 60.0)
EXPOSURES_S = (0.002, 0.004, 0.008, 0.016)
DELAYS_FRAMES = (1, 2, 3, 4)
PHASES_PER_MIX = 3
COMPOSITION: dict[str, object] = {"controller": "composition"}
INTEGRATORS = (0.3, 0.6)


@dataclass(frozen=True)
class Response:
    """What a step came to.

    lock_frames: None where it never locked. delay_frames: mid-exposure to the answer half lit, measured.
    longest_gap: most consecutive frames without a measurement after the press. worst_px, late_px, last_px:
    residual rms over usable nodes, largest after lock, largest of the second half, and in the last frame.
    warp_error_px: rms of the last measured warp against the true one, LCD px.
    """

    lock_frames: int | None
    delay_frames: float
    longest_gap: int
    worst_px: float
    late_px: float
    last_px: float
    warp_error_px: float
    state: str

    @property
    def stable(self) -> bool:
        """Whether it locked on the true warp and was nulled throughout the second half."""
        locked = self.lock_frames is not None and self.late_px < LOCK_RESIDUAL_PX
        return locked and self.warp_error_px < WARP_WITHIN_LCD_PX

    @property
    def stays(self) -> bool:
        """Whether it is stable and no frame after the first lock rose above the lock's bar."""
        return self.stable and self.worst_px < LOCK_RESIDUAL_PX


def lock_index(residual_px: Sequence[float], share: Sequence[float]) -> int | None:
    """Index of the first of three consecutive frames that are nulled."""
    running = 0
    for index, (px, valid) in enumerate(zip(residual_px, share, strict=True)):
        running = running + 1 if px < LOCK_RESIDUAL_PX and valid >= VALID_SHARE else 0
        if running == LOCK_FRAMES:
            return index - LOCK_FRAMES + 1
    return None


def respond(rig: Rig, press_s: float, frames_after: int) -> Response:
    """Run a rig whose press comes at `press_s` for so many frames after the press."""
    residual_px, share, measured, delays = [], [], [], []
    exposure_ns, press_ns = 1e9 * rig.camera.exposure_s, 1e9 * press_s
    error_px = float("nan")
    with opened(rig) as bench:
        usable = bench.usable(bench.truth(round(press_ns) + 1))
        for step in bench.loop.run(frames=round(press_s * rig.camera.rate_hz) + frames_after):
            if np.isfinite(step.delay_ms):
                delays.append(step.delay_ms)
            if step.time_ns + exposure_ns / 2 <= press_ns:
                continue
            px, valid = usable_residual_px(step, usable)
            residual_px.append(px)
            share.append(valid)
            measured.append(step.measured is not None)
            last = step.measured
            if last is not None:
                true_q = bench.true_warp(bench.truth(step.time_ns))
                off = (last.q - true_q)[last.valid & usable]
                error_px = float(np.sqrt(np.mean(np.sum(off**2, axis=-1)))) if len(off) else float("nan")
    locked = lock_index(residual_px, share)
    after = residual_px[locked:] if locked is not None else []
    gaps = "".join("m" if each else "-" for each in measured).split("m")
    return Response(
        lock_frames=locked,
        delay_frames=1e-3 * float(np.median(delays)) * rig.camera.rate_hz,
        longest_gap=max(len(gap) for gap in gaps),
        worst_px=float(np.max(after)) if after else float("nan"),
        late_px=float(np.max(residual_px[-min(LAST_FRAMES, len(residual_px) // 2) :])),
        last_px=residual_px[-1],
        warp_error_px=error_px,
        state=str(step.state),
    )


def full_size_step(number: int) -> Response:
    """Step at full size; its number draws noise, jitter and when in a frame the press comes."""
    rig = changed(load_rig("simulated"), simulation={"seed": seed(number)})
    press_s = PRESS_S + float(generator(number).uniform()) / rig.camera.rate_hz
    with pressed(rig, step_path(press_s)) as ready:
        return respond(ready, press_s, frames_after=14)


@dataclass(frozen=True)
class Mix:
    """One timing of bench and camera."""

    refresh_hz: float
    exposure_s: float
    delay_frames: int
    phase: float


def mixes(per_mix: int, every: int = 1) -> Iterator[Mix]:
    """Sampled timings, see the module; `every` leaves out all but every so-many-th."""
    count = 0
    for r, refresh in enumerate(REFRESHES_HZ):
        for e, exposure in enumerate(EXPOSURES_S):
            for k, delay in enumerate(DELAYS_FRAMES):
                for j in range(per_mix):
                    if count % every == 0:
                        yield Mix(refresh, exposure, delay, (3 * k + 2 * e + 5 * r + j) % 10 / 10)
                    count += 1


def timed_step(mix: Mix, control: dict[str, object], frames: int = HELD_FRAMES) -> Response:
    """Step on the small bench under one timing."""
    rig = small_rig()
    simulation = {
        "display_refresh_hz": mix.refresh_hz,
        "camera_phase": mix.phase,
        "camera_latency_s": mix.delay_frames / rig.camera.rate_hz,
    }
    rig = changed(rig, simulation=simulation, camera={"exposure_s": mix.exposure_s}, control=control)
    with pressed(rig, step_path(PRESS_S)) as ready:
        return respond(ready, PRESS_S, frames)


def integrator(gain: float, leak: float = 0.0) -> dict[str, object]:
    """Return the control table of the baseline."""
    return {"controller": "integrator", "gain": gain, "leak": leak}


def _outcome(responses: Sequence[Response]) -> str:
    """Lock frames, least to most, or what came instead."""
    locks = [r.lock_frames for r in responses if r.lock_frames is not None and r.stable]
    if len(locks) == len(responses):
        return f"{min(locks)}" if min(locks) == max(locks) else f"{min(locks)}-{max(locks)}"
    worst = max(responses, key=lambda r: np.nan_to_num(r.last_px, nan=np.inf))
    if worst.state == "lost" or not worst.late_px < 1.0:
        return "diverges"
    return (
        f"no lock ({worst.late_px:.2g} px)"
        if worst.lock_frames is None
        else f"unsteady ({worst.late_px:.2g} px)"
    )


def _seed_figures(responses: Sequence[Response]) -> list[Figure]:
    locks = [r.lock_frames for r in responses]
    delay = float(np.median([r.delay_frames for r in responses]))
    late = [
        np.inf if r.lock_frames is None else r.lock_frames - CORRECTIONS * r.delay_frames for r in responses
    ]
    shown = ", ".join("never" if n is None else str(n) for n in sorted(set(locks), key=str))
    return [
        Figure("full size: physical delay", f"{delay:.2f} frames"),
        Figure(f"full size: frames to lock, {len(responses)} seeds", shown),
        figure("full size: frames to lock less 2 x delay, most", max(late), unit="frames", most=EXTRA_FRAMES),
    ]


def _sweep(
    per_mix: int, every: int, bar: Advance
) -> tuple[dict[Mix, Response], dict[float, dict[Mix, Response]]]:
    composed: dict[Mix, Response] = {}
    baseline: dict[float, dict[Mix, Response]] = {gain: {} for gain in INTEGRATORS}
    integrators: set[tuple[float, float, int]] = set()
    for mix in mixes(per_mix, every):
        composed[mix] = timed_step(mix, COMPOSITION)
        bar()
        timing = (mix.refresh_hz, mix.exposure_s, mix.delay_frames)
        if timing not in integrators:
            integrators.add(timing)
            for gain in INTEGRATORS:
                baseline[gain][mix] = timed_step(mix, integrator(gain), BASELINE_FRAMES)
                bar()
    return composed, baseline


def _row(
    timing: tuple[float, float, int],
    composed: dict[Mix, Response],
    baseline: dict[float, dict[Mix, Response]],
) -> list[str]:
    def of(responses: dict[Mix, Response]) -> list[Response]:
        return [r for m, r in responses.items() if (m.refresh_hz, m.exposure_s, m.delay_frames) == timing]

    here = of(composed)
    phases = ",".join(
        f"{m.phase:g}" for m in composed if (m.refresh_hz, m.exposure_s, m.delay_frames) == timing
    )
    return [
        f"{timing[0]:g} Hz, {1e3 * timing[1]:g} ms, +{timing[2]} frames",
        phases,
        f"{np.median([r.delay_frames for r in here]):.1f}",
        _outcome(here),
        f"{max(r.worst_px for r in here):.3f}",
        str(max(r.longest_gap for r in here)),
        *(_outcome(of(baseline[gain])) for gain in INTEGRATORS),
    ]


def measure(seeds: int, per_mix: int, every: int) -> Report:
    """Run everything, see the module; no timings where `per_mix` is 0."""
    timings = len({(m.refresh_hz, m.exposure_s, m.delay_frames) for m in mixes(per_mix, every)})
    sweep = sum(1 for _ in mixes(per_mix, every))
    with progress(4 * seeds + sweep + timings * len(INTEGRATORS) + 1, "step response") as bar:
        responses = []
        for number in range(seeds):
            responses.append(full_size_step(number))
            for _ in range(4):
                bar()
        if not per_mix:
            return Report(TITLE, _seed_figures(responses), [], {"seeds": [asdict(one) for one in responses]})
        composed, baseline = _sweep(per_mix, every, bar)
        leaking = timed_step(next(iter(composed)), integrator(INTEGRATORS[0], leak=0.01))
        bar()
    lost = [mix for mix, response in composed.items() if not response.stable]
    left = [mix for mix, response in composed.items() if not response.stays]
    gap = max(response.longest_gap for response in composed.values())
    figures = [
        *_seed_figures(responses),
        Figure(
            f"small bench: timings that lock and are stable over {HELD_FRAMES} frames",
            f"{len(composed) - len(lost)} of {len(composed)}",
            "all",
            not lost,
        ),
        Figure(
            "small bench: timings that never rise above 0.05 px again after the first lock",
            f"{len(composed) - len(left)} of {len(composed)}",
            "all",
            not left,
        ),
        Figure("small bench: longest gap between measurements", f"{gap} frames"),
        Figure("integrator 0.3 with its leak of 0.01: residual left", f"{leaking.last_px:.2f} px"),
    ]
    header = ["display, exposure, delay", "phases", "delay", "frames to lock", "worst after lock, px", "gap"]
    header += [f"integrator {gain:g}" for gain in INTEGRATORS]
    timed = dict.fromkeys((m.refresh_hz, m.exposure_s, m.delay_frames) for m in composed)
    data = {
        "seeds": [asdict(response) for response in responses],
        "composition": [asdict(mix) | asdict(response) for mix, response in composed.items()],
        "integrator": [
            asdict(mix) | asdict(response) | {"gain": gain}
            for gain, integrators in baseline.items()
            for mix, response in integrators.items()
        ],
    }
    details = [header, *(_row(timing, composed, baseline) for timing in timed)]
    return Report(TITLE, figures, details, data)


@benchmark(
    "step_response",
    __doc__,
    click.option("--seeds", type=Whole(min=1), default=20, show_default=True, help="Of the full size."),
    click.option("--timings/--no-timings", default=True, help="The smaller bench, too."),
    salt_option,
)
def command(quick: bool, seeds: int, timings: bool) -> Report:
    return measure(4 if quick else seeds, timings * (1 if quick else PHASES_PER_MIX), 6 if quick else 1)


if __name__ == "__main__":
    start(command)
