"""OBJ files as programs and people write them: polygons, continued lines, encodings, cracks, units."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from yarnscale.errors import InputError
from yarnscale.files.obj_garment import read_garment
from yarnscale.files.obj_surface import read_obj, read_obj_surface

Faces = list[list[tuple[float, float]]]


def text_of(faces: Faces, *, split: bool, space: float = 1.0, fabric: float = 1.0, jitter: float = 0.0) -> str:
    """An OBJ of flat faces; split: a vertex for every corner, moved by up to ``jitter``."""
    rng = np.random.default_rng(1)
    rows, numbers, lines = [], {}, []
    for face in faces:
        mine = []
        for place in face:
            if split or place not in numbers:
                rows.append(np.array(place) + jitter * rng.uniform(-1, 1, 2))
                numbers[place] = len(rows)
            mine.append(numbers[place])
        lines.append("f " + " ".join(f"{n}/{n}" for n in mine))
    head = [f"v {space * x:.9g} {space * y:.9g} 0" for x, y in rows]
    head += [f"vt {fabric * x:.9g} {fabric * y:.9g}" for x, y in rows]
    return "\n".join([*head, *lines]) + "\n"


def grid(n: int, size: float = 0.05) -> Faces:
    return [
        [(size * (i + a), size * (j + b)) for a, b in ((0, 0), (1, 0), (1, 1), (0, 1))]
        for j in range(n)
        for i in range(n)
    ]


@pytest.fixture
def obj(tmp_path: Path) -> Callable[[str], Path]:
    def write(text: str) -> Path:
        path = tmp_path / "a.obj"
        path.write_text(text)
        return path

    return write


def test_concave_faces_and_corners_on_straight_sides_make_cloth(obj: Callable[[str], Path]) -> None:
    faces: Faces = [
        [(0, 0), (0.1, 0), (0.2, 0), (0.2, 0.1), (0.1, 0.05), (0, 0.1)],
        [(0, 0.1), (0.1, 0.05), (0.2, 0.1), (0.2, 0.2), (0, 0.2)],
    ]
    mesh = read_garment(obj(text_of(faces, split=False)))
    np.testing.assert_allclose(mesh.areas.sum(), 0.04)
    assert len(mesh.triangles) == 7 and mesh.vertex_count == 8
    assert (~mesh.has_neighbour).sum() == 7
    assert mesh.lines.tolist() == [17] * 4 + [18] * 3
    with pytest.raises(InputError, match=r"a\.obj: vertices; expected 6 or more in faces; found 4"):
        read_garment(obj(text_of(grid(1), split=False)))


@pytest.mark.parametrize("first", range(4))
def test_three_quadrilaterals_may_meet_at_a_vertex(obj: Callable[[str], Path], first: int) -> None:
    """Whichever corner a face begins with, four triangles meet there; the sheet keeps its area and its edge."""
    ways = [0.05 * np.array([np.cos(a), np.sin(a)]) for a in np.deg2rad([90, 210, 330])]
    faces: Faces = []
    for a, b in zip(ways, ways[1:] + ways[:1], strict=True):
        for i, j in np.ndindex(3, 3):
            face = [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)]
            places = [tuple((i * a + j * b).round(9)) for i, j in face[first:] + face[:first]]
            faces.append(places)  # type: ignore[arg-type]
    mesh = read_garment(obj(text_of(faces, split=False)), on_notice=[].append)
    middle = int(np.argmin(np.linalg.norm(mesh.assembled, axis=1)))
    assert (mesh.triangles == middle).sum() >= 4
    assert (~mesh.has_neighbour).sum() == 18
    np.testing.assert_allclose(mesh.areas.sum(), 27 * 0.05**2 * np.sin(np.pi / 3), rtol=1e-6)


def test_continued_lines_other_encodings_and_counting_back(tmp_path: Path) -> None:
    text = (
        "mtllib Größe.mtl\r\no Ärmel\r\nv 0 0 0\r\nv 1 0 \\\r\n0\r\nv 1 1 0 0.5 0.5 0.5\r\nv 0 1 0\r\nvt 0 0\r\n"
        "vn 0 0 1\r\nusemtl Wolle\r\ng Größe\r\nf -4//-1 -3//-1 \\\r\n -2//-1 -1//-1\r\nf 1 2 5\r\nv 2 2 0\r\n"
    )
    for encoding in ("utf-8", "latin-1"):
        path = tmp_path / f"{encoding}.obj"
        path.write_bytes(text.encode(encoding))
        surface = read_obj(path)
        assert surface.lines.tolist() == [12, 14]
        vertices, triangles = read_obj_surface(path)
        np.testing.assert_array_equal(vertices[1], [1, 0, 0])
        np.testing.assert_array_equal(triangles, [[0, 1, 2], [0, 2, 3], [0, 1, 4]])


@pytest.mark.parametrize(
    ("faces", "message"),
    [
        ("f 1 2 9\n", "a.obj:4: face; expected vertices 1..3; found 9"),
        ("f 1 2 -4\n", "a.obj:4: face; expected vertices 1..3; found -4"),
        ("f 1 2 0\n", "a.obj:4: face; expected vertices 1..3; found 0"),
        ("f 1 2 x\n", "a.obj:4: face; expected vertex numbers; found x"),
        ("f 1 2\n", "a.obj:4: face; expected three or more vertices; found 2"),
        ("f 1 2 2\n", "a.obj: file has no faces"),
    ],
)
def test_errors_count_as_the_file_does(obj: Callable[[str], Path], faces: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        read_obj(obj("v 0 0 0\nv 1 0 0\nv 0 1 0\n" + faces))


def test_faults_of_the_mesh_name_vertices_and_lines_of_the_file(obj: Callable[[str], Path]) -> None:
    lines = text_of(grid(2), split=False).splitlines()
    # Comments and a vertex that no face uses must not shift the count; the last face lies on the third.
    lines = ["# a comment", "v 9 9 9", *lines, "f 5/4 4/3 9/8"]
    lines = [re.sub(r"(\d+)/(\d+)", lambda m: f"{int(m[2]) + 1}/{m[2]}", x) if x[0] == "f" else x for x in lines]
    with pytest.raises(InputError, match=r"a\.obj:25: edge 5-4; expected one triangle on each side"):
        read_garment(obj("\n".join(lines)), weld=False, on_notice=[].append)


@pytest.mark.parametrize("jitter", [0.0, 2e-4])
def test_vertices_split_for_every_face_are_refused_and_welded(obj: Callable[[str], Path], jitter: float) -> None:
    path = obj(text_of(grid(4), split=True, jitter=jitter))
    with pytest.raises(InputError, match=r"a\.obj:129: .*weld = true.*48 edges.*39 split.*16 loose pieces"):
        read_garment(path)
    notices: list[str] = []
    assert read_garment(path, weld=False, on_notice=notices.append).vertex_count == 64
    assert len(notices) == 2 and "48 edges" in notices[0] and "16 pieces" in notices[1]
    for weld in (True, 1e-3):
        sewn = read_garment(path, weld=weld, on_notice=notices.append)
        assert sewn.vertex_count == 25 and len(sewn.material) == 25 and (~sewn.has_neighbour).sum() == 16
        np.testing.assert_allclose(sewn.areas.sum(), 0.04, rtol=2 * jitter / 0.05 + 1e-12)
    assert len(notices) == 2


def test_texture_split_for_every_face_is_one_fabric(obj: Callable[[str], Path]) -> None:
    """Vertices are common, texture coordinates are not: no seams."""
    lines = text_of(grid(3), split=True).splitlines()
    common = {place: f"v {place[0]} {place[1]} 0" for face in grid(3) for place in face}
    numbers = {place: k + 1 for k, place in enumerate(common)}
    faces = [
        "f " + " ".join(f"{numbers[p]}/{4 * k + c + 1}" for c, p in enumerate(face)) for k, face in enumerate(grid(3))
    ]
    points = [line for line in lines if line.startswith("vt")]
    mesh = read_garment(obj("\n".join([*common.values(), *points, *faces])))
    assert len(mesh.material) == 16 and not mesh.seams.any()


def together(first: str, second: str) -> str:
    """Two files as one; vertices and texture coordinates are numbered alike in each."""
    lines = [*first.splitlines(), *second.splitlines()]
    count = sum(line.startswith("v ") for line in first.splitlines())

    def shifted(line: str) -> str:
        return "f " + " ".join("/".join(str(int(n) + count) for n in c.split("/")) for c in line.split()[1:])

    head = [line for kind in ("v ", "vt") for line in lines if line.startswith(kind)]
    faces = [line for line in first.splitlines() if line[0] == "f"]
    faces += [shifted(line) for line in second.splitlines() if line[0] == "f"]
    return "\n".join([*head, *faces])


@pytest.mark.parametrize("seam", [False, True])
def test_long_edges_are_split_where_vertices_lie_within_them(obj: Callable[[str], Path], seam: bool) -> None:
    """Four faces in a row below six: hanging vertices on both sides, across a seam or within one fabric."""

    def row(count: int, height: float) -> Faces:
        w = 0.2 / count
        return [[(w * i + x, height + y) for x, y in ((0, 0), (w, 0), (w, 0.05), (0, 0.05))] for i in range(count)]

    upper = text_of(row(6, 0.05), split=False)
    if seam:
        upper = re.sub(r"vt (\S+) ", r"vt 1\1 ", upper)  # 10 m to the right in the fabric
    path = obj(together(text_of(row(4, 0.0), split=False), upper))
    with pytest.raises(InputError, match="2 loose pieces"):
        read_garment(path)
    mesh = read_garment(path, weld=True)
    # On the line between are three corners of the lower row and five of the upper, the middle one of both.
    assert mesh.vertex_count == 5 + (3 + 5 - 1 + 2) + 7
    assert (~mesh.has_neighbour).sum() == 4 + 6 + 4
    assert mesh.seams.sum() == (2 * 8 if seam else 0)
    np.testing.assert_allclose(mesh.areas.sum(), 0.02)


def test_layers_are_counted_and_left_apart(obj: Callable[[str], Path]) -> None:
    text = text_of(grid(3), split=False)
    upper = re.sub(r"(v .*) 0\n", r"\1 0.004\n", text)
    notices: list[str] = []
    mesh = read_garment(obj(together(text, upper)), on_notice=notices.append)
    assert mesh.vertex_count == 32 and len(notices) == 1 and "2 pieces" in notices[0]


@pytest.mark.parametrize(
    ("space", "fabric", "unit"),
    [
        (1, 1000, "mm"),
        (1000, 1, "mm"),
        (100, 1, "cm"),
        (1, 1 / 0.0254, "inch"),
        (1000, 1000, "mm"),
        (100, 100, "cm"),
    ],
)
def test_units_of_positions_texture_or_both(obj: Callable[[str], Path], space: float, fabric: float, unit: str) -> None:
    path = obj(text_of(grid(4), split=False, space=space, fabric=fabric))
    if space != fabric:
        with pytest.raises(InputError, match=f'would fit: unit = "{unit}"'):
            read_garment(path)
    mesh = read_garment(path, unit=unit)
    np.testing.assert_allclose(mesh.areas.sum(), 0.04, rtol=1e-6)
    np.testing.assert_allclose(np.ptp(mesh.assembled, axis=0), [0.2, 0.2, 0], atol=1e-8)


def test_texture_of_no_unit_asks_for_a_scale(obj: Callable[[str], Path]) -> None:
    path = obj(text_of(grid(4), split=False, fabric=5.0))
    with pytest.raises(InputError, match=r"a\.obj: sizes; .*material_scale = 0.2 would fit"):
        read_garment(path)
    assert read_garment(path, material_scale=0.2).areas.sum() == pytest.approx(0.04)
    notices: list[str] = []
    read_garment(path, material_scale=0.17, on_notice=notices.append)
    assert len(notices) == 1 and "1.38 times the area" in notices[0]
    read_garment(path, scale=1.0, material_scale=1.0, on_notice=notices.append)
    assert len(notices) == 2
    with pytest.raises(InputError, match="unit; expected m or cm or mm or inch; found 'parsec'"):
        read_garment(path, unit="parsec")
