"""Meshes as trimesh reads them: millimetres, the dent's own volume, no triangle over what was not read."""

import numpy as np
import pytest
import trimesh

from zeromethod.export import Selection, prepare
from zeromethod.export.mesh import surface_points
from zeromethod.optics.mirror import Sphere

DEEPEST_MM, WIDTH_MM, CENTRE_MM = 0.2, 6.0, (42.0, 3.0)
"""The planted dent of the last step."""


@pytest.mark.parametrize("form", ["ply", "stl"])
def test_the_deepest_time_is_a_mesh_in_mm(form, recording, tmp_path):
    path = tmp_path / f"a.{form}"
    figures = prepare(recording, path).write()
    assert figures["time_s"] == pytest.approx(0.22)
    mesh = trimesh.load_mesh(path)
    lowest = mesh.vertices[np.argmin(mesh.vertices[:, 2])]
    # The node next to the middle, at most 0.9 mm off: exp(-0.9^2 / 72) of the depth.
    assert -DEEPEST_MM <= lowest[2] < -0.988 * DEEPEST_MM
    assert np.hypot(*(lowest[:2] - CENTRE_MM)) < 0.9
    # Volume under the rest plane, by faces of up to 1.7 mm; the view ends 2.1 widths above the middle.
    corners = mesh.triangles
    along, across = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    area = 0.5 * (along[:, 0] * across[:, 1] - along[:, 1] * across[:, 0])
    volume = -(area * corners[..., 2].mean(axis=-1)).sum()
    # That leaves 98.2 % of a Gaussian.
    in_view = 0.982 * 2.0 * np.pi * WIDTH_MM**2 * DEEPEST_MM
    assert volume == pytest.approx(in_view, rel=0.02)
    # All faces look out of the rubber.
    assert area.min() > 0.0
    assert mesh.face_normals[:, 2].min() > 0.9


def test_vertices_carry_depth_and_sigma_and_the_header_the_unit(planted, recording, tmp_path):
    path = tmp_path / "a.ply"
    figures = prepare(recording, path, selection=Selection(at_s=0.041)).write()
    # Step 3, at 0.04 s, is the nearest.
    assert figures["time_s"] == pytest.approx(0.04)
    header = path.read_bytes().split(b"end_header")[0].decode()
    assert header.startswith("ply\nformat binary_little_endian 1.0\ncomment zeromethod: mm;")
    raw = trimesh.load_mesh(path).metadata["_ply_raw"]["vertex"]["data"]
    assert raw["depth_mm"].max() == pytest.approx(-raw["z"].min())
    assert raw["depth_mm"] == pytest.approx(planted.depth_at(3, raw["x"], raw["y"]), abs=2e-7)
    assert raw["sigma_depth_mm"] == pytest.approx(1e-4, rel=1e-6)


def test_nodes_that_were_not_read_leave_a_hole(recording, tmp_path):
    prepare(recording, tmp_path / "a.stl").write()
    surface = recording.surface(9)
    hole = surface.contact
    mesh = trimesh.load_mesh(tmp_path / "a.stl")
    for x, y in zip(surface.x_mm[hole], surface.y_mm[hole], strict=True):
        assert np.hypot(mesh.vertices[:, 0] - x, mesh.vertices[:, 1] - y).min() > 0.5
    # One outline round everything, one round the hole.
    assert len(mesh.outline().entities) == 2


def test_on_a_curved_mirror_depth_starts_at_its_rest(recording):
    surface, rest = recording.surface(9), Sphere(200.0, (40.0, 0.0))
    points = surface_points(surface, rest)
    j, i = 12, 20
    x, y = surface.x_mm[j, i], surface.y_mm[j, i]
    sagitta = np.sqrt(200.0**2 - (x - 40.0) ** 2 - y**2) - 200.0
    assert points[j, i] == pytest.approx([x, y, sagitta - surface.depth_mm[j, i]], abs=1e-12)
    assert np.isnan(points[surface.contact, 2]).all()
