"""Contacts through a cloth: where a finger presses its threads against the mirror, they take the carrier.

Threads give the light of a projector's picture, any and changing, so that no grey level says what touches.
The amplitude of the carriers does: steady light adds nothing to it. A node whose carriers have less than half
of their amplitude at rest lies in a contact. A contact's middle is known to a fraction of a node's spacing;
its area only roughly, as right beside it the mirror bends too fast for a node's window, too.

For the frame or two after a finger has gone the LCD still shows the picture that nulled its dent, which bends
just as fast. So what has lost its carriers is a contact only if a force presses there.

In an exposure that a finger comes into, carriers in its middle keep their amplitude for the share of the time
before. What is left of them says whether one frame shows the whole finger, and whether one that is not found
any more has left: nothing gives the carriers back while threads are pressed on the mirror.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace

import cv2
import numpy as np

from zeromethod.arrays import Float, Image, Mask, Single
from zeromethod.contact.contact import LEAST_MM2, Contact, Probability
from zeromethod.contact.finder import ContactFinder
from zeromethod.contact.force_fit import ForceFit
from zeromethod.contact.moments import moments
from zeromethod.contact.outline import first_outline
from zeromethod.contact.polygon import perimeter, signed_area
from zeromethod.contact.track import ContactTrack
from zeromethod.optics import Optics
from zeromethod.rig.model import Rig
from zeromethod.sensing.residual import Residual
from zeromethod.surface import Peak, Surface
from zeromethod.warp.grid import NodeGrid
from zeromethod.warp.validity import Flag

LEFT_SHARE = 0.5
"""Amplitude over that at rest below which a node lies in a contact."""
_WHOLE_SHARE = 0.3
"""The same in the middle of a contact, below which one frame shows it as it is, as it was there for most of
the exposure: planted fingers were 0.4 mm off at most, pieces of fingers that came half-way had 0.39."""
_FINE = 4
"""Points between nodes at which the border is looked for, along either axis."""
_LEAST_NODES = 3
"""Area, in nodes, below which nothing is called a contact: half a window's, more than noise takes."""
_PLACE = 0.25
"""Standard deviation of a centroid over the spacing of nodes: planted fingers, lit and dark, were 0.2 off."""
_EDGE = 0.5
"""The same of the border, across itself: where the amplitude falls, a window is half over it."""
_AREA_SHARE = 0.29
"""The same of the area over itself: mirror beside the border, which bends too fast for a window, makes up to
half of it. Any share up to that is as likely: rms 0.5 / sqrt(3)."""
_LEAST_SIGMAS, _LEAST_STRAIN = 3.0, 0.002
"""Of a force, by its sigma, and of its mean pressure over the modulus: a ball that flattens 2 mm so gently
has a radius of 0.2 m; planted fingers were above 0.01, what a gone one leaves below 0.0005."""
_STILL = 0.5
"""The least for one that pressed before, over that: nearly all that gone fingers left behind was below."""
_NOTHING = Probability(0, 0, np.zeros((0, 0), np.float32))


