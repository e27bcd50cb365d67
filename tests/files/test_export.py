"""Animations written here are read by other people's readers: the same points, times, units and radii."""

from __future__ import annotations

import json
import struct
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import pyvista as pv

from yarnscale.errors import InputError
from yarnscale.files.animation import Animation, Moment, Surface, vertex_normals
from yarnscale.files.body_surface import ball
from yarnscale.files.curve_frames import CurveSet
from yarnscale.files.gltf import write_gltf
from yarnscale.files.obj import write_obj_frame
from yarnscale.files.obj_surface import read_obj_surface
from yarnscale.files.tube_sweep import TubeSweep
from yarnscale.files.usd import write_usd
from yarnscale.files.vtk_series import VtkSeries
from yarnscale.shell.mesh import rectangle

MESH = rectangle(0.1, 0.08, 0.02)
FLAT = np.column_stack([MESH.panel, np.zeros(MESH.vertex_count)])
TIMES = np.array([0.5, 0.6, 0.85])
CURVES = CurveSet([0, 6, 14], [1e-3] * 6 + [2e-3] * 8, closed=[False, True], yarn=[0, 1])
NAME = "Tuch mit ü und Leerzeichen"


def moment(index: int) -> Moment:
    """Cloth that bends and rises, an arc and a ring that grow, a ball that moves."""
    time = float(TIMES[index])
    cloth = FLAT.copy()
    cloth[:, 2] = time * (1 + 10 * cloth[:, 0] ** 2)
    arc = np.linspace(0, 2, 6)
    around = 2 * np.pi * np.arange(8) / 8
    yarns = np.vstack(
        [
            np.column_stack([np.cos(arc), np.sin(arc), 0 * arc]) * 0.1 * time,
            np.column_stack([np.cos(around), 0 * around, np.sin(around)]) * 0.05 * time,
        ]
    )
    radii = CURVES.radii * (1 + index)
    bodies = 0.02 * ball()[0] + [0, 0, time]
    velocities = np.tile([0.0, 0.1, time], (len(FLAT), 1))
    return Moment(time, cloth, velocities, yarns, radii, bodies)


WHOLE = Animation(TIMES, moment, Surface(MESH.triangles, MESH.material, MESH.corners), CURVES, Surface(ball()[1]))


def sewn() -> Animation:
    """Two triangles that share an edge in space but not in the fabric."""
    surface = Surface(
        np.array([[0, 1, 2], [1, 0, 3]]),
        np.array([[0, 0], [1, 0], [0, 1], [5, 5], [6, 5], [5, 6.0]]),
        np.array([[0, 1, 2], [3, 4, 5]]),
    )
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, -1, 0.0]])
    return Animation(np.zeros(1), lambda _: Moment(0.0, points), surface)


