"""The simulated bench as a rig file describes it: clocks, stray light, planted faults, nuisances."""

from __future__ import annotations

from typing import Literal

from zeromethod.rig.tables import Count, Lag, LitShare, NotNegative, Rate, Share, Table, Vector2, Vector3


class Faults(Table):
    """Planted faults of the simulated devices; frame numbers count from 0, None = never.

    From frame `moved_at_frame` on, or evenly over `moved_over_frames` from there, the camera is turned by
    `camera_turned_deg` (about its v axis, about its u axis, about its line of sight) and the LCD slid by
    `display_slid_mm` (away from P0, along y), which the rig file's geometry then no longer has. `watch`: what
    the watch camera does from, to `watch_s`.
    """

    drop_frames: tuple[Count, ...] = ()
    repeat_frames: tuple[Count, ...] = ()
    late_frames: tuple[Count, ...] = ()
    late_s: NotNegative = 0.05
    torn_frames: tuple[Count, ...] = ()
    stall_at_frame: Count | None = None
    stall_s: NotNegative = 0.0
    camera_lost_at_frame: Count | None = None
    camera_back_after_s: NotNegative | None = None
    display_lost_at_show: Count | None = None
    moved_at_frame: Count | None = None
    moved_over_frames: Count = 0
    camera_turned_deg: Vector3 = (0.0, 0.0, 0.0)
    display_slid_mm: Vector2 = (0.0, 0.0)
    light_off_frames: tuple[Count, Count] | None = None
    watch: Literal["none", "stall", "lost", "repeat", "dark"] = "none"
    watch_s: Vector2 = (0.0, 0.0)


class Nuisances(Table):
    """What the simulated bench suffers besides presses, `simulation.ambient` apart.

    `mains`: light of lamps on the mains, on average, as a share of full scale; it swings to nothing and back
    `mains_hz` times a second. `backlight_per_minute`: growth of the LCD's light, relative. `dust`,
    `scratches` (on the camera face), `bubbles` (in the rubber): how many in view. `kelvin_per_minute`: how
    fast the rubber grows warmer, which then is not as the rig file has it. `pixel_gain`, `pixel_offset_grey`:
    fixed pattern of the chip, standard deviations of a pixel's own gain (relative) and black level.
    What the watch camera sees of the room: `room_light`, the relative swing of its light, slow and at once,
    and `room_shadows`, how many shadows wander over it at a time.
    """

    mains: Share = 0.0
    mains_hz: Rate = 100.0
    backlight_per_minute: float = 0.0
    dust: Count = 0
    scratches: Count = 0
    bubbles: Count = 0
    kelvin_per_minute: float = 0.0
    pixel_gain: NotNegative = 0.0
    pixel_offset_grey: NotNegative = 0.0
    room_light: Share = 0.0
    room_shadows: Count = 0


class SimulationSpec(Table):
    """The simulated bench's own clocks, stray light and faults, which reading never uses.

    Unset rates equal the rig's. `camera_phase`: start of the first
    exposure, in camera frames after time 0. `camera_latency_s`: end of exposure to frame in hand.
    `ghost_faces`, `ghost_gap`: light of the second reflections (both prism faces; pattern face and LCD
    glass across the gap) relative to the main one. `ambient`: stray light, share of full scale.
    `projector_off_mm`: how far from `projector.corners_mm` the corners truly are.
    """

    seed: Count = 0
    renderer: Literal["gpu", "numpy"] = "gpu"
    display_refresh_hz: Rate | None = None
    display_jitter_s: Lag = 0.0
    camera_rate_hz: Rate | None = None
    camera_phase: float = 0.0
    camera_jitter_s: Lag = 0.0
    camera_latency_s: Lag = 0.004
    peak_grey_share: LitShare = 0.8
    ghost_faces: Share = 0.0
    ghost_gap: Share = 0.0
    ambient: Share = 0.0
    projector_off_mm: tuple[Vector2, Vector2, Vector2, Vector2] = ((0.0, 0.0),) * 4
    faults: Faults = Faults()
    nuisances: Nuisances = Nuisances()
