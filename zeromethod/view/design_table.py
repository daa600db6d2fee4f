"""The figures of a bench as tables of plain words."""

from __future__ import annotations

from typing import Any

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

Figures = dict[str, Any]

_CURVES: tuple[tuple[str, str, str], ...] = (
    ("margin\ndeg", "tir_margin_deg", "{:.2f}"),
    ("least margin\ndeg", "tir_least_margin_deg", "{:.2f}"),
    ("LCD px\nper mrad", "lcd_px_per_mrad", "{:.3f}"),
    ("camera px\nper mrad", "camera_px_per_mrad", "{:.3f}"),
    ("nm per\ncamera px", "depth_nm_per_px", "{:.1f}"),
    ("folds at\nmm", "gaussian_fold_mm", "{:.3f}"),
    ("footprint\nmm", "footprint_mm", "{:.3f}"),
    ("slope noise\nurad", "slope_sigma_urad", "{:.2f}"),
    ("mirror seen\nmm", "mirror_seen_mm", "{:.1f}"),
    ("sees LCD", "sees_lcd_share", "{:.0%}"),
)


def design_table(figures: Figures, warnings: list[str]) -> Group:
    """Warnings first, then the figures region by region, then those of the whole bench."""
    parts: list[RenderableType] = [Text(f"warning: {words}", style="bold yellow") for words in warnings]
    parts += [Text()] if warnings else []
    parts += [*_margins(figures), *_levers(figures), *_presses(figures)]
    return Group(*parts, _whole(figures))


def curves_table(found: Figures) -> Table:
    """One row per value; a dash where the bench cannot work."""
    table = _table(found["key"], *(title for title, _, _ in _CURVES))
    for index, value in enumerate(found["values"]):
        cells = (
            "-" if found[key][index] is None else pattern.format(found[key][index])
            for _, key, pattern in _CURVES
        )
        table.add_row(f"{value:.6g}", *cells)
    return table


def _table(*titles: str) -> Table:
    table = Table(box=None, pad_edge=False)
    for title in titles:
        table.add_column(title, justify="right")
    return table


def _titled(title: str, table: Table) -> list[RenderableType]:
    return [Text(title, style="bold"), table, Text()]


def _place(region: Figures) -> tuple[str, str]:
    return f"{region['x_mm']:.1f}", f"{region['y_mm']:+.1f}"


def _margins(figures: Figures) -> list[RenderableType]:
    slopes = figures["tir"]["slopes_mrad"]
    table = _table("x, mm", "y, mm", *(f"{slope:g} mrad" for slope in slopes), "gone at, mrad")
    for region in figures["regions"]:
        margins = (f"{margin:+.2f}" for margin in region["tir_margin_deg"])
        loss = region["slope_to_loss_mrad"]
        table.add_row(*_place(region), *margins, f"{loss:.1f}" if loss > 0.0 else "at rest")
    return _titled("Margin to the critical angle, deg, least of each region, by slope of the mirror", table)


def _levers(figures: Figures) -> list[RenderableType]:
    table = _table(
        "x, mm", "y, mm", "path, mm", "LCD px per mrad\nx, y", "camera px per mrad\nx, y",
        "nm per camera px\nx, y", "sharpest bend\nradius, mm",
    )  # fmt: skip
    for region in figures["regions"]:
        table.add_row(
            *_place(region),
            f"{region['path_mm']:.1f}",
            _pair(region["lcd_px_per_mrad"], "{:.3f}"),
            _pair(region["camera_px_per_mrad"], "{:.3f}"),
            _pair(region["depth_nm_per_px"], "{:.1f}"),
            f"{1 / region['curvature_per_mm']:.0f}",
        )
    return _titled("Lever, for slope along x and along y", table)


def _pair(values: list[float], pattern: str) -> str:
    return ", ".join(pattern.format(value) for value in values)


