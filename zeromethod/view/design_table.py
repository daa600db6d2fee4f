"""The figures of a bench as tables."""

from __future__ import annotations

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from zeromethod.design.figures import HEADLINE_SIGMA_MM
from zeromethod.rig.model import MARK_HALF_PX
from zeromethod.view.table import Figures, cell, pair_table, text_table, titled

CURVES: tuple[tuple[str, str, tuple[tuple[str, str, str, str], ...]], ...] = (
    (
        "margin to the critical angle", "deg",
        (
            ("tir_margin_deg", "margin\ndeg", "{:.2f}", "middle of the view"),
            ("tir_least_margin_deg", "least margin\ndeg", "{:.2f}", "least of the view"),
        ),
    ),
    (
        "lever, slope along x", "px per mrad",
        (
            ("lcd_px_per_mrad", "LCD px\nper mrad", "{:.3f}", "LCD px"),
            ("camera_px_per_mrad", "camera px\nper mrad", "{:.3f}", "camera px"),
        ),
    ),
    ("depth, along x", "nm per camera px", (("depth_nm_per_px", "nm per\ncamera px", "{:.1f}", ""),)),
    (
        f"Gaussian press, sigma {HEADLINE_SIGMA_MM:g} mm: folds at", "mm",
        (("gaussian_fold_mm", "folds at\nmm", "{:.3f}", ""),),
    ),
    ("footprint of the lens's pupil, along x", "mm", (("footprint_mm", "footprint\nmm", "{:.3f}", ""),)),
    ("slope noise of one frame, along x", "µrad", (("slope_sigma_urad", "slope noise\nµrad", "{:.2f}", ""),)),
    ("mirror in view, along x", "mm", (("mirror_seen_mm", "mirror in view\nmm", "{:.1f}", ""),)),
    ("view that sees the LCD", "share", (("sees_lcd_share", "sees LCD", "{:.0%}", ""),)),
)  # fmt: skip
"""Every curve: the picture's title, unit; key, column head and pattern in the table, name in the legend."""

_PAIRS = (("lcd_px_per_mrad", "{:.3f}"), ("camera_px_per_mrad", "{:.3f}"), ("depth_nm_per_px", "{:.1f}"))


def design_table(figures: Figures, warnings: list[str]) -> Group:
    """Warnings first, then the figures region by region, then those of the whole bench."""
    parts: list[RenderableType] = [Text(f"warning: {words}", style="bold yellow") for words in warnings]
    if warnings:
        parts.append(Text())
    whole = (
        *_view_rows(figures["view"]),
        *_seam_rows(figures["seams"]),
        *_resolution_rows(figures["resolution"]),
        *_noise_rows(figures["noise"]),
        ("best period of the carrier", _best_period(figures["carrier"])),
        *_delay_rows(figures["delay"]),
    )
    tables = (
        *(*_margins(figures), *_levers(figures), *_presses(figures)),
        *(*_carriers(figures["carrier"]), *_motions(figures["motion"])),
    )
    return Group(*parts, *tables, pair_table(whole))


def curves_table(found: Figures) -> Table:
    """One row per value; a dash where the bench cannot work."""
    columns = [column for _, _, lines in CURVES for column in lines]
    rows = (
        (f"{value:.6g}", *(cell(found[key][index], pattern) for key, _, pattern, _ in columns))
        for index, value in enumerate(found["values"])
    )
    return text_table((found["key"], *(head for _, head, _, _ in columns)), rows, left=())


def _place(region: Figures) -> tuple[str, str]:
    return f"{region['x_mm']:.1f}", f"{region['y_mm']:+z.1f}"


def _margins(figures: Figures) -> list[RenderableType]:
    rows = []
    for region in figures["regions"]:
        loss = region["slope_to_loss_mrad"]
        margins = (f"{margin:+z.2f}" for margin in region["tir_margin_deg"])
        rows.append((*_place(region), *margins, f"{loss:.1f}" if loss > 0.0 else "at rest"))
    slopes = (f"{slope:g} mrad" for slope in figures["tir"]["slopes_mrad"])
    table = text_table(("x, mm", "y, mm", *slopes, "gone at, mrad"), rows, left=())
    return titled("Margin to the critical angle, deg, least of each region, by slope of the mirror", table)


