"""Sample stores: made, read and refused; a state counts whole or not at all."""

from __future__ import annotations

import json
import warnings
from pathlib import Path

import numpy as np
import pytest
import xarray

from yarnscale.errors import InputError
from yarnscale.homogenize.store import SampleStore
from yarnscale.homogenize.worker import STRAINS

VERTICES = 4
GRID = {
    "s_x": np.array([0.0, 0.1]),
    "s_a": np.array([0.0]),
    "s_y": np.array([-0.1, 0.0, 0.2]),
    "lambda_x": np.array([0.0]),
    "lambda_y": np.array([0.0]),
}
SCATTERED = {name: np.linspace(0.0, 0.1 * (k + 1), 5) for k, name in enumerate(STRAINS)}
PROVENANCE = {"pattern": "drawn", "area_density": 0.3}


def result(seed: int) -> dict[str, object]:
    rng = np.random.default_rng(seed)
    return {
        "energy_density": rng.random(),
        "stress": rng.random(6),
        "moduli": rng.random((6, 6)),
        "iterations": 7,
        "seconds": 0.5,
        "residual": 1e-9,
        "min_distance_over_diameter": 0.9,
        "fluctuation": rng.random((VERTICES, 3)),
        "twist": rng.random(VERTICES),
        "positions": rng.random((VERTICES, 3)),
        "status": 1,
    }


def make(path: Path, *, scattered: bool = False, positions: bool = False) -> SampleStore:
    return SampleStore.create(
        path,
        SCATTERED if scattered else GRID,
        scattered=scattered,
        vertices=VERTICES,
        positions=positions,
        provenance=PROVENANCE,
    )


def test_a_new_store_has_every_state_pending(tmp_path: Path) -> None:
    store = make(tmp_path / "store")
    assert store.count == 6
    assert store.shape == (2, 1, 3, 1, 1)
    assert not store.status().any()
    assert [p.name for p in tmp_path.iterdir()] == ["store"]


@pytest.mark.parametrize("scattered", [False, True])
def test_what_is_written_is_read_after_opening_anew(tmp_path: Path, scattered: bool) -> None:
    store = make(tmp_path / "store", scattered=scattered, positions=True)
    store.write(2, result(2))
    opened = SampleStore(tmp_path / "store")
    assert opened.dims == (("state",) if scattered else STRAINS)
    assert np.array_equal(opened.states, store.states)
    assert opened.status().tolist() == [1 if i == 2 else 0 for i in range(store.count)]
    for name in ("energy_density", "stress", "fluctuation", "twist", "positions"):
        assert np.array_equal(opened.read(2, name), np.asarray(result(2)[name]))
    assert opened.attributes["provenance"] == PROVENANCE


def test_a_grid_opens_as_a_dataset_without_warnings(tmp_path: Path) -> None:
    store = make(tmp_path / "store", positions=True)
    for index in range(store.count):
        store.write(index, result(index))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        data = xarray.open_zarr(tmp_path / "store").load()
    assert data.energy_density.dims == STRAINS
    assert data.stress.dims == (*STRAINS, "component")
    assert data.positions.dims == (*STRAINS, "vertex", "axis")
    assert {"energy_density", "stress", "status", "iterations", "seconds", "positions"} <= set(data)
    found = data.sel(s_x=0.1, s_y=-0.1, s_a=0.0, lambda_x=0.0, lambda_y=0.0)
    assert float(found.energy_density) == result(3)["energy_density"]
    assert np.array_equal(found.stress, np.asarray(result(3)["stress"]))
    assert np.array_equal(found.positions, np.asarray(result(3)["positions"]))
    assert data.energy_density.attrs["units"] == "J/m^2"
    assert (data.status == 1).all()


def test_scattered_states_open_as_a_dataset_without_warnings(tmp_path: Path) -> None:
    store = make(tmp_path / "store", scattered=True)
    store.write(1, result(1))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        data = xarray.open_zarr(tmp_path / "store").load()
    assert data.energy_density.dims == ("state",)
    assert np.array_equal(data.lambda_y, SCATTERED["lambda_y"])
    assert "positions" not in data
    assert int(data.status[1]) == 1
    assert np.isnan(data.energy_density[0])
    assert SampleStore(str(store.path)).dataset().identical(data)


