"""Switched on while pressed, pressed between two frames, knocked: whether the loop finds the picture again.

Random presses as hands make them on the packaged bench with four times larger pixels, there from the first
frame or from one to the next; the same under a knock, which throws the whole mirror by periods of the carrier
for some frames; and, at full size, mirrors displaced as a whole by 0.8 to 8.5 periods, where phase alone
cannot distinguish one period from another. Sixty frames, one second, each.

A run has acquired when it is nulled and stays so; one that cannot be nulled must not be called good. Orders
are counted node by node in every frame called good, against exact rays: a node a quarter of a period from
where it truly looks was read at a wrong one. Peaks are compared where they were measured and locked at the
end, and say that they are known to better than 1 % (3 sigma).

Flat faces that hide 60 to 95 % of the mirror come besides, black, grey and white: the state must be *covered*
within three frames, no node inside may be called good, and ten frames after they lift the mirror is nulled.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass

import click
import numpy as np

from benchmarks.calibration_benches import View
from benchmarks.hand_presses import any_press, can_be_nulled
from benchmarks.honesty import deviation
from benchmarks.pads import pad
from benchmarks.report import Figure, Report, benchmark, figure, start
from benchmarks.rigs import VIEW_MIDDLE_MM, changed, small_rig
from benchmarks.salt import generator, salt_option, seed
from benchmarks.totals import SIGMAS, few_beyond
from zeromethod.cli.numbers import Whole
from zeromethod.devices.opening import open_devices
from zeromethod.loop.state import NULLED, State
from zeromethod.optics import Dented, Optics
from zeromethod.rig.load import load_rig
from zeromethod.rig.model import Rig
from zeromethod.session.session import Session
from zeromethod.simulation.camera import SimulatedCamera
from zeromethod.simulation.contact.objects import ALBEDO, Form, Solid
from zeromethod.simulation.contact.path import ObjectPath
from zeromethod.simulation.path import PathPoint, PressPath
from zeromethod.simulation.press import Dent
from zeromethod.simulation.scenario import Scenario
from zeromethod.surface.peak import Where
from zeromethod.view.progress import progress

SCENES, QUICK = 200, 16
LAST, PRESS_AT, KNOCK_AT, KNOCKED = 60, 12, 24, 3
"""Frames: of a run from its event on, before a press, before a knock, and how long that lasts."""

WRONG_PERIODS = 0.25
PERCENT = 1.0
PER_COVER = 8
"""Scenes to each cover."""
COVERED_FRAMES, BACK_FRAMES, COVERED_SHARES = 3, 10, (0.6, 0.95)
COVER_MM, COVER_DEPTH_MM = (20.0, 30.0), 0.05
"""Radii of flat faces, and how deep they are pressed."""
SEED = 16
FAR_MM, WIDE_MM, MOST_MM = 90.0, 100.0, 4.2
"""A load that displaces the whole view: beside its middle, sigma, depth for four periods on one side."""


@dataclass(frozen=True)
class Scene:
    """One run: its bench, what presses, and the frame from which it must be nulled."""

    kind: str
    rig: Rig
    paths: tuple[PressPath, ...]
    event: int
    nulls: bool


@dataclass(frozen=True)
class Outcome:
    """What came of a scene.

    frames: from the event to the first of the frames that stay nulled; None for never. state: the last.
    wrong, decoded: nodes read at a wrong order, and all, in frames called good after the event.
    peak_percent, peak_sigmas: error of the last peak, measured and locked; sigma_percent: stated.
    """

    kind: str
    frames: int | None
    state: str
    nulls: bool
    wrong: int
    decoded: int
    peak_percent: float | None
    peak_sigmas: float | None
    sigma_percent: float | None


def held(rig: Rig, dent: Dent, from_frame: int, to_frame: int | None = None) -> PressPath:
    """A press that comes from one frame to the next, and goes so; there from the start for frame 0."""

    def point(frame: int, depth_mm: float) -> PathPoint:
        return PathPoint(round(1e9 * frame / rig.camera.rate_hz), dent.x_mm, dent.y_mm, depth_mm)

    path = [point(from_frame, dent.depth_mm)]
    if from_frame > 0:
        path.insert(0, point(from_frame, 0.0))
    if to_frame is not None:
        path += [point(to_frame, dent.depth_mm), point(to_frame, 0.0)]
    return PressPath(dent, tuple(path))


def thrown(depth_mm: float, side: float) -> Dent:
    """A load that displaces the whole view."""
    return pad(VIEW_MIDDLE_MM + side * FAR_MM, 0.0, depth_mm, WIDE_MM)


def scenes(count: int) -> Sequence[Scene]:
    """Random scenes of all kinds, by turns."""
    small, full = small_rig(), load_rig("simulated")
    view, draw = View(small), generator(SEED)
    makers: tuple[Callable[[Rig, Dent], Scene], ...] = (
        lambda rig, dent: Scene("on while pressed", rig, (held(rig, dent, 0),), 0, nulls=True),
        lambda rig, dent: Scene("pressed at once", rig, (held(rig, dent, PRESS_AT),), PRESS_AT, nulls=True),
        _knocked(draw),
        lambda rig, dent: Scene("on while pressed", rig, (held(rig, dent, 0),), 0, nulls=True),
        _displaced(draw),
    )
    out = []
    for number in range(count):
        dents = any_press(view, draw)
        one = makers[number % len(makers)]
        displaced = number % len(makers) == len(makers) - 1
        rig = changed(full if displaced else small, simulation={"seed": seed(number)})
        scene = one(rig, dents[0])
        out.append(scene if displaced or can_be_nulled(small, dents) else _not_nulled(scene))
    return out


def _not_nulled(scene: Scene) -> Scene:
    return Scene(scene.kind, scene.rig, scene.paths, scene.event, nulls=False)


def _knocked(draw: np.random.Generator) -> Callable[[Rig, Dent], Scene]:
    def make(rig: Rig, dent: Dent) -> Scene:
        blow = thrown(float(draw.uniform(1.0, 4.0) * MOST_MM), float(draw.choice([-1.0, 1.0])))
        paths = held(rig, dent, PRESS_AT), held(rig, blow, KNOCK_AT, KNOCK_AT + KNOCKED)
        return Scene("knocked while pressed", rig, paths, KNOCK_AT + KNOCKED, nulls=True)

    return make


def _displaced(draw: np.random.Generator) -> Callable[[Rig, Dent], Scene]:
    def make(rig: Rig, _: Dent) -> Scene:
        dent = thrown(float(draw.uniform(0.2, 1.0) * MOST_MM), float(draw.choice([-1.0, 1.0])))
        at = int(draw.choice([0, PRESS_AT]))
        return Scene("whole view displaced", rig, (held(rig, dent, at),), at, nulls=True)

    return make


def judged(scene: Scene) -> Outcome:
    """Run a scene and hold every frame that is called good against exact rays."""
    rig = scene.rig.model_copy(update={"scenario": "none"})
    optics = Optics(rig)
    frames: int | None = None
    wrong = decoded = 0
    peak: tuple[float, float, float] | None = None
    states = []
    with open_devices(rig) as devices:
        camera = devices.camera
        assert isinstance(camera, SimulatedCamera)
        camera.scenario = Scenario("acquisition", scene.paths, 1e9)
        with Session(rig, devices=devices) as session:
            grid, period_px = session.loop.grid, rig.target.period_px
            rest = session.loop.q_rest
            lcd_per_px = np.nanmedian(np.abs(np.diff(rest[..., 0], axis=1))) / grid.spacing_px
            for step in session.run(frames=scene.event + LAST):
                if step.frame_number is None or step.frame_number <= scene.event:
                    continue
                states.append(step.state)
                good = step.state in NULLED | {State.MOVED}
                frames = (step.frame_number - scene.event if frames is None else frames) if good else None
                if step.measured is None or step.state not in NULLED:
                    continue
                valid = step.measured.valid
                true_q = optics.trace(*grid.mesh(), Dented(optics.rest, camera.truth(step.time_ns))).q
                off = np.abs(step.measured.q - true_q)[valid].max(axis=-1)
                wrong += int(np.count_nonzero(~(off < WRONG_PERIODS * period_px * lcd_per_px)))
                decoded += len(off)
                if step.peak is not None:
                    error_mm, _, ratio = deviation(step, camera.truth(step.time_ns))
                    true_mm = step.peak.depth_mm - error_mm
                    measured = step.state is State.LOCKED and step.peak.where is Where.MEASURED
                    shares = 100 * error_mm / true_mm, ratio, 100 * step.peak.sigma_mm / abs(true_mm)
                    peak = shares if measured else None
    last = str(states[-1]) if states else "none"
    return Outcome(scene.kind, frames, last, scene.nulls, wrong, decoded, *(peak or (None, None, None)))


@dataclass(frozen=True)
class Covered:
    """What came of a cover.

    share: of the view that it hides. named, back: frames until it was named, and until the mirror was nulled
    after it; None for never. inside: nodes inside called good.
    """

    share: float
    named: int | None
    back: int | None
    inside: int


def covered(number: int) -> Covered:
    """A flat face that comes and goes."""
    draw = generator(SEED, number)
    rig = changed(small_rig(), simulation={"seed": seed(number)}).model_copy(update={"scenario": "none"})
    optics, lift = Optics(rig), PRESS_AT + LAST // 2
    x_mm, y_mm = VIEW_MIDDLE_MM + float(draw.uniform(-4.0, 4.0)), float(draw.uniform(-3.0, 3.0))
    radius_mm = float(draw.uniform(*COVER_MM))
    face = Solid(Form.PUNCH, radius_mm, albedo=list(ALBEDO.values())[number % len(ALBEDO)])
    comes = held(rig, pad(x_mm, y_mm, COVER_DEPTH_MM, 1.0), PRESS_AT, lift).points
    states: dict[int, State] = {}
    inside = 0
    with open_devices(rig) as devices:
        camera = devices.camera
        assert isinstance(camera, SimulatedCamera)
        camera.scenario = Scenario("covered", (), 1e9, objects=(ObjectPath(face, comes),), rubber=rig.rubber)
        with Session(rig, devices=devices) as session:
            grid, visible = session.loop.grid, session.loop.rest.visible
            point = optics.trace(*grid.mesh(), optics.rest).point
            away = np.hypot(point[..., 0] - x_mm, point[..., 1] - y_mm)
            # within a window of the face's border a node sees both
            window_mm = 2 * np.nanmedian(np.diff(point[grid.shape[0] // 2, :, 0]))
            for step in session.run(frames=lift + 2 * BACK_FRAMES):
                if step.frame_number is None:
                    continue
                states[step.frame_number] = step.state
                if PRESS_AT < step.frame_number < lift and step.surface is not None:
                    inside += int(np.count_nonzero(step.surface.valid & (away < radius_mm - window_mm)))
    named = next((k - PRESS_AT for k in range(PRESS_AT, lift) if states[k] is State.COVERED), None)
    back = next((k - lift for k in range(lift, max(states)) if states[k] in NULLED), None)
    return Covered(float(np.mean(away[visible] < radius_mm)), named, back, inside)


def _cover_figures(covers: Sequence[Covered]) -> list[Figure]:
    """Bars over covers that hide as much as the bars are for."""
    low, high = COVERED_SHARES
    mine = [one for one in covers if low <= one.share <= high]
    named = sum(one.named is not None and one.named <= COVERED_FRAMES for one in mine)
    back = sum(one.back is not None and one.back <= BACK_FRAMES for one in mine)
    inside, count = sum(one.inside for one in mine), len(mine)
    return [
        Figure("60 to 95 % covered: named within 3 frames", f"{named} of {count}", "all", named == count),
        Figure("the same: nulled within 10 frames of lifting", f"{back} of {count}", "all", back == count),
        Figure("the same: nodes inside called good", f"{inside}", "0", inside == 0),
    ]


def summarise(outcomes: Sequence[Outcome], covers: Sequence[Covered]) -> Report:
    """Bars over all scenes, and a line for each kind."""
    can = [one for one in outcomes if one.nulls]
    nulled = sum(one.frames is not None for one in can)
    rest = sum(one.frames is None and one.state != State.LOST for one in can)
    wrong, decoded = sum(one.wrong for one in outcomes), sum(one.decoded for one in outcomes)
    known = [
        abs(one.peak_percent)
        for one in outcomes
        if one.peak_percent is not None
        and one.sigma_percent is not None
        and SIGMAS * one.sigma_percent < PERCENT
    ]
    ratios = [one.peak_sigmas for one in outcomes if one.peak_sigmas is not None]
    within = sum(one < PERCENT for one in known)
    figures = [
        figure("scenes that can be nulled: nulled for good within 1 s", nulled, least=0.97, of_other=True),
        figure("the others of them that are not lost", rest, most=0),
        figure("nodes read at a wrong order and called good", wrong, most=0),
        Figure("scenes that can be nulled; nodes called good", f"{len(can)}; {decoded}"),
        Figure(
            "measured peaks that say they are known to 1 %: within 1 %",
            f"{within} of {len(known)}",
            "all",
            within == len(known),
        ),
        few_beyond("measured peaks", ratios),
        *_cover_figures(covers),
    ]
    details = [["scene", "runs", "can be nulled", "nulled", "frames, median", "most", "wrong", "largest z"]]
    for kind in dict.fromkeys(one.kind for one in outcomes):
        mine = [one for one in outcomes if one.kind == kind]
        frames = [one.frames for one in mine if one.frames is not None]
        details.append(
            [
                kind,
                f"{len(mine)}",
                f"{sum(one.nulls for one in mine)}",
                f"{len(frames)}",
                f"{np.median(frames):.0f}" if frames else "",
                f"{max(frames)}" if frames else "",
                f"{sum(one.wrong for one in mine)}",
                f"{max((one.peak_sigmas or 0.0) for one in mine):.1f}",
            ]
        )
    data = {"scenes": [asdict(one) for one in outcomes], "covers": [asdict(one) for one in covers]}
    return Report("Acquisition: on while pressed, pressed at once, knocked", figures, details, data)


@benchmark(
    "acquisition",
    __doc__,
    click.option("--scenes", "count", type=Whole(min=1), default=SCENES, show_default=True, help="Runs."),
    salt_option,
)
def command(quick: bool, count: int) -> Report:
    """Run random scenes, and a cover for so many of them."""
    outcomes, hidden = [], []
    drawn = scenes(QUICK if quick else count)
    covers = -(-len(drawn) // PER_COVER)
    with progress(len(drawn) + covers, "scenes") as advance:
        for number in range(covers):
            hidden.append(covered(number))
            advance("covered")
        for scene in drawn:
            outcomes.append(judged(scene))
            advance(scene.kind)
    return summarise(outcomes, hidden)


if __name__ == "__main__":
    start(command)