def _levers(figures: Figures) -> list[RenderableType]:
    rows = (
        (
            *_place(region),
            f"{region['path_mm']:.1f}",
            *(", ".join(pattern.format(value) for value in region[key]) for key, pattern in _PAIRS),
            f"{1 / region['curvature_per_mm']:.0f}",
        )
        for region in figures["regions"]
    )
    heads = (
        "x, mm", "y, mm", "path, mm", "LCD px per mrad\nx, y", "camera px per mrad\nx, y",
        "nm per camera px\nx, y", "sharpest bend\nradius, mm",
    )  # fmt: skip
    return titled("Lever, for slope along x and along y", text_table(heads, rows, left=()))


def _presses(figures: Figures) -> list[RenderableType]:
    rows, places = [], []
    for press in figures["presses"]:
        limits = _middle_row(press["limits"])
        places = [f"at x = {one['x_mm']:.0f} mm" for one in limits]
        cells = (f"{_um(one['nulled_mm'])} ({_um(one['fold_mm'])}, {_um(one['total_mm'])})" for one in limits)
        rows.append((press["press"], *cells, ", ".join(sorted({one["because"] for one in limits} - {""}))))
    title = "Deepest press that can be nulled whole, µm (folds at, loses total reflection at)"
    return titled(title, text_table(("press, mm", *places, "ended by"), rows, left=()))


def _carriers(found: Figures) -> list[RenderableType]:
    marks = {found["present_px"]: " now", found["advised_px"]: " best"}
    rows = (
        (
            f"{row['period_px']}{marks.get(row['period_px'], '')}",
            f"{row['lcd_px']:.1f}",
            f"{row['modulation']:.3f}",
            f"{row['displacement_px']:.4f}",
            ", ".join(f"{one:.2f}" for one in row["slope_urad"]),
            cell(row["depth_rms_nm"], "{:.3g}"),
            f"{row['drawn_share']:.1%}",
            cell(row["bend_radius_mm"], "{:.0f}"),
            f"{row['tilt_mrad']:.2f}",
        )
        for row in found["curve"]
    )
    heads = (
        "period\ncamera px", "at rest\nLCD px", "modulation", "noise\ncamera px", "slope, µrad\nx, y",
        "depth\nnm", "nulled, share\nof fold", "sharpest bend\nradius, mm", "tilt in a\nframe, mrad",
    )  # fmt: skip
    return titled("Period of the carrier: noise of one frame, and limits", text_table(heads, rows, left=()))


def _best_period(found: Figures) -> str:
    share = f"{found['wanted_share']:.0%} of the fold limit"
    why = f"the least that the LCD can draw up to {share}" if found["because"] == "LCD" else "least noise"
    return f"{found['advised_px']} camera px (now {found['present_px']}): {why}"


def _motions(motion: Figures) -> list[RenderableType]:
    rows = [
        (group["motions"], f"{share:.1%}" if (share := group["share_under_press"]) > least else "no")
        for least in (motion["shows_from_share"],)
        for group in motion["groups"]
    ]
    edges = ", ".join(
        f"{name} {abs(px):.0f} camera px {'beyond' if px > 0 else 'inside'} the view"
        for name, px in motion["beyond_px"].items()
    )
    note = (
        "All show while nothing presses. Of those without a share, two places of the mirror known to rest "
        f"([[surface.known_rest]], not on one line) show it under a press; {_marks(motion)} ({edges})."
    )
    table = text_table(("camera, LCD or prism moved", "shows under a press"), rows)
    return [*titled("Motions of the bench that look alike", table), Text(note), Text()]


def _marks(motion: Figures) -> str:
    """What marks on the prism's frame show, and where there is room for them."""
    if motion["marks"]:
        watched = f"{motion['marks']} marks on the prism's frame ([surface] marks_px) are watched"
        return f"and of the camera's, {watched}"
    room = ", ".join(
        f"{MARK_HALF_PX} to {px:.0f} px from the {side}"
        for side, px in motion["mark_room_px"].items()
        if px >= MARK_HALF_PX
    )
    where = (
        f"room for their middles {room}"
        if room
        else "the picture in the mirror leaves no room: widen the view"
    )
    return (
        f"and of the camera's, marks on the prism's frame that it sees itself ([surface] marks_px; {where})"
    )


