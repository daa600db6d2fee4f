"""Reads the contact status of a texture that rubs along the mirror from images of its contact."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from zeromethod.arrays import Float
from zeromethod.contact.contact import Contact
from zeromethod.rubbing.life import SpotLife
from zeromethod.rubbing.motion import moved
from zeromethod.rubbing.ridges import Ridges, ridges_of
from zeromethod.rubbing.spots import Spots, spots_of
from zeromethod.rubbing.status import ContactStatus, Motion

_LONGEST = 6
"""Speed is measured over so many frames, at most."""
_MOVES = 4.0
"""A movement from frame to frame of more standard deviations than these is slip."""
_NAMED, _SURE = 2, 3.0
"""Consecutive frames that must agree before stick or slip is reported. One is enough where the movement, now
or in the frame before, is so many times the limit of slip."""
_UNSEEN_S = 0.1
"""How long the texture may be out of sight, as when the LCD does not light it, and still be followed."""
_TOGETHER_MM = 0.05
"""A movement over several frames that differs more from the sum of their movements is not used."""
_BORDER_MM = 0.5
"""How far off the contact's border may be: it jitters, and is unseen for a while where the LCD was white."""
_NO_MODULUS = "force: not read"


class _Seen(NamedTuple):
    """A frame. way_mm: (2,) movement since the frame before. place_mm: (2,) of the contact, by its border."""

    time_ns: int
    spots: Spots
    way_mm: Float
    place_mm: Float