def test_usd_is_read_with_its_units_times_points_and_widths(tmp_path: Path) -> None:
    usd: Any = pytest.importorskip("pxr.Usd", reason="extra 'export'")
    from pxr import UsdGeom  # type: ignore[import-not-found]

    path = tmp_path / f"{NAME}.usdc"
    write_usd(path, WHOLE, fps=24)
    stage = usd.Stage.Open(str(path))
    assert UsdGeom.GetStageMetersPerUnit(stage) == 1.0 and UsdGeom.GetStageUpAxis(stage) == "Z"
    assert stage.GetTimeCodesPerSecond() == 24 and stage.GetDefaultPrim().GetPath() == "/yarnscale"
    assert (stage.GetStartTimeCode(), stage.GetEndTimeCode()) == pytest.approx((12, 20.4))
    cloth = UsdGeom.Mesh(stage.GetPrimAtPath("/yarnscale/cloth"))
    np.testing.assert_allclose(cloth.GetPointsAttr().GetTimeSamples(), TIMES * 24)
    np.testing.assert_array_equal(np.array(cloth.GetFaceVertexIndicesAttr().Get()).reshape(-1, 3), MESH.triangles)
    for k, time in enumerate(TIMES):
        code, here = time * 24, moment(k)
        assert here.cloth is not None and here.yarns is not None and here.radii is not None
        np.testing.assert_allclose(cloth.GetPointsAttr().Get(code), here.cloth, atol=1e-7)
        normals = vertex_normals(here.cloth, MESH.triangles)
        np.testing.assert_allclose(cloth.GetNormalsAttr().Get(code), normals, atol=1e-6)
        np.testing.assert_allclose(cloth.GetVelocitiesAttr().Get(code), here.velocities, rtol=1e-6)
        for name, part in (("yarns", slice(0, 6)), ("loops", slice(6, 14))):
            curves = UsdGeom.BasisCurves(stage.GetPrimAtPath(f"/yarnscale/{name}"))
            np.testing.assert_allclose(curves.GetPointsAttr().Get(code), here.yarns[part], atol=1e-7)
            np.testing.assert_allclose(curves.GetWidthsAttr().Get(code), 2 * here.radii[part], rtol=1e-6)
    loops = UsdGeom.BasisCurves(stage.GetPrimAtPath("/yarnscale/loops"))
    assert (loops.GetTypeAttr().Get(), loops.GetBasisAttr().Get()) == ("cubic", "catmullRom")
    assert loops.GetWrapAttr().Get() == "periodic" and list(loops.GetCurveVertexCountsAttr().Get()) == [8]
    # The measure of USD itself of how many numbers each interpolation takes.
    sizes = loops.ComputeVertexDataSize(usd.TimeCode(12)), loops.ComputeUniformDataSize(usd.TimeCode(12))
    assert sizes == (8, 1)
    halfway = 0.5 * (moment(0).cloth + moment(1).cloth)  # type: ignore[operator]
    np.testing.assert_allclose(cloth.GetPointsAttr().Get(24 * 0.55), halfway, atol=1e-6)


def test_usd_passes_its_own_validators(tmp_path: Path) -> None:
    usd: Any = pytest.importorskip("pxr.Usd", reason="extra 'export'")
    validation: Any = pytest.importorskip("pxr.UsdValidation", reason="older than usd-core 25.5")
    write_usd(tmp_path / "a.usdc", WHOLE)
    validators = validation.ValidationRegistry().GetOrLoadAllValidators()
    found = validation.ValidationContext(validators).Validate(usd.Stage.Open(str(tmp_path / "a.usdc")))
    assert len(validators) > 5 and [error.GetMessage() for error in found] == []


def test_usd_keeps_the_material_points_of_a_seam(tmp_path: Path) -> None:
    usd: Any = pytest.importorskip("pxr.Usd", reason="extra 'export'")
    from pxr import UsdGeom  # type: ignore[import-not-found]

    path = tmp_path / "seam.usda"
    write_usd(path, sewn())
    stage = usd.Stage.Open(str(path))
    variable = UsdGeom.PrimvarsAPI(stage.GetPrimAtPath("/yarnscale/cloth")).GetPrimvar("st")
    assert variable.GetInterpolation() == "faceVarying"
    surface = sewn().cloth
    assert surface is not None and surface.material is not None and surface.corners is not None
    np.testing.assert_array_equal(variable.ComputeFlattened(), surface.material[surface.corners.ravel()])


@pytest.mark.parametrize("yarns_as", ["tubes", "lines"])
def test_gltf_accessors_hold_every_frame(tmp_path: Path, yarns_as) -> None:
    path = tmp_path / f"{NAME}.glb"
    write_gltf(path, WHOLE, yarns_as=yarns_as)
    content, read = parsed(path)
    sampler = content["animations"][0]["samplers"][0]
    np.testing.assert_allclose(read(sampler["input"]), TIMES - TIMES[0], atol=1e-7)
    weights = read(sampler["output"]).reshape(3, 2)
    parts = {mesh["name"]: mesh["primitives"] for mesh in content["meshes"]}
    # Tubes are shown instead of the cloth, those of each colour as a part of its own.
    assert set(parts) == ({"cloth", "bodies", "yarns"} if yarns_as == "lines" else {"bodies", "yarns"})
    assert len(parts["yarns"]) == (1 if yarns_as == "lines" else 2)
    for k in range(3):
        here = moment(k)
        if yarns_as == "lines":
            positions, normals = morphed(parts["cloth"][0], weights[k], read)
            assert here.cloth is not None
            np.testing.assert_allclose(positions, here.cloth, atol=1e-6)
            np.testing.assert_allclose(normals, vertex_normals(here.cloth, MESH.triangles), atol=1e-6)
        np.testing.assert_allclose(morphed(parts["bodies"][0], weights[k], read)[0], here.bodies, atol=1e-6)
        yarns = np.concatenate([morphed(part, weights[k], read)[0] for part in parts["yarns"]])
        assert here.yarns is not None and here.radii is not None
        if yarns_as == "lines":
            np.testing.assert_allclose(yarns, here.yarns, atol=1e-6)
        else:
            rings = yarns.reshape(len(here.yarns), 8, 3)
            np.testing.assert_allclose(rings.mean(axis=1), here.yarns, atol=1e-6)
            distance = np.linalg.norm(rings - here.yarns[:, None], axis=2)
            outer = np.pi / 8 / np.sin(np.pi / 8)
            np.testing.assert_allclose(distance, np.tile(outer * here.radii[:, None], 8), atol=1e-6)
    if yarns_as == "lines":
        np.testing.assert_allclose(read(parts["cloth"][0]["attributes"]["TEXCOORD_0"]), MESH.material, atol=1e-7)
    assert parts["yarns"][0]["mode"] == (1 if yarns_as == "lines" else 4)
    for part in parts["yarns"]:
        assert read(part["indices"]).max() == len(read(part["attributes"]["POSITION"])) - 1


