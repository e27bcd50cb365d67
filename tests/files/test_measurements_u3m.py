"""Raw measurements of the U3M format: the published example, an archive of it, and broken ones in one line."""

from __future__ import annotations

import copy
import json
import zipfile
from pathlib import Path

import numpy as np
import pytest

from yarnscale.errors import InputError
from yarnscale.files import measurements_u3m
from yarnscale.files.measurements import read_measurements
from yarnscale.swatches.measurements import Direction
from yarnscale.swatches.strip_bending import arch_push


def cycles(stiffness: float) -> list[list[float]]:
    """Two cycles of a strip of 8 cm, in cm and g, the second one farther; unloading gives back half of the work."""
    branches = []
    for far in (1.0, 3.0):
        up = np.linspace(0.0, far, 30)
        for length, force in ((up, stiffness * up**2), (up[::-1], stiffness * up[::-1] ** 5 / far**3)):
            branches.append(np.column_stack([8.0 + length, force]).ravel().tolist())
    return branches


def physics() -> dict:
    """A small file of the format."""
    tests = {
        name: {"S2": {"width": 4, "length": 8.0, "samplesTree": cycles(k)}}
        for name, k in (("L", 30.0), ("W", 15.0), ("B", 20.0))
    }
    return {"schema": "1.1", "custom": None, "raw_data": {**tests, "M": 210}}


def arch(rigidity: float, friction: float, drift: float) -> list[list[float]]:
    """One cycle of a strip of 2 by 4 cm pushed to an arch and back, in cm and g; the weight pushes by 0.1 g."""
    far = np.linspace(0.0, 0.7, 15)
    push = rigidity * 0.04 / 0.02**2 / 9.80665e-3 * arch_push(far / 2.0)
    ways = [2.0, drift, 2.0, drift], [2.0, drift]
    loading, unloading = (
        np.column_stack([2.0 - far[1:], drift - push[1:] - s * friction])[::s].ravel() for s in (1, -1)
    )
    return [[*ways[0], *loading], [*unloading, *ways[1]]]


def written(tmp_path: Path, content: object) -> Path:
    path = tmp_path / "physics.json"
    path.write_text(json.dumps(content, indent=1))
    return path


def test_directions_units_cycles_and_lost_work(tmp_path):
    path = written(tmp_path, physics())
    found = read_measurements(path)
    assert [test.direction for test in found.stretch] == list(Direction)
    assert found.area_density == pytest.approx(0.21)
    for test, k in zip(found.stretch, (15.0, 20.0, 30.0), strict=True):
        assert test.swatch_width == pytest.approx(0.04)
        assert test.swatch_length == pytest.approx(0.08, rel=0.02)
        assert test.curve.load_at(np.array([0.25]))[0] == pytest.approx(k * 4 * 9.80665e-3 / 0.04, rel=0.05)
        assert test.lost_work == pytest.approx(0.5, abs=0.03)
    assert not found.short and not found.rigidity
    assert any("of 2 loadings the second" in note for note in found.notes)
    archive = tmp_path / "fabric.u3m"
    with zipfile.ZipFile(archive, "w") as file:
        file.writestr("textures/diffuse.png", b"\x89PNG")
        file.writestr("fabric.json", json.dumps({"material": {"physics": {"fab": physics()}}}))
    packed = read_measurements(archive)
    assert packed.stretch[0].curve.load == pytest.approx(found.stretch[0].curve.load)


@pytest.mark.parametrize(
    ("place", "value", "words"),
    [
        (("schema",), "1.0", "field 'schema'; expected '1.1'; found '1.0'"),
        (("raw_data",), None, "field 'raw_data"),
        (("raw_data", "L", "S2"), None, "raw_data.L.S2"),
        (("raw_data", "L", "S2", "width"), "4", "raw_data.L.S2.width"),
        (("raw_data", "B", "S2", "samplesTree"), [], "raw_data.B.S2.samplesTree"),
        (("raw_data", "B", "S2", "samplesTree", 1), [8.0, 1.0, 8.1], "samplesTree[1]'; expected pairs"),
        (("raw_data", "W", "S2", "samplesTree", 0, 3), "1.2 g", "samplesTree[0][3]"),
        (("raw_data", "W", "S2", "samplesTree"), [[8.0, 0.0, 8.1, 0.0, 8.2, 0.0]], "three readings or more"),
    ],
)
def test_broken_files_are_told_in_one_line(tmp_path, place, value, words):
    content = copy.deepcopy(physics())
    within = content
    for key in place[:-1]:
        within = within[key]
    within[place[-1]] = value
    with pytest.raises(InputError) as error:
        read_measurements(written(tmp_path, content))
    assert words in str(error.value) and "physics.json:" in str(error.value)
    assert "\n" not in str(error.value)


