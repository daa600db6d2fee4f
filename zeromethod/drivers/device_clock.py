"""The time of a frame's exposure: the camera's own clock mapped onto the run's, or the time of receipt."""

from __future__ import annotations

from collections import deque

BIN_NS = 500_000_000
BINS = 120
"""The map is fitted to the least delayed frame of each half second of the last minute."""

LEAST_SPAN_NS = 4 * BIN_NS
"""Before that, drift (1e-4 at worst: 0.2 ms) is less than what jitter would make of a slope."""

JUMP_NS = 1_000_000_000
"""A frame this far off the map means that one of the clocks was set."""


class DeviceClock:
    """Maps stamps of a device's clock onto the run's, given when their frames were received.

    A frame is received its stamp's true time plus a delay that is never below some least one. So all points
    (stamp, receipt) lie on or above a line whose slope is the ratio of the clocks, and the line is the
    supporting one from below that lies nearest to all points: an edge of their lower convex hull, over their
    mean stamp. Late frames, however late, do not move it. (Moon, Skelly and Towsley 1999,
    doi:10.1109/INFCOM.1999.749287.) What it returns is the stamp's time plus the least delay.
    """

    def __init__(self, tick_ns: float = 1.0) -> None:
        """tick_ns: length of one tick of the stamps, ns."""
        self._tick_ns = tick_ns
        self._restart()

    def _restart(self) -> None:
        # of each bin: its number, then stamp and (receipt - stamp) of the least delayed frame, relative to
        # the first frame's so that floats are exact to the nanosecond
        self._bins: deque[tuple[int, float, float]] = deque(maxlen=BINS)
        self._origin: tuple[float, int] | None = None
        self._last_ticks: int | None = None
        self._slope, self._height = 0.0, 0.0

    def map(self, ticks: int, received_ns: int) -> int:
        """Time of a stamp on the run's clock plus the least delay, ns; never after its receipt.

        Stamps must rise. One that does not, or lies a second off, restarts the map.
        """
        device_ns = ticks * self._tick_ns
        if self._last_ticks is not None and ticks <= self._last_ticks:
            self._restart()
        if self._origin is None:
            self._origin = device_ns, received_ns
        x = device_ns - self._origin[0]
        offset = (received_ns - self._origin[1]) - x
        if self._last_ticks is not None and abs(offset - self._at(x)) > JUMP_NS:
            self._restart()
            return self.map(ticks, received_ns)
        self._last_ticks = ticks
        self._add(x, offset)
        mapped = self._origin[1] + round(x + self._at(x))
        return min(mapped, received_ns)

    def _at(self, x: float) -> float:
        return self._height + self._slope * x

    def _add(self, x: float, offset: float) -> None:
        number = int(x // BIN_NS)
        if not self._bins or self._bins[-1][0] != number:
            self._bins.append((number, x, offset))
        elif offset - self._slope * x < self._bins[-1][2] - self._slope * self._bins[-1][1]:
            self._bins[-1] = (number, x, offset)
        else:
            return
        self._fit()

    def _fit(self) -> None:
        points = [(x, offset) for _, x, offset in self._bins]
        if points[-1][0] - points[0][0] < LEAST_SPAN_NS:
            self._slope, self._height = 0.0, min(offset for _, offset in points)
            return
        hull: list[tuple[float, float]] = []
        for point in points:
            while len(hull) > 1 and _right_of(hull[-2], hull[-1], point):
                hull.pop()
            hull.append(point)
        middle = sum(x for x, _ in points) / len(points)
        after = next(i for i in range(1, len(hull)) if hull[i][0] >= middle)
        (x0, y0), (x1, y1) = hull[after - 1], hull[after]
        self._slope = (y1 - y0) / (x1 - x0)
        self._height = y0 - self._slope * x0


def _right_of(a: tuple[float, float], b: tuple[float, float], c: tuple[float, float]) -> bool:
    """Whether b lies on or above the line from a to c, so not on the lower hull."""
    return (b[0] - a[0]) * (c[1] - a[1]) <= (b[1] - a[1]) * (c[0] - a[0])


class MidExposure:
    """Gives each frame the middle of its exposure on the run's clock, always rising.

    exposure_s: length of the exposure. latency_s: from its end until the frame is received, for the least
    delayed frame. clock: maps the device's stamps, where it has them.
    """

    def __init__(self, exposure_s: float, latency_s: float, clock: DeviceClock | None = None) -> None:
        self._latency_ns = round(1e9 * latency_s)
        self.set_exposure(exposure_s)
        self._clock = clock
        self._last_ns: int | None = None

    def set_exposure(self, exposure_s: float) -> None:
        """Take later frames as exposed for so long."""
        self.exposure_ns = max(1, round(1e9 * exposure_s))
        self._before_ns = self._latency_ns + self.exposure_ns // 2

    def of(self, received_ns: int, ticks: int = 0) -> int:
        """Middle of the exposure, ns, of a frame received at `received_ns`; ticks: its stamp, 0 = none."""
        at_ns = self._clock.map(ticks, received_ns) if self._clock and ticks > 0 else received_ns
        middle_ns = at_ns - self._before_ns
        if self._last_ns is not None:
            middle_ns = max(middle_ns, self._last_ns + 1)
        self._last_ns = middle_ns
        return middle_ns
