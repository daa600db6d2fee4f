"""The TIFF as tifffile and any other reader of OME or plain TIFF finds it."""

from xml.etree import ElementTree

import numpy as np
import pytest
import tifffile

from zeromethod.export import Selection, prepare

WIDTH_MM = 6.0
"""Of the planted dent."""

OME = {"ome": "http://www.openmicroscopy.org/Schemas/OME/2016-06"}


def test_pages_are_maps_in_mm_on_the_lattice_given(planted, recording, tmp_path):
    figures = prepare(recording, tmp_path / "a.tif", pitch_mm=0.5).write()
    with tifffile.TiffFile(tmp_path / "a.tif") as file:
        assert file.series[0].axes == "TCYX"
        assert file.pages[0].dtype == np.float32
        maps = file.asarray()
    assert maps.shape == (8, 3, figures["rows"], figures["columns"])
    x, y = np.meshgrid(
        figures["x0_mm"] + 0.5 * np.arange(figures["columns"]),
        figures["y0_mm"] + 0.5 * np.arange(figures["rows"]),
    )
    for k, step in enumerate(range(2, 10)):
        read = np.isfinite(maps[k, 0])
        assert read.mean() > 0.9
        peak = planted.depth_mm[step - 1]
        # Nodes of this bench lie up to 1.7 mm apart, and the dent is 6 mm wide: 0.1 % by the cubic.
        assert np.abs(maps[k, 0] - planted.depth_at(step, x, y))[read].max() < 1.5e-3 * peak
        slope = np.moveaxis(maps[k, 1:], 0, -1)
        steepest = peak / WIDTH_MM * np.exp(-0.5)
        assert np.abs(slope - planted.slope_at(step, x, y))[read].max() < 1e-2 * steepest


def test_spacing_names_and_times_carry_their_units(planted, recording, tmp_path):
    figures = prepare(recording, tmp_path / "a.tif").write()
    with tifffile.TiffFile(tmp_path / "a.tif") as file:
        page = file.pages[0]
        # Plain TIFF knows cm: pixels per cm.
        assert page.tags["ResolutionUnit"].value == 3
        per_cm = page.tags["XResolution"].value
        assert per_cm[0] / per_cm[1] == pytest.approx(10.0 / figures["pitch_mm"], rel=1e-6)
        pixels = ElementTree.fromstring(file.ome_metadata).find("ome:Image/ome:Pixels", OME)
    for axis in "XY":
        assert float(pixels.get(f"PhysicalSize{axis}")) == figures["pitch_mm"]
        assert pixels.get(f"PhysicalSize{axis}Unit") == "mm"
    channels = [channel.get("Name") for channel in pixels.findall("ome:Channel", OME)]
    assert channels == ["depth, mm", "slope d depth / dx, rad", "slope d depth / dy, rad"]
    planes = pixels.findall("ome:Plane", OME)
    assert len(planes) == 24
    for plane in planes:
        assert plane.get("DeltaTUnit") == "s"
        assert float(plane.get("DeltaT")) == pytest.approx(
            planted.time_s[1 + int(plane.get("TheT"))], abs=1e-9
        )
        assert (float(plane.get("PositionX")), plane.get("PositionXUnit")) == (figures["x0_mm"], "mm")


def test_a_single_time_is_a_tiff_as_well(recording, tmp_path):
    prepare(recording, tmp_path / "a.tiff", selection=Selection(from_s=0.1, to_s=0.1)).write()
    assert tifffile.imread(tmp_path / "a.tiff").shape[0] == 3