def test_the_line_is_that_of_the_field_within_its_direction(tmp_path):
    content = physics()
    content["raw_data"]["W"]["S2"]["width"] = -4
    path = written(tmp_path, content)
    with pytest.raises(InputError) as error:
        read_measurements(path)
    line = int(str(error.value).split(":")[1])
    assert '"width": -4' in path.read_text().splitlines()[line - 1]


def test_bending_of_strips_is_told_from_friction_drift_and_weight(tmp_path):
    content = physics()
    for name, rigidity in (("L", 2e-6), ("W", 1e-6)):
        for key, drift, width in (("U1", 0.4, 4), ("D1", -0.7, 2)):
            weak = [[2.0, 0.0, 1.9, -1.0, 1.8, -1.0], [1.8, -1.0, 1.9, -1.0, 2.0, 0.0]]
            both = (arch(rigidity * width / 4, 0.3, drift + more) for more in (0.0, 0.1))
            content["raw_data"][name][key] = {"width": width, "samplesTree": sum(both, weak)}
        content["raw_data"][name]["S1"] = {"width": 4, "samplesTree": cycles(9.0)}
    content["raw_data"]["B"]["U1"] = {"width": 4, "samplesTree": [[2.0, 0.0, 1.9, -1.0, 1.8, -1.0]] * 2}
    found = read_measurements(written(tmp_path, content))
    measured = {bend.direction: bend for bend in found.rigidity}
    assert set(measured) == {Direction.WEFT, Direction.WARP}
    assert measured[Direction.WARP].rigidity == pytest.approx(2e-6, rel=1e-3)
    assert measured[Direction.WEFT].rigidity == pytest.approx(1e-6, rel=1e-3)
    assert measured[Direction.WEFT].spread < 1e-9
    assert any("bias (B): bending is not used" in note for note in found.notes)
    assert [test.direction for test in found.short] == [Direction.WEFT, Direction.WARP]


def test_archives_without_end_or_measurements_are_refused(tmp_path, monkeypatch):
    path = tmp_path / "bomb.u3m"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as file:
        file.writestr("physics.json", b" " * 200_000)
    with pytest.raises(InputError, match="raw_data"):
        read_measurements(path)
    monkeypatch.setattr(measurements_u3m, "_LARGEST", 100_000)
    with pytest.raises(InputError, match="too large"):
        read_measurements(path)
    with zipfile.ZipFile(path, "w") as file:
        file.writestr("readme.txt", "none")
    with pytest.raises(InputError, match="JSON file"):
        read_measurements(path)


def test_the_published_example(shared):
    found = read_measurements(shared / "measured" / "u3m" / "physics_example.json")
    assert found.name == "QA Test Fabric shirley" and found.area_density == pytest.approx(0.3)
    reached = {test.direction: test.curve.stretch_at(33.3) for test in found.stretch}
    # As read from the published readings of the fourth cycle at 136 g, over 8.2 cm.
    assert reached[Direction.WEFT] == pytest.approx(0.47, abs=0.02)
    assert reached[Direction.WARP] == pytest.approx(0.28, abs=0.02)
    # The machine's own numbers are 16 and 24 dyn cm along length and width, both with the warning "low-force".
    bent = {bend.direction: bend.rigidity for bend in found.rigidity}
    assert all(1e-6 < rigidity < 2.5e-6 for rigidity in bent.values()) and len(bent) == 3
    assert [test.swatch_length for test in found.short] == pytest.approx([0.02, 0.02, 0.021], abs=1e-3)
    assert all(test.lost_work is not None and 0.1 < test.lost_work < 0.4 for test in found.stretch)


def test_damaged_and_blown_up_archives_are_refused_at_once(tmp_path: Path) -> None:
    bomb, cut, empty = tmp_path / "bomb.u3m", tmp_path / "cut.u3m", tmp_path / "empty.u3m"
    with zipfile.ZipFile(bomb, "w", zipfile.ZIP_DEFLATED) as archive:
        for k in range(3):
            archive.writestr(f"{k}.json", b" " * 40_000_000)
    with zipfile.ZipFile(cut, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("a.json", json.dumps({"raw_data": list(range(1000))}))
    content = bytearray(cut.read_bytes())
    content[60:90] = b"\xff" * 30
    cut.write_bytes(content)
    empty.write_bytes(b"PK\x05\x06" + b"\xff" * 18)
    for path, fault in (
        (bomb, "too large"),
        (cut, "cannot be unpacked"),
        (empty, "cannot be unpacked|no measurements"),
    ):
        with pytest.raises(InputError, match=fault):
            read_measurements(path)
