"""Checks that a frame is what a camera may give, before anything in it is believed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from zeromethod.arrays import Image, Mask
from zeromethod.devices.contract import wrong_image, wrong_numbers
from zeromethod.devices.protocols import Frame
from zeromethod.loop.events import Event, Notice
from zeromethod.rig.model import CameraSpec

SAMPLE_STRIDE = 8
"""Every how many-th row is compared with the frame before."""

BEGINNING_PX = 32
"""Beginning of a row that is compared first: by noise nearly all rows differ there."""

LATE_FRAMES = 2.0
"""Frame times beyond the least age so far at which a frame counts as late."""

SEAM_ROWS = 20
"""Rows to both sides of a tear that rows at it are held against: more than a period of the target."""

SEAM_RATIO = 1.5
"""Times the largest third difference of rows around it, in square, from which two frames meet at a tear: a
step of half a pixel of the target in 2 grey of noise, which by itself changes squares by a tenth."""

SEAM_FRAMES = 8
"""Consecutive frames that are refused for a seam; one that stays is an edge in the picture."""

JUMP_FRAMES = 3
"""Consecutive frames that follow each other, but not those before, after which the clock has jumped."""


@dataclass(frozen=True)
class FrameVerdict:
    """What happened to a frame, and why it must not be used; refusal None: it may be."""

    events: tuple[Event, ...] = ()
    refusal: Notice | None = None

    @property
    def wrong(self) -> bool:
        """Whether the device breaks its contract."""
        return self.refusal is not None and self.refusal.event is Event.FRAME_WRONG


def _refused(events: tuple[Event, ...], words: str) -> FrameVerdict:
    """Refuse a frame for the last of its events."""
    return FrameVerdict(events, Notice(events[-1], words))


def _breaks_off(image: Image, row: int) -> bool:
    """Whether the picture breaks off between one row and the sampled one that follows."""
    first = max(row - SEAM_ROWS, 0)
    rows = image[first : row + SAMPLE_STRIDE + SEAM_ROWS].astype(np.float32)
    bent = np.square(np.diff(rows, 3, axis=0)).mean(axis=1)  # each over four rows
    at = slice(max(row - first - 3, 0), row - first + SAMPLE_STRIDE)
    around = np.delete(bent, at)
    return around.size > 0 and bool(bent[at].max() > SEAM_RATIO * around.max())


class FrameCheck:
    """Checks frames one after the other against the rig's camera.

    Noise makes every row of pixels unique. So rows that are, bit for bit, those of the frame before were
    not exposed again: all of them in a repeated frame, some in a torn one, whose transfer left part of the
    old frame standing. Where the rig gives the camera no noise, equal rows are no fault and are not judged.
    The half that was left out then may come with the next frame, and no row of that is an old one. So rows
    where a frame was torn are watched from then on: two frames meet there where the picture breaks off.
    """

    def __init__(self, camera: CameraSpec) -> None:
        self.wrong_frames = 0
        """Consecutive frames by which the device broke its contract."""
        self._shape = (camera.rows, camera.columns)
        self._dtype = np.dtype(np.uint8 if camera.bits == 8 else np.uint16)
        self._noisy = camera.noise.read_grey > 0 or camera.noise.electrons_per_grey is not None
        self._late_ns = LATE_FRAMES * 1e9 / camera.rate_hz
        self._least_age_ns: int | None = None
        self._last: tuple[int, int] | None = None
        self._shift_ns = 0
        self._resumed = True
        self._astray: list[tuple[int, int, int]] = []
        self._disordered = 0
        self._sample: Image | None = None
        self._tears: list[int] = []
        self._seams = 0

    def restart(self) -> None:
        """Forget the frames so far: the camera was opened again and counts from its own beginning."""
        self._last = None
        self._sample = None
        self._shift_ns = 0
        self._astray.clear()
        self._disordered = 0
        self._tears.clear()

    def resume(self) -> None:
        """Begin another run: frames that came since the last one, as before the first, were not dropped."""
        self._resumed = True

    def timed(self, frame: Frame) -> Frame:
        """Frame with its time on the run's clock, should the camera's have jumped."""
        time_ns, dropped = frame.time_ns, frame.dropped
        if isinstance(time_ns, int):
            time_ns += self._shift_ns
        if self._resumed and isinstance(dropped, int):
            dropped = min(dropped, 0)
        self._resumed = False
        return replace(frame, time_ns=time_ns, dropped=dropped)

    def look_at(
        self, frame: Frame, now_ns: int, stale: Callable[[int], Notice | None] = lambda _now_ns: None
    ) -> FrameVerdict:
        """Judge a frame as `timed` returns it, which came to hand at `now_ns`.

        stale: says of a time why a frame that is good by itself must not be used.
        """
        verdict = self._by_itself(frame, now_ns)
        self.wrong_frames = self.wrong_frames + 1 if verdict.wrong else 0
        if verdict.refusal is None and (why := stale(now_ns)) is not None:
            return FrameVerdict(verdict.events, why)
        return verdict

    def _by_itself(self, frame: Frame, now_ns: int) -> FrameVerdict:
        if wrong := self._wrong(frame, now_ns):
            return wrong
        image = frame.image
        events = [Event.FRAMES_DROPPED] if frame.dropped else []
        stale = self._stale_rows(image)
        if self._last is not None and (frame.number <= self._last[0] or frame.time_ns <= self._last[1]):
            return self._out_of_order(frame, now_ns, self._last, bool(stale.all()), events)
        self._last = frame.number, frame.time_ns
        self._astray.clear()
        self._disordered = 0
        if self._late(now_ns - frame.time_ns):
            events.append(Event.FRAME_LATE)
        if not self._noisy or not stale.any():
            return self._joined(image, tuple(events))
        if stale.all():
            return _refused((*events, Event.FRAME_REPEATED), "the image is that of the frame before")
        self._tears = [SAMPLE_STRIDE * int(row) for row in np.flatnonzero(np.diff(stale))]
        rows = round(100 * float(stale.mean()))
        return _refused((*events, Event.FRAME_TORN), f"{rows} % of the frame is still that of the one before")

    def _out_of_order(
        self, frame: Frame, now_ns: int, last: tuple[int, int], stale: bool, events: list[Event]
    ) -> FrameVerdict:
        """Verdict on a frame whose number or time does not rise. stale: its image is that of the one before.

        Where so many come in a row that one order among them would have been followed, there is none.
        """
        again = stale and (self._noisy or (frame.number, frame.time_ns) == last)
        if not again and (jumped := self._jumped(frame, now_ns)):
            return jumped
        self._disordered += not again
        words = f"frame {frame.number} came after frame {last[0]}"
        if self._disordered > JUMP_FRAMES:
            both = f"{words}, at {frame.time_ns} ns after {last[1]} ns: both must rise"
            return _refused((Event.FRAME_WRONG,), both)
        event = Event.FRAME_REPEATED if again else Event.FRAME_DISORDERED
        return _refused((*events, event), words)

    def _joined(self, image: Image, events: tuple[Event, ...]) -> FrameVerdict:
        """Judge a frame with no old rows: refused where it was torn before and parts of two frames meet."""
        self._seams = self._seams + 1 if any(_breaks_off(image, row) for row in self._tears) else 0
        if not 0 < self._seams <= SEAM_FRAMES:
            return FrameVerdict(events)
        return _refused((*events, Event.FRAME_TORN), "two frames meet where one was torn before")

    def _wrong(self, frame: Frame, now_ns: int) -> FrameVerdict | None:
        """Verdict on a frame that breaks the contract, or whose clock jumped ahead; None for any other."""
        if broken := wrong_image(frame.image, self._shape, self._dtype) or wrong_numbers(frame):
            return _refused((Event.FRAME_WRONG,), broken)
        # An exposure's length is left for clocks that were mapped onto each other.
        if 0 <= frame.time_ns <= now_ns + frame.exposure_ns:
            since_ns = frame.time_ns - self._last[1] if self._last else 0
            if not 0 < since_ns < frame.exposure_ns - self._late_ns:
                return None
            self._last = frame.number, frame.time_ns
            words = f"an exposure of {frame.exposure_ns} ns {since_ns} ns after the last: no two may overlap"
            return _refused((Event.FRAME_WRONG,), words)
        where = "before the clock's beginning" if frame.time_ns < 0 else "past the present"
        words = f"the frame's time lies {where}: {frame.time_ns} ns at {now_ns} ns"
        return self._jumped(frame, now_ns) or _refused((Event.FRAME_WRONG,), words)

    def _jumped(self, frame: Frame, now_ns: int) -> FrameVerdict | None:
        """Note a frame out of order; after some that are in order among themselves, follow their clock."""
        if self._least_age_ns is None:
            return None
        astray = self._astray
        if astray and (frame.number <= astray[-1][0] or frame.time_ns <= astray[-1][1]):
            astray.clear()
        astray.append((frame.number, frame.time_ns, now_ns - frame.time_ns))
        if len(astray) < JUMP_FRAMES:
            return None
        shift_ns = min(age for _, _, age in astray) - self._least_age_ns
        # a count that was set back leaves the times as they are
        if abs(shift_ns) <= self._late_ns:
            shift_ns = 0
        self._shift_ns += shift_ns
        self._last = frame.number, frame.time_ns + shift_ns
        astray.clear()
        self._disordered = 0
        what = f"clock jumped by {-1e-9 * shift_ns:+.3g} s" if shift_ns else "count was set back"
        return _refused((Event.CLOCK_JUMPED,), f"the camera's {what}: followed")

    def _stale_rows(self, image: Image) -> Mask:
        """Which of the sampled rows equal the last frame's; uniform ones (no light, clipped) are left out."""
        sample = image[::SAMPLE_STRIDE].copy()
        before, self._sample = self._sample, sample
        if before is None:
            return np.zeros(len(sample), dtype=np.bool_)
        same: Mask = (sample[:, :BEGINNING_PX] == before[:, :BEGINNING_PX]).all(axis=1)
        if same.any():
            same &= (sample == before).all(axis=1) & (sample.min(axis=1) < sample.max(axis=1))
        return same

    def _late(self, age_ns: int) -> bool:
        if self._least_age_ns is None or age_ns < self._least_age_ns:
            self._least_age_ns = age_ns
        return age_ns - self._least_age_ns > self._late_ns
