"""Which states are sampled, in which order, and which grids are refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from yarnscale.errors import InputError
from yarnscale.files.grid_toml import read_grid
from yarnscale.homogenize.plan import (
    StrainGrid,
    StrainRange,
    axes_and_planes,
    bends_twice,
    random_states,
    solve_order,
)

RADIUS = 1e-3
BOUNDS = StrainRange().bounds(RADIUS)


def test_missing_axes_of_a_grid_are_zero(tmp_path: Path) -> None:
    path = tmp_path / "grid.toml"
    path.write_text("s_x = [0, 0.1]\nlambda_y = [-10, 0.5]\n")
    assert read_grid(path) == StrainGrid(s_x=(0.0, 0.1), lambda_y=(-10.0, 0.5))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("s_z = [0]", "unknown field 's_z'; expected s_x"),
        ("s_x = 0.1", "grid.toml:1: field 's_x'; expected a list of numbers"),
        ("s_x = ['a']", "grid.toml:1: field 's_x[0]'; expected a number"),
        ("s_x = [true]", "field 's_x[0]'; expected a number"),
        ("s_x = []", "at least one value"),
        ("s_x = [0, 0.1, 0]", "distinct"),
        ("s_x = [-1]", "strain s_x; expected more than -1"),
        ("s_a = [1.0]", "strain s_a"),
        ("s_y = [nan]", "s_y[0]'; expected a finite number"),
        ("lambda_x = [inf]", "finite number; found inf"),
        ("s_x = [0", "file is not TOML"),
        (f"s_x = {list(range(2000))}\ns_y = {list(range(2000))}", "at most"),
        ("s_x = " + "[" * 5000, "TOML"),
        ("s_x = [1" + "0" * 400 + "]", "finite number"),
        ("s_x = [1" + "0" * 5000 + "]", "TOML"),
    ],
)
def test_bad_grids_name_the_file_and_the_field(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "grid.toml"
    path.write_text(text)
    with pytest.raises(InputError, match=r"grid\.toml") as caught:
        read_grid(path)
    assert message in str(caught.value)
    assert len(str(caught.value)) < 600


@pytest.mark.parametrize("content", [b"", b"\x00\x01\xff", b"\xff\xfe"])
def test_grids_that_are_no_text_are_refused(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "grid.toml"
    path.write_bytes(content)
    with pytest.raises(InputError, match=r"grid\.toml"):
        read_grid(path)


def test_missing_grids_are_refused(tmp_path: Path) -> None:
    for path in (tmp_path / "missing.toml", tmp_path):
        with pytest.raises(InputError, match=str(path)):
            read_grid(path)


def test_plans_hold_rest_the_axes_and_the_planes() -> None:
    states = axes_and_planes(BOUNDS, 400)
    acting = (states != 0).sum(axis=1)
    assert not states[0].any()
    assert 300 < len(states) < 500
    assert set(acting.tolist()) == {0, 1, 2}
    assert len(np.unique(states, axis=0)) == len(states)
    assert not bends_twice(states).any()
    assert (states >= BOUNDS[:, 0] - 1e-12).all() and (states <= BOUNDS[:, 1] + 1e-12).all()
    assert np.allclose(states.min(axis=0), BOUNDS[:, 0]) and np.allclose(states.max(axis=0), BOUNDS[:, 1])


def test_unseen_states_are_the_same_for_a_seed_and_within_bounds() -> None:
    states = random_states(BOUNDS, 100, seed=3)
    assert np.array_equal(states, random_states(BOUNDS, 100, seed=3))
    assert not np.array_equal(states, random_states(BOUNDS, 100, seed=4))
    assert not bends_twice(states).any()
    assert (states > BOUNDS[:, 0]).all() and (states < BOUNDS[:, 1]).all()


def test_every_state_starts_from_one_that_is_closer_to_rest_and_solved_before() -> None:
    states = axes_and_planes(BOUNDS, 120)
    order, parents = solve_order(states, BOUNDS)
    place = np.argsort(order)
    assert sorted(order.tolist()) == list(range(len(states)))
    assert parents[order[0]] == -1
    for index, parent in enumerate(parents):
        assert parent < 0 or place[parent] < place[index]
    assert (parents[order[1:]] >= 0).sum() > 0.9 * len(states) - 1


@pytest.mark.parametrize(
    "values",
    [{"stretch": (0.1, 0.5)}, {"stretch": (-1.0, 0.5)}, {"shear": 1.0}, {"shear": 0.0}, {"curvature": -1.0}],
)
def test_impossible_ranges_are_refused(values: dict[str, object]) -> None:
    with pytest.raises(InputError, match="range of"):
        StrainRange(**values)  # type: ignore[arg-type]
