"""A burst: where no picture can null, coded pictures read the warp absolutely while the rest stays nulled.

Where a mirror is bent too strongly the carrier is too fine for the LCD, or several pixels look at one place
of it. Fringes at fixed places of the panel are read by every pixel for itself. They are drawn only where such
nodes may look, one after the other, each until an exposure has seen it alone. Meanwhile the command is kept,
and so is what was known of nodes that see fringes, as long as all others are at rest. What was read counts
until the nodes around have moved.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from zeromethod.arrays import Float, Image, Mask, Single
from zeromethod.decoding.burst import RADIUS_PX, moves, node_places, pixel_places
from zeromethod.exposure.pairing import Observation
from zeromethod.loop.failing_nodes import CANNOT, REACH_NODES, FailingNodes, grown, joined_to
from zeromethod.loop.node_figures import quiet_share
from zeromethod.pattern.coded import MOST_PARTS, PICTURES, SHIFTS, Coded
from zeromethod.sensing.residual import Residual
from zeromethod.warp.rest import Rest
from zeromethod.warp.validity import Flag
from zeromethod.warp.warp import Warp

LEAST_NODES = 8
"""Number of nodes that cannot be nulled from which on a burst is needed."""

MOVES_SHARE, BROKEN_FRAMES = 0.02, 30
"""A burst is broken off when more than this share of the pixels moves between its pictures; the next one
begins this many frames later at the earliest."""

LONGEST_S = 5.0
"""A burst that takes longer is broken off: no exposure sees one of its pictures alone."""

QUIET_LCD_PX, QUIET_SHARE, QUIET_FRAMES = 0.1, 0.9, 24
"""The mirror is at rest when this share of the other nodes moves less than this, for this many frames."""

MOVED_LCD_PX, MOVED_FROM, OLD_S = 0.05, 0.75, 5.0
"""What was read is dropped when the nodes around it, or those inside that see the carrier, move by more than
this (upper quartile). It is read again after OLD_S in any case: the picture drawn by it may hide a change."""

CARRIED = 3.0
"""Possible motion of the nodes inside, over the motion seen around them; it widens their sigma."""

RING_NODES = 4
"""Width of the ring of nodes around those read, whose motion is watched."""

SPARE_NODES = 3
"""Width of the ring of nodes that are read as spares: some may fail once what was read is drawn."""

BLIND_NODES = 2
"""A node this close to one that sees fringes has them in its window."""

MARGIN_LCD_PX, MARGIN_SHARE = 8.0, 0.25
"""Margin of a part of the LCD around the places where its nodes are thought to look: this many px, and this
share of their displacement."""

EDGE_LCD_PX = 4.0
"""Pixels that look this close to the end of a part are not used: they may also see the picture next to it."""

KEPT_LCD_PX = 0.03
"""Possible motion of a node that sees fringes, since it was known, while all other nodes are at rest."""

_ALL = 0.999
"""Share of the nodes around a pixel, weighted by nearness, that must be known for the pixel's place to be."""

_PURE = 5e-3
"""Largest share of another picture's light in an exposure that counts as of one picture alone."""

_CODED = np.uint16(Flag.CODED)


@dataclass(frozen=True, slots=True)
class Read:
    """What a burst read.

    q, sigma: (rows, cols, 2) LCD px. mask: nodes that count by it. spare: nodes around these that do where
    they fail. region: nodes that wait for no other burst. ring, ring_q: nodes around that are watched.
    places, known: (h, w, 2) LCD px of single pixels, and which were read, from the image's row `top` and
    column `left` on. time_ns: of the last picture.
    """

    q: Float
    sigma: Float
    mask: Mask
    spare: Mask
    region: Mask
    ring: Mask
    ring_q: Float
    places: Float
    known: Mask
    top: int
    left: int
    time_ns: int