def _middle_row(limits: list[Figures]) -> list[Figures]:
    """Three of the places, by rising x: of each third of them the one nearest to the middle in y."""
    by_x = sorted(limits, key=lambda limit: limit["x_mm"])
    middle = sorted(limit["y_mm"] for limit in limits)[len(limits) // 2]
    count = min(3, len(by_x))
    thirds = (by_x[k * len(by_x) // count : (k + 1) * len(by_x) // count] for k in range(count))
    return [min(third, key=lambda limit: abs(limit["y_mm"] - middle)) for third in thirds]


def _um(depth_mm: float) -> str:
    return "any" if depth_mm == float("inf") else f"{1e3 * depth_mm:.3g}"


def _view_rows(view: Figures) -> list[tuple[str, str]]:
    x, y = view["mirror_x_mm"], view["mirror_y_mm"]
    mm, lcd = view["mirror_mm_per_px"], view["lcd_px_per_camera_px"]
    lost = ", ".join(f"{share:.1%} {why.replace('_', ' ')}" for why, share in view["lost_share"].items())
    shape = "one prism" if view["teeth"] is None else f"a saw of {view['teeth']} teeth"
    return [
        (
            "rubber",
            f"{shape}, {view['mirror_length_mm']:.1f} mm long, {view['thickness_mm']:.1f} mm thick",
        ),
        (
            "mirror in view",
            f"x {x[0]:.1f} to {x[1]:.1f} of {view['mirror_length_mm']:.1f} mm, y {y[0]:.1f} to {y[1]:.1f} mm",
        ),
        (
            "one camera px covers",
            f"{1e3 * mm[0]:.1f} x {1e3 * mm[1]:.1f} µm, {lcd[0]:.3f} x {lcd[1]:.3f} LCD px",
        ),
        (
            "LCD used",
            f"columns {view['lcd_columns'][0]:.0f} to {view['lcd_columns'][1]:.0f}, "
            f"rows {view['lcd_rows'][0]:.0f} to {view['lcd_rows'][1]:.0f}",
        ),
        ("view that sees the LCD", f"{view['sees_lcd_share']:.1%}" + (f" ({lost})" if lost else "")),
    ]


def _seam_rows(seams: Figures | None) -> list[tuple[str, str]]:
    if seams is None:
        return []
    band, pitch = seams["band_mm"], seams["pitch_mm"]
    hidden = f"{band:.2f} mm of every {pitch:.2f}, {seams['hidden_share']:.1%} of the mirror in view"
    return [("seams between teeth hide", hidden), ("nodes that see a seam", f"{seams['nodes_share']:.1%}")]


def _resolution_rows(found: Figures) -> list[tuple[str, str]]:
    width, good, frame = found["footprint_mm"], found["aperture_wavelength_mm"], found["frame_wavelength_mm"]
    nodes = found["node_spacing_mm"]
    whence = "assumed: give --pupil" if found["pupil_assumed"] else "as given"
    return [
        ("pupil of the lens", f"{found['pupil_mm']:g} mm ({whence})"),
        ("its footprint on the mirror", f"{width[0]:.3f} x {width[1]:.3f} mm"),
        ("waves of half height, for good", f"{good[0]:.2f} mm along x, {good[1]:.2f} mm along y"),
        ("waves of half height, one frame", f"{frame[0]:.2f} mm along x, {frame[1]:.2f} mm along y"),
        ("nodes apart", f"{nodes[0]:.3f} x {nodes[1]:.3f} mm"),
    ]


def _noise_rows(noise: Figures) -> list[tuple[str, str]]:
    slope = noise["slope_urad"]
    averaged = ", ".join(f"{one['depth_rms_nm']:.3g} nm of {one['frames']}" for one in noise["averaged"][1:])
    return [
        (
            "noise of one frame",
            f"{noise['displacement_px']:.4f} camera px, slope {slope[0]:.2f}, {slope[1]:.2f} µrad",
        ),
        ("", f"depth {noise['depth_rms_nm']:.3g} nm rms over the view"),
        ("of the mean of frames", averaged),
        ("LCD pixels' beat, stays", f"at most {noise['grid_bias_px']:.2g} camera px"),
        ("taken for white", f"{noise['peak_grey_share']:.0%} of the camera's full scale"),
    ]


def _delay_rows(delay: Figures) -> list[tuple[str, str]]:
    rows = []
    for step in delay["steps"]:
        mean_s, worst_s = step["mean_s"], step["worst_s"]
        worst = "" if worst_s == mean_s else f" (at worst {1e3 * worst_s:.1f})"
        rows.append((f"delay: {step['name']}", f"{1e3 * mean_s:.1f} ms{worst}"))
    whole = f"{1e3 * delay['mean_s']:.1f} ms, {delay['mean_frames']:.2f} frames"
    gains = ", ".join(f"{name} {gain:.2f}" for name, gain in delay["largest_gain"].items())
    return [
        *rows,
        ("delay round the loop", f"{whole}; at worst {delay['worst_frames']:.2f}"),
        ("largest stable gain", f"{gains} (the rig: {delay['controller']} {delay['gain']:g})"),
    ]