def _presses(figures: Figures) -> list[RenderableType]:
    if not figures["presses"]:
        return []
    middle = _middle_row(figures["presses"][0]["limits"])
    table = _table(
        "press, mm", *(f"at x = {middle[k]['x_mm']:.0f} mm" for k in range(len(middle))), "ended by"
    )
    for press in figures["presses"]:
        limits = _middle_row(press["limits"])
        cells = (f"{_um(one['nulled_mm'])} ({_um(one['fold_mm'])}, {_um(one['total_mm'])})" for one in limits)
        table.add_row(press["press"], *cells, ", ".join(sorted({one["because"] for one in limits} - {""})))
    return _titled("Deepest press that can be nulled whole, um (folds at, loses total reflection at)", table)


def _middle_row(limits: list[Figures]) -> list[Figures]:
    """Three of the places, by rising x: of each third of them the one nearest to the middle in y."""
    by_x = sorted(limits, key=lambda limit: limit["x_mm"])
    middle = sorted(limit["y_mm"] for limit in limits)[len(limits) // 2]
    count = min(3, len(by_x))
    thirds = (by_x[k * len(by_x) // count : (k + 1) * len(by_x) // count] for k in range(count))
    return [min(third, key=lambda limit: abs(limit["y_mm"] - middle)) for third in thirds]


def _um(depth_mm: float) -> str:
    return "any" if depth_mm == float("inf") else f"{1e3 * depth_mm:.3g}"


def _whole(figures: Figures) -> Table:
    table = Table(show_header=False, box=None, pad_edge=False)
    table.add_column(style="dim")
    table.add_column()
    for label, words in (
        *_view_rows(figures["view"]),
        *_resolution_rows(figures["resolution"]),
        *_noise_rows(figures["noise"]),
        *_delay_rows(figures["delay"]),
    ):
        table.add_row(label, words)
    return table


def _view_rows(view: Figures) -> list[tuple[str, str]]:
    x, y, mm, lcd = (
        view["mirror_x_mm"],
        view["mirror_y_mm"],
        view["mirror_mm_per_px"],
        view["lcd_px_per_camera_px"],
    )
    rows = [
        (
            "mirror seen",
            f"x {x[0]:.1f} to {x[1]:.1f} of {view['mirror_length_mm']:.1f} mm, y {y[0]:.1f} to {y[1]:.1f} mm",
        ),
        (
            "one camera px covers",
            f"{1e3 * mm[0]:.1f} x {1e3 * mm[1]:.1f} um, {lcd[0]:.3f} x {lcd[1]:.3f} LCD px",
        ),
        (
            "LCD used",
            f"columns {view['lcd_columns'][0]:.0f} to {view['lcd_columns'][1]:.0f}, "
            f"rows {view['lcd_rows'][0]:.0f} to {view['lcd_rows'][1]:.0f}",
        ),
    ]
    lost = ", ".join(f"{share:.1%} {why.replace('_', ' ')}" for why, share in view["lost_share"].items())
    rows.append(("view that sees the LCD", f"{view['sees_lcd_share']:.1%}" + (f" ({lost})" if lost else "")))
    return rows


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
            f"{noise['displacement_px']:.4f} camera px, slope {slope[0]:.2f}, {slope[1]:.2f} urad",
        ),
        ("", f"depth {noise['depth_rms_nm']:.3g} nm rms over the view"),
        ("of the mean of frames", averaged),
        ("LCD pixels' beat, stays", f"at most {noise['grid_bias_px']:.2g} camera px"),
        ("taken for white", f"{noise['peak_grey_share']:.0%} of the camera's full scale"),
    ]


def _delay_rows(delay: Figures) -> list[tuple[str, str]]:
    rows = [
        (f"delay: {step['name']}", f"{1e3 * step['mean_s']:.1f} ms" + _worst(step)) for step in delay["steps"]
    ]
    rows.append((
        "delay round the loop",
        f"{1e3 * delay['mean_s']:.1f} ms, {delay['mean_frames']:.2f} frames; "
        f"at worst {delay['worst_frames']:.2f}",
    ))  # fmt: skip
    gains = delay["largest_gain"]
    words = ", ".join(f"{name} {gain:.2f}" for name, gain in gains.items())
    rows.append(("largest stable gain", f"{words} (the rig: {delay['controller']} {delay['gain']:g})"))
    return rows


def _worst(step: Figures) -> str:
    return "" if step["worst_s"] == step["mean_s"] else f" (at worst {1e3 * step['worst_s']:.1f})"