class _Running:
    """A burst under way: its parts of the LCD, its crop of the image, and the pictures seen so far."""

    def __init__(self, rest: Rest, need: Mask, thought: Float, measured: Warp) -> None:
        """need: (rows, cols) nodes that cannot be nulled. thought: (rows, cols, 2) LCD px, where all look."""
        self.known, self.thought = measured.valid & ~need, thought
        self.sigma: Float = np.hypot(measured.sigma, KEPT_LCD_PX)
        grid = rest.grid
        region = joined_to(self.known, need, grid.measurable)
        count, labels, stats, _ = cv2.connectedComponentsWithStats(region.astype(np.uint8), connectivity=8)
        largest = 1 + np.argsort(-stats[1:count, cv2.CC_STAT_AREA])[:MOST_PARTS]
        self.region: Mask = np.isin(labels, largest)
        parts = []
        for label in largest:
            seen, moved = thought[labels == label], (thought - rest.q)[labels == label]
            margin = MARGIN_LCD_PX + MARGIN_SHARE * float(np.abs(moved).max())
            parts.append([*(seen.min(axis=0) - margin), *(seen.max(axis=0) + margin)])
        self.parts: Float = np.array(parts)
        self.blind: Mask = grown(self._inside(thought, 0.0), BLIND_NODES) | self.region
        self.spare: Mask = grown(self.region, SPARE_NODES) & self.blind & grid.measurable & ~self.region
        self.nodes = np.argwhere(self.region | self.spare)
        rows, columns = grid.v_px[self.nodes[:, 0]].astype(int), grid.u_px[self.nodes[:, 1]].astype(int)
        self.top, self.left = max(int(rows.min()) - RADIUS_PX, 0), max(int(columns.min()) - RADIUS_PX, 0)
        self.bottom, self.right = int(rows.max()) + RADIUS_PX + 1, int(columns.max()) + RADIUS_PX + 1
        self.pixels = list(zip(rows - self.top, columns - self.left, strict=True))
        # between patches the target's dark troughs are noise alone, which looks like motion
        across = ((self.top, self.bottom), grid.v_px), ((self.left, self.right), grid.u_px)
        nearest = (np.rint((np.arange(*ends) - nodes[0]) / grid.spacing_px) for ends, nodes in across)
        self._own: Mask = self.region[np.ix_(*(one.astype(int) for one in nearest))]
        self.pictures: list[Single] = []
        self._sum, self._count = np.zeros_like(thought), np.zeros(thought.shape[:2], np.int64)
        self._rest = rest
        self.since_ns = measured.time_ns

    def _inside(self, q: Float, margin_lcd_px: float) -> Mask:
        """Which places (..., 2) LCD px lie in a part, by so much from its ends."""
        inside: Mask = np.zeros(q.shape[:-1], np.bool_)
        for part in self.parts:
            low, high = part[:2] + margin_lcd_px, part[2:] - margin_lcd_px
            inside |= np.logical_and(q >= low, q <= high).all(axis=-1)
        return inside

    @property
    def coded(self) -> Coded:
        """The picture to be seen next."""
        return Coded(len(self.pictures), self.parts)

    def add(self, image: Image, black_grey: float) -> bool:
        """Take in the picture waited for; whether nothing has moved between those of one period."""
        self.pictures.append(image[self.top : self.bottom, self.left : self.right].astype(np.float32))
        if len(self.pictures) % SHIFTS:
            return True
        moved = moves(np.stack(self.pictures[-SHIFTS:]), black_grey)
        return float(np.mean(moved[self._own])) < MOVES_SHARE

    def watch(self, measured: Warp) -> None:
        """Take in where the other nodes look."""
        valid = measured.valid & ~self.blind
        self._sum[valid] += measured.q[valid]
        self._count += valid

    def read(self, black_grey: float, time_ns: int) -> Read:
        """What all pictures say."""
        grid = self._rest.grid
        v, u = np.mgrid[self.top : self.bottom, self.left : self.right].astype(np.float32)
        lattice = (u - grid.u_px[0]) / grid.spacing_px, (v - grid.v_px[0]) / grid.spacing_px
        column, row = (np.ascontiguousarray(one, np.float32) for one in lattice)
        thought = cv2.remap(self.thought.astype(np.float32), column, row, cv2.INTER_LINEAR)
        near = cv2.remap(self.known.astype(np.float32), column, row, cv2.INTER_LINEAR)
        stack, sure = np.stack(self.pictures), near > _ALL
        places, known = pixel_places(stack, black_grey, thought.astype(np.float64), sure)
        known &= self._inside(places, EDGE_LCD_PX)
        found, off = node_places(places, known, self.pixels)
        q, sigma = np.full_like(self.thought, np.nan), np.full_like(self.thought, np.inf)
        rows, columns = self.nodes.T
        q[rows, columns], sigma[rows, columns] = found, off
        known_at: Mask = np.isfinite(q[..., 0])
        mask, spare = known_at & self.region, known_at & self.spare
        ring: Mask = grown(self.blind, RING_NODES) & ~self.blind & (self._count >= PICTURES // 2)
        ring_q = self._sum / np.maximum(self._count, 1)[..., None]
        nodes = mask, spare, self.region | spare, ring
        return Read(q, sigma, *nodes, ring_q, places, known, self.top, self.left, time_ns)


class Burst:
    """Decides when a burst is needed, runs it, and puts what it read into measured warps.

    always: begin another one as soon as one is over.
    """

    def __init__(self, rest: Rest, black_grey: float, *, always: bool) -> None:
        self._rest, self._black, self._always = rest, black_grey, always
        self._failing = FailingNodes(rest, black_grey)
        self._quiet = 0
        self._running: _Running | None = None
        self._blinding: _Running | None = None
        self.read: Read | None = None
        """What the last one read, until the mirror moves."""
        self.unread = False
        """Whether nodes wait for a burst that none has read, or one is under way for them."""
        self.lamp_image = False
        """Whether these have more light than at rest: a lamp's image, whose edges are no folds."""
        self.waits = False
        """Whether none may begin, and one under way ends: something is about to touch."""
        self._shown: dict[int, int | None] = {}

    @property
    def blinding(self) -> bool:
        """Whether the frame taken last may have seen fringes."""
        return self._blinding is not None

    @property
    def coded(self) -> Coded | None:
        """What is to be drawn over the command."""
        return None if self._running is None else self._running.coded

    def _seen(self, observation: Observation) -> set[int | None]:
        """Numbers of the coded pictures that a frame saw; None among them for a picture without."""
        lit = observation.weights.max(axis=1) > _PURE
        return {self._shown.get(int(time_ns)) for time_ns in observation.entries[lit]}

    def blinds(self, observation: Observation) -> Mask | None:
        """Nodes (rows, cols) that may see fringes in a frame; None for none."""
        if self._blinding is None or (self._running is None and self._seen(observation) == {None}):
            return None
        return self._blinding.blind

    def take_reference(self, residual: Residual) -> None:
        """Take the light at rest from a residual, and which nodes fail even then."""
        self._failing.take_reference(residual)

    def presented(self, time_ns: int, coded: int | None) -> None:
        """Note the number of the coded picture presented at a time, None for none."""
        self._shown[time_ns] = coded
        while len(self._shown) > 64:
            del self._shown[next(iter(self._shown))]

    def take(
        self, image: Image, observation: Observation, residual: Residual, measured: Warp, thought: Float
    ) -> bool:
        """Take in a frame; whether what is to be drawn has changed.

        thought: (rows, cols, 2) LCD px, where nodes were thought to look before this frame.
        """
        seen, running = self._seen(observation), self._running
        if running is None:
            if seen != {None}:
                return False
            self._blinding = None
            return self._needed(residual, measured, thought)
        late = measured.time_ns - running.since_ns > 1e9 * LONGEST_S
        if late or self.waits or not self._at_rest(measured, thought, running.blind):
            self._running, self._quiet = None, -BROKEN_FRAMES
            return True
        running.watch(measured)
        if seen != {len(running.pictures)}:
            return False
        if not running.add(image, self._black):
            self._running, self._quiet = None, -BROKEN_FRAMES
        elif len(running.pictures) == PICTURES:
            self.read, self._running, self._quiet = running.read(self._black, measured.time_ns), None, 0
            self._failing.forget()
        return True

    def _needed(self, residual: Residual, measured: Warp, thought: Float) -> bool:
        """Begin a burst where one is needed, and may be."""
        failing = self._failing.look(residual, measured, thought)
        if failing is None:
            self._quiet, self.unread = min(self._quiet, 0), False
            return False
        need = self._failing.need
        at_rest = self._at_rest(measured, thought, grown(failing | need, REACH_NODES))
        self._quiet = self._quiet + 1 if at_rest and not self._failing.grows else min(self._quiet, 0)
        if not at_rest:
            self._failing.forget()
            self.unread = False
            return False
        new = need if self.read is None else need & ~self.read.region
        unread = int(np.count_nonzero(new)) >= LEAST_NODES
        again = self._always or (self.read is not None and measured.time_ns > self.read.time_ns + 1e9 * OLD_S)
        # what failed for some frames only, as after a sudden press, is no reason to wait any more
        self.unread = int(np.count_nonzero(new & failing)) >= LEAST_NODES
        self.lamp_image = self.unread and self._failing.brighter(residual, new & failing)
        wanted = need if again else new
        if not self._always:
            wanted = wanted & self._failing.lasting
        if np.count_nonzero(wanted) < LEAST_NODES or self._quiet < QUIET_FRAMES or self.waits:
            return False
        self.unread = unread
        self._running = self._blinding = _Running(self._rest, need, thought, measured)
        return True

    def _at_rest(self, measured: Warp, thought: Float, apart: Mask) -> bool:
        """Whether nodes other than these stay where they were."""
        return quiet_share(measured.q, thought, measured.flags, apart, QUIET_LCD_PX) > QUIET_SHARE

    def merge(self, measured: Warp) -> Mask | None:
        """Put into a measured warp what bursts have read; returns those nodes (rows, cols), None for none."""
        if self._blinding is not None:
            return self._keep_known(self._blinding, measured)
        read = self.read
        if read is None:
            return None
        around = _moved2(measured, read.ring_q, measured.sigma, read.ring)
        inside = _moved2(measured, read.q, np.hypot(measured.sigma, read.sigma), read.mask)
        moved2 = max(around, inside)
        if moved2 > MOVED_LCD_PX**2:
            self.read = None
            self._failing.forget()
            return None
        nodes: Mask = read.mask | (read.spare & (measured.flags & CANNOT != 0))
        measured.q[nodes] = read.q[nodes]
        measured.sigma[nodes] = np.sqrt(read.sigma[nodes] ** 2 + CARRIED**2 * moved2)
        measured.flags[nodes] = 0
        return nodes

    def _keep_known(self, burst: _Running, measured: Warp) -> Mask:
        """Keep what was known of nodes that see fringes; the others are flagged."""
        held: Mask = burst.blind & burst.known
        measured.q[held], measured.sigma[held], measured.flags[held] = (
            burst.thought[held],
            burst.sigma[held],
            0,
        )
        measured.flags[burst.blind & ~burst.known & self._rest.grid.measurable] |= _CODED
        return held


def _moved2(measured: Warp, before: Float, sigma: Float, nodes: Mask) -> float:
    """Upper quartile of the squared motion of some nodes, noise taken off, LCD px^2.

    Single nodes that differ more lie at the edge of what can be nulled. Infinite where too few are valid.
    """
    watched = nodes & measured.valid
    if np.count_nonzero(watched) < LEAST_NODES:
        return np.inf
    change2 = (measured.q[watched] - before[watched]) ** 2
    return max(float(np.quantile(change2 - 4 * sigma[watched] ** 2, MOVED_FROM)), 0.0)