def test_positions_are_there_on_request_only(tmp_path: Path) -> None:
    assert not make(tmp_path / "without").has_positions
    assert make(tmp_path / "with", positions=True).has_positions


def test_a_state_killed_before_its_status_does_not_count(tmp_path: Path) -> None:
    store = make(tmp_path / "store")
    store.write(0, result(0))
    store.write(1, result(1))
    chunks = sorted(p for p in (tmp_path / "store" / "status" / "c").rglob("*") if p.is_file())
    chunks[1].unlink()
    assert store.status().tolist() == [1, 0, 0, 0, 0, 0]
    chunks[1].write_bytes(b"")
    assert SampleStore(tmp_path / "store").status().tolist() == [1, 0, 0, 0, 0, 0]


def test_status_is_the_last_to_be_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    store = make(tmp_path / "store", positions=True)
    order: list[str] = []
    replace = __import__("os").replace

    def note(source: object, target: Path) -> None:
        order.append(target.relative_to(store.path).parts[0])
        replace(source, target)

    monkeypatch.setattr("yarnscale.homogenize.store.os.replace", note)
    store.write(0, result(0))
    assert order[-1] == "status"
    assert len(order) == 10


def test_what_a_killed_run_was_writing_is_discarded(tmp_path: Path) -> None:
    store = make(tmp_path / "store")
    store.write(0, result(0))
    leftover = store.path / "stress" / "c" / "0.123.building"
    leftover.write_bytes(b"half")
    store.discard_unfinished()
    assert not leftover.exists()
    assert store.status()[0] == 1


def test_a_folder_with_files_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "store").mkdir()
    (tmp_path / "store" / "mine.txt").write_text("keep")
    with pytest.raises(InputError, match=r"output exists.*--resume"):
        make(tmp_path / "store")
    assert (tmp_path / "store" / "mine.txt").read_text() == "keep"


def test_an_empty_folder_may_become_a_store(tmp_path: Path) -> None:
    (tmp_path / "store").mkdir()
    assert make(tmp_path / "store").count == 6


@pytest.mark.parametrize("below", ["file/store", "file/deep/store", "n" * 300])
def test_an_unwritable_place_is_refused(tmp_path: Path, below: str) -> None:
    (tmp_path / "file").write_text("a file")
    with pytest.raises(InputError, match=r"cannot write the store|output exists"):
        make(tmp_path / below)
    assert [p.name for p in tmp_path.iterdir()] == ["file"]


def test_what_is_no_store_is_refused(tmp_path: Path) -> None:
    import zarr

    (tmp_path / "empty").mkdir()
    (tmp_path / "file").write_text("a file")
    zarr.create_group(str(tmp_path / "other"))
    for name in ("missing", "empty", "file"):
        with pytest.raises(InputError, match=f"{name}: no sample store"):
            SampleStore(tmp_path / name)
    with pytest.raises(InputError, match="other: not a sample store"):
        SampleStore(tmp_path / "other")


def damaged(path: Path, change) -> Path:
    make(path)
    attributes = json.loads((path / "zarr.json").read_text())
    change(attributes)
    (path / "zarr.json").write_text(json.dumps(attributes))
    return path


def test_another_version_is_refused(tmp_path: Path) -> None:
    path = damaged(tmp_path / "store", lambda a: a["attributes"].update(version=99))
    with pytest.raises(InputError, match="another version; expected 1; found 99"):
        SampleStore(path)


@pytest.mark.parametrize("key", ["state_dimensions", "vertices", "provenance"])
def test_a_damaged_store_is_refused(tmp_path: Path, key: str) -> None:
    path = damaged(tmp_path / "store", lambda a: a["attributes"].pop(key))
    with pytest.raises(InputError, match="damaged sample store"):
        SampleStore(path)


def test_a_store_without_an_array_is_refused(tmp_path: Path) -> None:
    import shutil

    make(tmp_path / "store")
    shutil.rmtree(tmp_path / "store" / "status")
    found = json.loads((tmp_path / "store" / "zarr.json").read_text())
    found.pop("consolidated_metadata", None)
    (tmp_path / "store" / "zarr.json").write_text(json.dumps(found))
    with pytest.raises(InputError, match="damaged sample store"):
        SampleStore(tmp_path / "store")


def test_a_result_of_a_wrong_shape_is_a_fault(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="stress: expected shape"):
        make(tmp_path / "store").write(0, result(0) | {"stress": np.zeros(5)})