class ThreadFinder(ContactFinder):
    """Finds what presses a cloth on the mirror; used as a `ContactFinder`."""

    def __init__(self, rig: Rig, optics: Optics, grid: NodeGrid) -> None:
        super().__init__(rig, optics, grid)
        self._track = ContactTrack(whole=lambda one: one.carrier_left < _WHOLE_SHARE, left=self._has_left)
        self._first_px = np.array([grid.u_px[0], grid.v_px[0]], dtype=np.float64)
        self._modulus_mpa = rig.rubber.youngs_modulus_mpa or 0.0
        self._down: set[int] = set()

    def _found(
        self,
        image: Image,  # noqa: ARG002 (grey levels say nothing under a picture)
        residual: Residual,
        surface: Surface,
    ) -> Iterable[Contact | None]:
        left = self._left = self._rest.left(residual)
        self._weak = residual.flags & np.uint16(Flag.MODULATION) != 0
        near = np.argwhere(left < LEFT_SHARE)
        if len(near) < _LEAST_NODES:
            return []
        (row, col), (last_row, last_col) = np.maximum(near.min(axis=0) - 2, 0), near.max(axis=0) + 3
        part = np.ascontiguousarray(left[row:last_row, col:last_col])
        size = part.shape[1] * _FINE, part.shape[0] * _FINE
        fine = np.asarray(cv2.resize(part, size, interpolation=cv2.INTER_CUBIC), np.float32)
        count, labels, stats, _ = cv2.connectedComponentsWithStats((fine < LEFT_SHARE).astype(np.uint8))
        found = [
            self._pressed(labels == k, fine, (int(col), int(row)), surface)
            for k in range(1, count)
            if stats[k, cv2.CC_STAT_AREA] >= _LEAST_NODES * _FINE**2
        ]
        return sorted((one for one in found if one is not None), key=lambda one: -one.area_mm2)

    def carry(
        self, surface: Surface, deepest: Peak, contacts: tuple[Contact, ...], fit: ForceFit | None
    ) -> tuple[Surface, Peak, tuple[Contact, ...]]:
        """As `ContactFinder.carry`, with those that are not named yet, which are in `fit`, too.

        Contacts in which nothing presses are left out, are lifted, and are others if they press again.
        """
        surface, deepest, carried = super().carry(surface, deepest, (*contacts, *self.unnamed), fit)
        pressing = tuple(_newly_come(one) for one in carried[: len(contacts)] if self._presses(one))
        pressed = {one.id for one in pressing}
        for number in self._down & {one.id for one in contacts} - pressed:
            self._track.renew(number, surface.time_ns)
        self._down = pressed | self._down & self.followed
        return surface, deepest, pressing

    def _has_left(self, contact: Contact) -> bool:
        """Whether carriers are seen again in the middle of where a contact was."""
        around = self._around(contact.outline_px)
        return bool(self._left[around].mean() >= LEFT_SHARE and not self._weak[around].any())

    def _presses(self, contact: Contact) -> bool:
        """Whether a force presses there, or none could be read."""
        if math.isnan(contact.force_n):
            return True
        least = max(
            _LEAST_SIGMAS * contact.sigma_force_n, _LEAST_STRAIN * self._modulus_mpa * contact.area_mm2
        )
        return contact.force_n > least * (_STILL if contact.id in self._down else 1.0)

    def _named(self, found: list[Contact], surface: Surface) -> tuple[Contact, ...]:
        named = super()._named(found, surface)
        known = {id(one.outline_mm) for one in named}
        self.unnamed = tuple(one for one in found if id(one.outline_mm) not in known)
        return named

    def _pressed(self, mask: Mask, left: Single, corner: tuple[int, int], surface: Surface) -> Contact | None:
        """The contact of a piece of the fine map whose first node is `corner` (column, row)."""
        # a contact on one line of points has no border
        points_px = self._px(first_outline(mask), corner)
        weight = np.where(mask, 1 - left, 0.0)
        rows, cols = np.indices(mask.shape)
        middle = np.array([[(weight * cols).sum(), (weight * rows).sum()]]) / weight.sum()
        seen = self._places.seen(points_px, surface)
        outline_mm = seen.outline_mm
        if signed_area(outline_mm) < 0:  # the camera sees the mirror mirrored
            outline_mm, points_px = outline_mm[::-1], points_px[::-1]
        shape = moments(outline_mm)
        if shape.area_mm2 < LEAST_MM2:
            return None
        px = self._px(middle, corner)
        # the centroid by amplitude is better than the border's, from which it is taken to mm
        x, y = self._places.beside(px, points_px.mean(axis=0), outline_mm.mean(axis=0))
        spacing_mm = self._grid.spacing_px * float(np.sqrt(shape.area_mm2 / abs(signed_area(points_px))))
        edge = _EDGE * spacing_mm
        sigma_x, sigma_y = (float(np.hypot(part, _PLACE * spacing_mm)) for part in seen.sigma_mm)
        return Contact(
            id=0,
            **(shape._asdict() | {"x_mm": x, "y_mm": y}),
            sigma_x_mm=sigma_x,
            sigma_y_mm=sigma_y,
            sigma_area_mm2=math.hypot(edge * perimeter(outline_mm), _AREA_SHARE * shape.area_mm2),
            outline_mm=outline_mm,
            sigma_edge_mm=edge,
            outline_px=points_px,
            scattered=float("nan"),
            probability=_NOTHING,
            carrier_left=float(self._left[self._around(points_px)].mean()),
        )

    def _px(self, fine: Float, corner: tuple[int, int]) -> Float:
        """Camera px of points (n, 2) (column, row) of the fine map."""
        nodes = (fine + 0.5) / _FINE - 0.5 + np.array(corner)
        return np.asarray(self._first_px + nodes * self._grid.spacing_px)

    def _around(self, outline_px: Float) -> tuple[slice, slice]:
        """The 3 x 3 nodes in the middle of a border."""
        col, row = np.rint((outline_px.mean(axis=0) - self._first_px) / self._grid.spacing_px).astype(int)
        return np.s_[max(row - 1, 0) : row + 2, max(col - 1, 0) : col + 2]


def _newly_come(contact: Contact) -> Contact:
    """The contact; in its first frame with the share of its force open by which it may have come late."""
    if contact.age_s > 0:
        return contact
    open_n = contact.carrier_left * contact.force_n
    return replace(contact, sigma_force_n=math.hypot(contact.sigma_force_n, open_n))


def finder_of(rig: Rig, optics: Optics, grid: NodeGrid) -> ContactFinder:
    """The finder that a rig needs."""
    return (ThreadFinder if rig.under_cloth else ContactFinder)(rig, optics, grid)
