"""What the live path costs a frame: threads, strips, pacing; reading and publishing alongside the loop.

The bare loop does everything in turn. The live one, over the same devices, reads the camera and draws in
threads of their own, numbers its pictures by coded strips and reads when they were lit, and decides how long
they are held. Frames of 1280x1024 in 8 bits were rendered beforehand (`memory_devices`: untouched, pressed,
sliding, lifted) and are handed over at once, pictures are taken at once: what is timed is the loop's and not
a device's. The variants take turns, frame by frame or run by run, and each frame is compared with the same
frame of the same round.

answer: from the camera handing a frame over until the drawing of the picture made from it begins. turn: until
the loop is ready for the next frame. cpu: the loop's thread's own time in a turn, which other programs on the
machine change least. What devices do in the thread of the bare loop (drawing, putting a frame together) is in
none of them. What is judged is the least of the rounds, frame by frame: other programs only ever add to it.

Drawing is left out but for the variants that say so: a graphics card's costs the processor next to nothing,
software OpenGL more than the whole loop. It is compared drawing with drawing. "60 Hz": the camera waits for
the host's clock as a real one does, which leaves the processor to others between the frames; else time is
skipped. Late: turns above a frame's time at 60 Hz.

Where surfaces are read and recorded at 60 Hz, contacts are looked for as well, as a session does. Without
drawing, as with a graphics card, and drawing in software, the share of the camera's frames that were read to
depth is given, those among them that the loop never had, the longest run of frames that were not read, and
loop and reading in the median and at 99 %; without drawing the share has a bar, which an idle machine alone
meets. The press is a Gaussian, which a law of the far field fits at once: one that none fits, or several
presses, take some 5 to 10 ms more. Where the processor's time goes is given by thread and process. In it,
"emulated devices" are those of memory: the camera puts its frames together in the thread "capture", which a
real one does not.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from itertools import groupby

import numpy as np

from benchmarks.live_running import Timed, Variant, run_together
from benchmarks.memory_devices import PATH, Prepared
from benchmarks.report import Figure, Report, benchmark, figure, start
from benchmarks.rigs import changed
from benchmarks.totals import estimate, ratio
from zeromethod.arrays import Float
from zeromethod.rig.load import load_rig
from zeromethod.rig.model import Rig
from zeromethod.view.progress import progress

ADDED_MS = 2.0
"""Most that the live path may add to a frame, in the median over frames."""

STOPPED_MS = 0.3
"""Most that a subscriber that stopped reading may add to none: as much as noise does."""

_LEAST_SPENT_MS = 0.05
"""Processor time of a thread that is worth naming."""

FIGURES = ("answer_ms", "turn_ms", "cpu_ms")
LATE_MS = 1e3 / 60
BARE = Variant("bare", live=False, strips=False)
LIVE = Variant("threads, strips")
AT_ONCE = (BARE, Variant("threads", strips=False), LIVE)
UNSTEADY = Variant("the same, not steady", steady=False)
ALONE = Variant("threads, strips, by itself")
POOLS = Variant("the same, pools of threads", pools=True)
READ = Variant("+ reading surfaces", reads=True)
SUBSCRIBED = tuple(
    Variant(f"+ publishing, {name}", reads=True, subscriber=kind)
    for kind, name in (
        ("none", "nobody listens"),
        ("reading", "one reads"),
        ("stopped", "one has stopped reading"),
    )
)
PACED = (
    Variant("bare, 60 Hz", live=False, strips=False, waits=True),
    Variant("threads, strips, 60 Hz", waits=True),
    Variant("the same, not steady, 60 Hz", waits=True, steady=False),
    Variant("+ reading surfaces, 60 Hz", waits=True, reads=True),
    Variant("+ reading surfaces, recording, 60 Hz", waits=True, reads=True, records=True),
)
DRAWN = (
    Variant("bare, 60 Hz, drawing", live=False, strips=False, drawn=True, waits=True),
    Variant("threads, strips, 60 Hz, drawing", drawn=True, waits=True),
)
WHOLE = Variant(
    "+ reading surfaces, recording, 60 Hz, drawing", drawn=True, waits=True, reads=True, records=True
)
GROUPS: tuple[tuple[Variant, ...], ...] = (
    AT_ONCE,
    *((variant,) for variant in (ALONE, UNSTEADY, POOLS, READ, *SUBSCRIBED, *PACED, *DRAWN, WHOLE)),
)
"""Those of the first take turns frame by frame; the others would disturb each other, and go one by one."""

VARIANTS = tuple(variant for group in GROUPS for variant in group)
COMPARED = {
    **{variant.name: BARE.name for variant in AT_ONCE[1:]},
    **{variant.name: ALONE.name for variant in (UNSTEADY, POOLS, READ)},
    SUBSCRIBED[0].name: READ.name,
    **{variant.name: SUBSCRIBED[0].name for variant in SUBSCRIBED[1:]},
    **{variant.name: PACED[0].name for variant in PACED[1:]},
    DRAWN[1].name: DRAWN[0].name,
    WHOLE.name: DRAWN[1].name,
}
"""What each variant is compared with."""


Turns = dict[str, list[list[Timed]]]
"""Turns of every round, by the name of the variant."""


def column(rounds: list[list[Timed]], name: str) -> Float:
    """One figure of all turns, those without it left out."""
    values = np.array([getattr(turn, name) for turns in rounds for turn in turns], dtype=float)
    return np.asarray(values[np.isfinite(values)])


@dataclass(frozen=True)
class Added:
    """Difference of a variant from another, frame by frame, ms: median and quartiles over all frames.

    least_ms: median over frames of what the least of the rounds differ by: other programs on the machine only
    ever add to a time. sigma_ms: standard deviation of the median, by that of the rounds' own medians.
    """

    least_ms: float
    median_ms: float
    low_ms: float
    high_ms: float
    sigma_ms: float


def added(rounds: list[list[Timed]], others: list[list[Timed]], name: str) -> Added:
    """What `rounds` cost more than `others`."""
    medians, all_differences = [], []
    for turns, other in zip(rounds, others, strict=True):
        before = {turn.number: getattr(turn, name) for turn in other}
        pairs = [getattr(turn, name) - before[turn.number] for turn in turns if turn.number in before]
        differences = [each for each in pairs if np.isfinite(each)]
        all_differences += differences
        medians.append(np.median(differences) if differences else np.nan)
    low, middle, high = np.percentile(all_differences, (25, 50, 75)) if all_differences else 3 * (np.nan,)
    # of a mean; that of a median over few rounds is no better known
    sigma = float(np.std(medians, ddof=1) / len(medians) ** 0.5) if len(medians) > 1 else float("nan")
    least, before_least = _least(rounds, name), _least(others, name)
    both = [least[number] - before_least[number] for number in least.keys() & before_least.keys()]
    least_ms = float(np.median(both)) if both else float("nan")
    return Added(least_ms, float(middle), float(low), float(high), sigma)


def _least(rounds: list[list[Timed]], name: str) -> dict[int, float]:
    """Least of a figure over the rounds, by turn."""
    least: dict[int, float] = {}
    for turns in rounds:
        for turn in turns:
            value = getattr(turn, name)
            if np.isfinite(value):
                least[turn.number] = min(value, least.get(turn.number, np.inf))
    return least


def _spread(values: Float) -> str:
    if not len(values):
        return "-"
    return " / ".join(f"{each:.1f}" for each in (*np.percentile(values, (50, 99, 99.9)), values.max()))


def _row(variant: Variant, turns: Turns) -> list[str]:
    rounds = turns[variant.name]
    turn_ms = column(rounds, "turn_ms")
    row = [variant.name, _spread(column(rounds, "answer_ms")), _spread(turn_ms)]
    row += [f"{np.median(column(rounds, 'cpu_ms')):.2f}", f"{100 * np.mean(turn_ms > LATE_MS):.1f} %"]
    if variant.name not in COMPARED:
        return [*row, "", "", "", ""]
    row.append(COMPARED[variant.name])
    for name in FIGURES:
        more = added(rounds, turns[COMPARED[variant.name]], name)
        row.append(
            f"{more.least_ms:+.2f} | {more.median_ms:+.2f} +- {more.sigma_ms:.2f} "
            f"({more.low_ms:+.2f} to {more.high_ms:+.2f})"
        )
    return row


def _reading_figures(
    name: str, rounds: list[list[Timed]], spent: list[dict[str, float]], least: float | None
) -> list[Figure]:
    """Frames that were read, least: of all, the bar; the slowest of loop and reading; processor time."""
    asked = [
        [
            was_read
            for turn in turns
            for was_read in (*turn.dropped * (False,), *turn.measured * (bool(np.isfinite(turn.read_ms)),))
        ]
        for turns in rounds
    ]
    gaps = [len(list(run)) for turns in asked for was_read, run in groupby(turns) if not was_read]
    read = estimate(ratio, [sum(turns) for turns in asked], [len(turns) for turns in asked])
    never = sum(turn.dropped for turns in rounds for turn in turns)
    least_ms = {part: min(one.get(part, np.nan) for one in spent) for part in spent[0]}
    parts = ", ".join(f"{part} {ms:.1f}" for part, ms in sorted(least_ms.items()) if ms >= _LEAST_SPENT_MS)
    return [
        figure(f"{name}: the camera's frames that were read", *read, unit="%", least=least),
        Figure(f"{name}: frames that the loop never had", f"{never}"),
        Figure(f"{name}: longest run of frames not read", f"{max(gaps, default=0)}", "1 when quiet"),
        Figure(f"{name}: loop, median / 99 %", _two(column(rounds, "loop_ms"))),
        Figure(f"{name}: reading, median / 99 %", _two(column(rounds, "read_ms"))),
        Figure(f"{name}: processor time of a frame, ms, least round", parts),
    ]


def _two(values: Float) -> str:
    return "none" if not len(values) else "{:.1f} / {:.1f} ms".format(*np.percentile(values, (50, 99)))


def measure(rig: Rig, rounds: int, frames: int) -> Report:
    """Run everything; see the module. rig: with a simulated bench."""
    turns: Turns = {variant.name: [] for variant in VARIANTS}
    spent: dict[str, list[dict[str, float]]] = {variant.name: [] for variant in VARIANTS}
    with progress(1 + rounds * len(VARIANTS), "live cost") as bar:
        prepared = Prepared(changed(rig, control={"strips": "edges"}))
        bar()
        for count in range(rounds):
            turned = -1 if count % 2 else 1
            for group in GROUPS[::turned]:
                used = spent[group[0].name] if len(group) == 1 else None
                ran = run_together(group[::turned], prepared, frames, used)[::turned]
                for variant, one in zip(group, ran, strict=True):
                    turns[variant.name].append(one)
                    bar()

    def bar_of(name: str, figure: str, variant: Variant, most_ms: float) -> Figure:
        more = added(turns[variant.name], turns[COMPARED[variant.name]], figure)
        value = f"{more.least_ms:+.2f} ms (all rounds {more.median_ms:+.2f} +- {more.sigma_ms:.2f})"
        return Figure(name, value, f"< {most_ms:g} ms", more.least_ms < most_ms)

    paced, stopped = PACED[1], SUBSCRIBED[2]
    figures = [
        bar_of("live over bare: frame in hand to drawing begun", "answer_ms", LIVE, ADDED_MS),
        bar_of("live over bare: turn", "turn_ms", LIVE, ADDED_MS),
        bar_of("live over bare: the loop's own processor time", "cpu_ms", LIVE, ADDED_MS),
        bar_of("live over bare, 60 Hz: frame in hand to drawing begun", "answer_ms", paced, ADDED_MS),
        bar_of("live over bare, 60 Hz: turn", "turn_ms", paced, ADDED_MS),
        bar_of("a subscriber that stopped reading over none: turn", "turn_ms", stopped, STOPPED_MS),
        bar_of("a subscriber that stopped reading over none: answer", "answer_ms", stopped, STOPPED_MS),
        bar_of("a subscriber that stopped reading over none: processor time", "cpu_ms", stopped, STOPPED_MS),
    ]
    for name, variant, least in (
        ("reading and recording, 60 Hz", PACED[-1], 0.99),
        ("drawn in software", WHOLE, None),
    ):
        figures += _reading_figures(name, turns[variant.name], spent[variant.name], least)
    header = ["ms: median / 99 % / 99.9 % / worst", "answer", "turn", "cpu", "late", "over"]
    header += [f"{name}: least | median +- sigma (quartiles)" for name in ("answer", "turn", "cpu")]
    details = [header, *(_row(variant, turns) for variant in VARIANTS)]
    data = {
        "variants": [asdict(variant) for variant in VARIANTS],
        "turns": {name: [[asdict(turn) for turn in one] for one in each] for name, each in turns.items()},
        "added": {
            name: {figure: asdict(added(turns[name], turns[other], figure)) for figure in FIGURES}
            for name, other in COMPARED.items()
        },
        "processor_ms": spent,
    }
    title = f"Cost of the live path: {rig.camera.columns}x{rig.camera.rows}, {rounds} x {frames} frames each"
    return Report(title, figures, details, data)


@benchmark("live_cost", __doc__)
def command(quick: bool) -> Report:
    return measure(load_rig("simulated"), 3 if quick else 8, len(PATH))


if __name__ == "__main__":
    start(command)