def parsed(path: Path) -> tuple[dict[str, Any], Any]:
    """Description and accessor reader of a .glb file, from the specification alone."""
    data = path.read_bytes()
    magic, version, length = struct.unpack("<4sII", data[:12])
    assert (magic, version, length) == (b"glTF", 2, len(data))
    size, kind = struct.unpack("<I4s", data[12:20])
    assert kind == b"JSON" and size % 4 == 0
    content = json.loads(data[20 : 20 + size])
    binary = data[28 + size :]
    assert struct.unpack("<I4s", data[20 + size : 28 + size]) == (len(binary), b"BIN\0")

    def read(index: int) -> np.ndarray:
        accessor = content["accessors"][index]
        view = content["bufferViews"][accessor["bufferView"]]
        width = {"SCALAR": 1, "VEC2": 2, "VEC3": 3}[accessor["type"]]
        dtype = {5126: "<f4", 5125: "<u4", 5123: "<u2"}[accessor["componentType"]]
        assert view["byteOffset"] % 4 == 0
        assert view["byteLength"] == np.dtype(dtype).itemsize * width * accessor["count"]
        values = np.frombuffer(binary, dtype, width * accessor["count"], view["byteOffset"])
        values = values.reshape(-1, width)
        if "min" in accessor:
            np.testing.assert_array_equal(np.float32(accessor["min"]), values.min(axis=0))
            np.testing.assert_array_equal(np.float32(accessor["max"]), values.max(axis=0))
        return values[:, 0] if width == 1 else values

    return content, read


def morphed(primitive: dict[str, Any], weights: np.ndarray, read: Any) -> tuple[np.ndarray, np.ndarray]:
    found = []
    for name in ("POSITION", "NORMAL"):
        if name in primitive["attributes"]:
            base = read(primitive["attributes"][name]).astype(float)
            found.append(base + sum(w * read(t[name]) for w, t in zip(weights, primitive["targets"], strict=True)))
    return found[0], found[-1]


def test_gltf_stands_upright_in_another_reader(tmp_path: Path) -> None:
    """VTK's reader: the first frame, turned so that the height is y."""
    path = tmp_path / "cloth.glb"
    write_gltf(path, replace(WHOLE, bodies=None, yarns=None))
    read: Any = pv.read(str(path))
    (block,) = [b for b in read.recursive_iterator() if b is not None and b.n_points]
    x, y, z = block.points.T
    first = moment(0).cloth
    assert first is not None
    np.testing.assert_allclose(np.column_stack([x, -z, y]), first, atol=1e-6)
    np.testing.assert_array_equal(block.regular_faces, MESH.triangles)


def test_gltf_has_a_vertex_for_every_material_point_of_a_seam(tmp_path: Path) -> None:
    path = tmp_path / "seam.glb"
    write_gltf(path, sewn())
    content, read = parsed(path)
    attributes = content["meshes"][0]["primitives"][0]["attributes"]
    surface, points = sewn().cloth, sewn().moment(0).cloth
    assert surface is not None and points is not None
    np.testing.assert_array_equal(read(attributes["TEXCOORD_0"]), surface.material)
    np.testing.assert_array_equal(read(attributes["POSITION"]), points[surface.triangles.ravel()])
    assert "animations" not in content


