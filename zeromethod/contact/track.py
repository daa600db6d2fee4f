"""Contacts followed from touch to lift: the same id in every frame."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from zeromethod.contact.contact import Contact

CONFIRMED_FRAMES = 2
"""Frames in a row in which a contact is seen before it is named."""
FORGOTTEN_FRAMES = 2
"""Frames in a row without it after which it is lifted."""
_ALONE = 2.5
"""Distance to all others, there or where they were, in the measure of `_apart`, from which a contact is no
piece of one that comes or lifts while the frame is exposed: planted fingers' pieces lay within 2.3."""


@dataclass(slots=True)
class _Followed:
    id: int
    last: Contact
    since_ns: int
    seen: int = 1
    missing: int = 0


class ContactTrack:
    """Gives contacts their ids.

    A contact is that of the frame before whose centroid lies nearest, if it lies nearer than the larger one's
    half size and half a mm; each is taken once, nearest pairs first. whole: whether one that lies alone is
    named in its first frame. left: whether one that is missing is seen to have left.
    """

    def __init__(
        self,
        whole: Callable[[Contact], bool] = lambda _: False,
        left: Callable[[Contact], bool] = lambda _: False,
    ) -> None:
        self._whole, self._has_left = whole, left
        self._followed: list[_Followed] = []
        self._next = 1

    @property
    def ids(self) -> frozenset[int]:
        """Those of the contacts that are not lifted, seen in the last frame or not."""
        return frozenset(one.id for one in self._followed if one.id)

    def follow(self, found: Sequence[Contact], time_ns: int = 0) -> tuple[Contact, ...]:
        """The next frame's contacts that are confirmed, with ids and ages, in the order given."""
        taken: dict[int, _Followed] = {}
        left = list(self._followed)
        before = [one.last for one in left]
        pairs = [(_apart(one.last, new), k, one) for one in left for k, new in enumerate(found)]
        for apart, k, one in sorted(pairs, key=lambda pair: pair[0]):
            if apart < 1 and k not in taken and one in left:
                taken[k] = one
                left.remove(one)
        for one in left:
            one.missing += 1
            one.seen = 0 if one.id == 0 else one.seen
            if self._has_left(one.last):
                one.missing = FORGOTTEN_FRAMES
        result = []
        for k, new in enumerate(found):
            if k not in taken:
                taken[k] = _Followed(0, new, time_ns, seen=0)
                self._followed.append(taken[k])
            followed = taken[k]
            followed.last, followed.seen, followed.missing = new, followed.seen + 1, 0
            others = [*before, *found[:k], *found[k + 1 :]]
            if followed.id == 0 and (followed.seen >= CONFIRMED_FRAMES or self._is_sure(new, others)):
                followed.id, self._next = self._next, self._next + 1
            if followed.id:
                result.append(replace(new, id=followed.id, age_s=1e-9 * (time_ns - followed.since_ns)))
        self._followed = [one for one in self._followed if one.missing < (FORGOTTEN_FRAMES if one.id else 1)]
        return tuple(result)

    def _is_sure(self, new: Contact, others: Sequence[Contact]) -> bool:
        """Whether one frame is enough: it shows all of a contact, and no piece of another one."""
        return self._whole(new) and all(_apart(new, one) > _ALONE for one in others)

    def renew(self, contact_id: int, time_ns: int) -> None:
        """Give a contact that was said to be lifted, but is still seen, a new id and age."""
        for one in self._followed:
            if one.id == contact_id:
                one.id, one.since_ns, self._next = self._next, time_ns, self._next + 1


def _apart(one: Contact, other: Contact) -> float:
    """Distance of the centroids over what may lie between those of one contact."""
    size = float(np.sqrt(max(one.area_mm2, other.area_mm2) / np.pi))
    return float(np.hypot(one.x_mm - other.x_mm, one.y_mm - other.y_mm)) / (size + 0.5)