class RubbingReader:
    """Reads the contact status of the largest contact, frame by frame. Not for several threads."""

    def __init__(self, blur_px: float) -> None:
        """blur_px: standard deviation of a border's blur (`zeromethod.contact.border_blur_px`)."""
        self._id, self._blur_px = 0, blur_px
        self._forget()

    def _forget(self) -> None:
        self._seen: deque[_Seen] = deque(maxlen=_LONGEST + 1)
        self._motion, self._since_ns, self._says = Motion.UNKNOWN, 0, deque[Motion](maxlen=_NAMED)
        self._ridges: Ridges | None = None
        self._life = SpotLife()
        self._step: Float | None = None
        self._changed = False
        self.spots: Spots | None = None

    def follow(self, contacts: Sequence[Contact], time_ns: int, exposure_ns: int = 0) -> ContactStatus | None:
        """Status at a frame.

        Parameters
        ----------
        contacts : sequence of Contact
            Those of the frame, with images, largest first.
        time_ns, exposure_ns : int
            Its mid-exposure, and how long it was exposed.

        Returns
        -------
        ContactStatus or None
            None where nothing touches.
        """
        if not contacts:
            self._forget()
            return None
        contact = contacts[0]
        if contact.id != self._id:
            self._forget()
            self._id = contact.id
        status = ContactStatus(
            contact_id=contact.id, force_n=contact.force_n, sigma_force_n=contact.sigma_force_n
        )
        spots = spots_of(contact, self._blur_px)
        if isinstance(spots, str):
            if not self._seen or time_ns - self._seen[-1].time_ns > 1e9 * _UNSEEN_S:
                self._forget()
                self._id = contact.id
            return replace(status, reason=spots)
        self.spots = spots
        reasons = [] if np.isfinite(contact.force_n) else [_NO_MODULUS]
        status = _counted(status, spots)
        ridges = ridges_of(spots, self._ridges)
        if isinstance(ridges, str):
            self._ridges = None
            reasons.append(ridges)
        else:
            self._ridges = ridges
            status = replace(
                status, pitch_mm=ridges.pitch_mm, sigma_pitch_mm=ridges.sigma_mm,
                ridge_deg=ridges.angle_deg, sigma_ridge_deg=ridges.sigma_deg,
            )  # fmt: skip
        new = _Seen(time_ns, spots, np.zeros(2), np.array([contact.x_mm, contact.y_mm]) - spots.sunk_mm)
        status = self._moving(status, new, 1e-9 * exposure_ns, reasons)
        life = self._life.mean_s()
        if isinstance(life, str):
            reasons.append(life)
        else:
            status = replace(status, spot_life_s=life[0], sigma_spot_life_s=life[1])
        return replace(status, reason="; ".join(reasons))

    def _moving(
        self, status: ContactStatus, new: _Seen, exposure_s: float, reasons: list[str]
    ) -> ContactStatus:
        """The status with motion and speed."""
        last = self._seen[-1] if self._seen else None
        if last is None:
            self._seen.append(new)
            reasons.append("speed: first frame")
            return status
        step = moved(last.spots, new.spots)
        if step is None:
            self._lose(new)
            reasons.append("speed: the texture was not recognised")
            return status
        way = np.array([step.dx_mm, step.dy_mm])
        self._seen.append(new._replace(way_mm=way))
        seconds = 1e-9 * (new.time_ns - last.time_ns)
        self._life.add(last.spots, new.spots, way + new.spots.sunk_mm - last.spots.sunk_mm, seconds)
        far = float(np.hypot(*way))
        least = _MOVES * step.sigma_mm
        says = Motion.SLIP if far > least else Motion.STICK
        before = float(np.hypot(*last.way_mm))
        event = self._named(says, sure=step.clear and max(far, before) > _SURE * least)
        half = 0.5 * (status.pitch_mm if np.isfinite(status.pitch_mm) else np.inf)
        gap = half if np.isfinite(half) else 5.0 / np.sqrt(status.spots_per_cm2)
        clear = step.clear or (np.isfinite(half) and (self._foreseen(way, half) or self._with_border(half)))
        self._step = way if clear else None
        blurred = far / seconds * exposure_s > gap
        aliased = far > half or blurred or not clear
        if not clear:
            reasons.append("aliased: other movements are as likely")
        status = replace(
            status, motion=self._motion, event=event, aliased=aliased,
            lasts_s=np.nan if self._motion is Motion.UNKNOWN else 1e-9 * (new.time_ns - self._since_ns),
        )  # fmt: skip
        if self._changed:
            reasons.append("speed: it started or stopped since the last frame")
            return status
        speed, sigma = self._speed(step.sigma_mm)
        size = float(np.hypot(*speed))
        status = replace(status, speed_mm_s=size, sigma_speed_mm_s=sigma)
        if size < 3 * sigma:
            return status
        direction = float(np.degrees(np.arctan2(speed[1], speed[0])))
        return replace(status, direction_deg=direction, sigma_direction_deg=float(np.degrees(sigma / size)))

    def _foreseen(self, way: Float, half_mm: float) -> bool:
        """Whether it moved nearly as in the frame before, where that was clear."""
        return self._step is not None and float(np.hypot(*(way - self._step))) < 0.5 * half_mm

    def _with_border(self, half_mm: float) -> bool:
        """Whether the contact's border moved as far as the texture.

        If the texture were taken for its neighbour, a pitch off in each frame, the two would drift apart.
        """
        steps = len(self._seen) - 1
        way = np.sum([one.way_mm for one in self._seen][1:], axis=0)
        apart = float(np.hypot(*(self._seen[-1].place_mm - self._seen[0].place_mm - way)))
        return apart < half_mm * steps and half_mm * steps > _BORDER_MM

    def _speed(self, sigma_mm: float) -> tuple[Float, float]:
        """((2,) mm/s, sigma) over the last frames with the same motion."""
        first, last = self._seen[0], self._seen[-1]
        seconds = 1e-9 * (last.time_ns - first.time_ns)
        way = np.sum([one.way_mm for one in self._seen][1:], axis=0)
        if len(self._seen) > 2:
            over = moved(first.spots, last.spots, way)
            if over is not None and np.hypot(over.dx_mm - way[0], over.dy_mm - way[1]) < _TOGETHER_MM:
                return np.array([over.dx_mm, over.dy_mm]) / seconds, over.sigma_mm / seconds
            sigma_mm *= np.sqrt(len(self._seen) - 1)
        return way / seconds, sigma_mm / seconds

    def _named(self, says: Motion, *, sure: bool) -> str:
        """Event of this frame, "" for none: stick or slip, once enough frames agree on it."""
        changed = len(self._says) > 0 and self._says[-1] is not says
        self._says.append(says)
        if changed or self._changed:  # earlier movements belong to the other motion, the first partly
            self._seen = deque(list(self._seen)[-2:], self._seen.maxlen)
        self._changed = changed
        alike = len(self._says) == _NAMED and all(one is says for one in self._says)
        if says is self._motion or not (alike or sure):
            return ""
        known = self._motion is not Motion.UNKNOWN
        self._motion, self._since_ns = says, self._seen[0].time_ns
        return str(says) if known else ""

    def _lose(self, seen: _Seen) -> None:
        """Start again with this frame: the texture was lost."""
        self._seen.clear()
        self._seen.append(seen)
        self._says.clear()
        self._motion, self._step = Motion.UNKNOWN, None


def _counted(status: ContactStatus, spots: Spots) -> ContactStatus:
    """The status with share, number and size of spots."""
    share, sigma_share = spots.share
    whole = ~spots.cut
    count = np.count_nonzero(whole) + 0.5 * np.count_nonzero(spots.cut)
    per_cm2 = 100 / spots.looked_mm2
    sizes = spots.sizes_mm2[whole]
    known = sizes.size > 1
    return replace(
        status, looked_mm2=spots.looked_mm2, share=share, sigma_share=sigma_share,
        spots_per_cm2=count * per_cm2, sigma_spots_per_cm2=float(np.sqrt(count)) * per_cm2,
        spot_mm2=float(sizes.mean()) if known else np.nan,
        sigma_spot_mm2=float(sizes.std(ddof=1) / np.sqrt(sizes.size)) if known else np.nan,
    )  # fmt: skip