def test_gltf_refuses_what_does_not_fit(tmp_path: Path) -> None:
    long = replace(WHOLE, times=np.arange(10_000_000.0), bodies=None)
    with pytest.raises(InputError, match="4 GiB"):
        write_gltf(tmp_path / "long.glb", long)
    assert list(tmp_path.iterdir()) == []


def test_tubes_are_closed_face_outwards_and_do_not_turn() -> None:
    """Guldin: the volume is the section of a dodecagon, 3 r², times the length of the centre line."""
    arc, around = np.linspace(0, 2, 40), 2 * np.pi * np.arange(80) / 80
    points = np.vstack(
        [
            0.1 * np.column_stack([np.cos(arc), np.sin(arc), 0.1 * arc]),
            0.05 * np.column_stack([np.cos(around), 0.2 * np.sin(2 * around), np.sin(around)]),
        ]
    )
    curves = CurveSet([0, 40, 120], 2e-3, closed=[False, True])
    sweep = TubeSweep(curves, sides=12)
    edges = np.concatenate([sweep.triangles[:, [a, b]] for a, b in ((0, 1), (1, 2), (2, 0))])
    directed = {tuple(edge) for edge in edges.tolist()}
    assert len(directed) == len(edges) and {(b, a) for a, b in directed} == directed
    vertices, normals = sweep.surface(points, curves.radii)
    a, b, c = (vertices[sweep.triangles[:, k]] for k in range(3))
    volume = np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6
    ends = curves.segments()
    length = np.linalg.norm(points[ends[:, 0]] - points[ends[:, 1]], axis=1).sum()
    # As wide as the yarn on average over all directions: twelve sides of a perimeter of 2 π r.
    apothem, side = np.pi / 12 / np.tan(np.pi / 12), 2 * np.pi / 12
    assert volume == pytest.approx(12 * 0.5 * apothem * side * 2e-3**2 * length, rel=0.01)
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0)
    # The second frame starts where the first did, though everything turned a little.
    angle = 0.05
    turn = np.array([[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]])
    _, turned = sweep.surface(points @ turn.T, curves.radii)
    assert (normals * turned).sum(axis=1).min() > np.cos(2 * angle)


def test_tubes_stay_round_where_a_curve_turns_into_its_own_normal() -> None:
    directions = np.random.default_rng(3).standard_normal((50, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    curves = CurveSet(3 * np.arange(51), 2e-3)
    sweep = TubeSweep(curves, sides=6)
    steps = np.arange(3)[:, None]
    first = sweep.surface((directions[:, None] * steps).reshape(-1, 3), curves.radii)[1]
    turned = first.reshape(50, 18, 3)[:, 0]
    second = sweep.surface((turned[:, None] * steps).reshape(-1, 3), curves.radii)[1]
    assert np.abs(np.einsum("nki,ni->nk", second.reshape(50, 18, 3), turned)).max() < 1e-12


def test_a_curve_without_length_does_not_take_after_the_one_before() -> None:
    points = np.vstack([np.outer(np.arange(3), [0.0, 0.6, 0.8]), np.ones((3, 3))])
    both = TubeSweep(CurveSet([0, 3, 6], 2e-3), sides=6).surface(points, np.full(6, 2e-3))[0]
    alone = TubeSweep(CurveSet([0, 3], 2e-3), sides=6).surface(points[3:], np.full(3, 2e-3))[0]
    np.testing.assert_array_equal(both[18:], alone)


def test_vtk_series_is_read_with_its_times(tmp_path: Path) -> None:
    series = VtkSeries(tmp_path / f"{NAME}.pvd", WHOLE)
    for k, here in enumerate(WHOLE):
        series.write(k, here)
    reader: Any = pv.get_reader(str(tmp_path / f"{NAME}.pvd"))
    np.testing.assert_allclose(reader.time_values, TIMES)
    for k, time in enumerate(TIMES):
        reader.set_active_time_value(time)
        cloth, bodies, yarns = reader.read()
        here = moment(k)
        np.testing.assert_allclose(cloth.points, here.cloth)
        np.testing.assert_allclose(cloth["Velocity"], here.velocities)
        np.testing.assert_allclose(cloth["MaterialCoordinates"], MESH.material)
        np.testing.assert_allclose(bodies.points, here.bodies)
        np.testing.assert_allclose(yarns.points, here.yarns)
        np.testing.assert_allclose(yarns["Radius"], here.radii)
    assert yarns.lines.tolist() == [6, *range(6), 9, *range(6, 14), 6]


# VTK counts groups of faces only, and then wonders about the lines.
@pytest.mark.filterwarnings("ignore:PolyData mesh is not valid")
def test_obj_frames_hold_cloth_bodies_and_yarns(tmp_path: Path) -> None:
    path = tmp_path / f"{NAME}.obj"
    here = moment(1)
    write_obj_frame(path, WHOLE, here)
    vertices, triangles = read_obj_surface(path)
    assert here.cloth is not None and here.bodies is not None and here.yarns is not None
    np.testing.assert_allclose(vertices, np.vstack([here.cloth, here.bodies, here.yarns]), rtol=1e-8)
    expected = np.vstack([MESH.triangles, ball()[1] + len(FLAT)])
    np.testing.assert_array_equal(triangles, expected)
    other: Any = pv.read(str(path))
    before = len(FLAT) + len(ball()[0])
    loop = [9, *range(before + 6, before + 14), before + 6]
    assert other.lines.tolist() == [6, *range(before, before + 6), *loop]
    np.testing.assert_allclose(other.points[:before], vertices[:before], atol=1e-6)


@pytest.mark.parametrize("suffix", ["glb", "usdc", "usda"])
def test_a_file_that_cannot_be_written_is_an_error_and_leaves_nothing(tmp_path: Path, suffix) -> None:
    if suffix != "glb":
        pytest.importorskip("pxr.Usd", reason="extra 'export'")
    write = write_gltf if suffix == "glb" else write_usd
    with pytest.raises(InputError, match="cannot be written"):
        write(tmp_path / "none" / f"a.{suffix}", WHOLE)
    (tmp_path / f"b.{suffix}").mkdir()
    with pytest.raises(InputError, match="is a folder"):
        write(tmp_path / f"b.{suffix}", WHOLE)

    def breaks(index: int) -> Moment:
        if index == 1:
            raise InputError("frame is damaged")
        return moment(index)

    kept = tmp_path / f"c.{suffix}"
    kept.write_bytes(b"old")
    with pytest.raises(InputError, match="damaged"):
        write(kept, replace(WHOLE, moment=breaks))
    assert kept.read_bytes() == b"old" and len(list(tmp_path.iterdir())) == 2


@pytest.mark.skipif(sys.platform == "win32", reason="no limit of file sizes")
@pytest.mark.parametrize("suffix", ["glb", "usdc", "usda", "pvd"])
def test_a_disk_that_is_full_is_an_error_and_leaves_no_file(tmp_path: Path, suffix) -> None:
    import resource

    if suffix.startswith("usd"):
        pytest.importorskip("pxr.Usd", reason="extra 'export'")
    path = tmp_path / f"a.{suffix}"
    write_gltf(tmp_path / "warm.glb", WHOLE)
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (8_000, hard))
    try:
        with pytest.raises(InputError, match=r"cannot be written; found .*too large"):
            if suffix == "pvd":
                VtkSeries(path, WHOLE).write(0, moment(0))
            else:
                (write_gltf if suffix == "glb" else write_usd)(path, WHOLE)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    # Files that were finished before the disk was full may stay; none is cut off.
    assert not path.exists() and not [p for p in tmp_path.rglob("*") if ".part" in p.name]


def test_usd_hides_the_cloth_that_yarns_show(tmp_path: Path) -> None:
    pytest.importorskip("pxr")
    from pxr import Usd, UsdGeom

    for animation, shown in ((WHOLE, "invisible"), (replace(WHOLE, yarns=None), "inherited")):
        path = tmp_path / f"{shown}.usda"
        write_usd(path, animation)
        stage = Usd.Stage.Open(str(path))
        assert UsdGeom.Imageable(stage.GetPrimAtPath("/yarnscale/cloth")).ComputeVisibility() == shown
        assert UsdGeom.Imageable(stage.GetPrimAtPath("/yarnscale/bodies")).ComputeVisibility() == "inherited"
