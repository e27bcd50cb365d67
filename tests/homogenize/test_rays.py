"""Rays of loads: which are planned, what sampling finds along them, and what interruptions leave."""

from __future__ import annotations

import json
import shutil
from collections import Counter
from concurrent.futures import Executor, Future
from contextlib import contextmanager
from itertools import islice
from pathlib import Path

import numpy as np
import pytest

from yarnscale.cell import PeriodicCell
from yarnscale.drawing import library
from yarnscale.errors import InputError
from yarnscale.homogeneous import fabrics as fabrics_module
from yarnscale.homogeneous.loads import FLAT, Loads, Prescribed
from yarnscale.homogenize import load_samples
from yarnscale.homogenize import sample as module
from yarnscale.homogenize.load_samples import visiting_rays
from yarnscale.homogenize.plan import StrainGrid
from yarnscale.homogenize.rays import (
    ITERATES,
    LEVELS,
    SOLVES,
    VISITED,
    Ray,
    box_strains,
    load_rays,
    ray_to,
    strains_held,
)
from yarnscale.homogenize.sample import create_ray_store, create_store, resumed_ray_store, sample
from yarnscale.homogenize.states import FabricStates
from yarnscale.homogenize.store import SampleStore
from yarnscale.homogenize.worker import CODE_OF
from yarnscale.kinematics import ShellStrain
from yarnscale.yarn.material import PRESETS

REST = Ray("rest", ((Loads(), strains_held(np.zeros(6))),))
TENSION = Ray("tension", tuple((Loads.components(s_x=load, s_y=load), FLAT) for load in (0.1, 0.1, 0.5)))
TOO_TIGHT = Ray("strain", tuple((Loads(), Prescribed.components(II11=curvature)) for curvature in (900.0, 0.0)))
"""Its first level asks for more curvature than the cell of these tests bears."""
RAYS = [REST, TENSION, TOO_TIGHT]


@pytest.fixture(scope="module")
def cell() -> PeriodicCell:
    return PeriodicCell(library.build("plain"), PRESETS["hylc2020-stockinette"])


class Inline(Executor):
    """Works at once in this process."""

    def submit(self, fn, /, *args, **kwargs):  # type: ignore[no-untyped-def]
        future: Future = Future()
        future.set_result(fn(*args, **kwargs))
        return future


@pytest.fixture
def inline(monkeypatch: pytest.MonkeyPatch) -> None:
    @contextmanager
    def workers(count: int):  # type: ignore[no-untyped-def]
        yield Inline()

    monkeypatch.setattr(module, "local_workers", workers)


def test_plans_hold_all_kinds_of_states_over_the_decades(cell: PeriodicCell) -> None:
    rays = load_rays(cell, solves=SOLVES, limit=40.0)
    kinds = Counter(ray.kind for ray in rays)
    assert set(kinds) == {"rest", "tension", "bending", "bent", "stress", "strain"}
    pulls = [load for ray in rays for loads, _ in ray.levels for _, load in loads.tensions]
    assert max(pulls) == pytest.approx(44.0)  # beyond the limit, which virtual tests reach
    weight_of_a_centimetre = cell.area_density * 9.81 * 0.01
    assert 0.01 * weight_of_a_centimetre < min(pulls) < 0.2 * weight_of_a_centimetre
    even = [ray for ray in rays if ray.kind == "tension" and len(ray.levels) == LEVELS]
    steps = np.diff(np.log([loads.work(np.zeros(6))[1][:3].max() for loads, _ in even[0].levels]))
    assert len(steps) == LEVELS - 1
    assert steps == pytest.approx(steps[0])
    closer = [ray for ray in rays if ray.kind == "tension" and len(ray.levels) > 1.5 * LEVELS]
    assert [ray.levels[0][0].tensions[0][0] for ray in closer] == pytest.approx([0.0, np.pi / 2, np.pi / 4])
    assert sum(len(ray.levels) for ray in rays) < SOLVES < ITERATES * sum(len(ray.levels) for ray in rays)
    bent = np.array([ray.levels[0][1].values for ray in rays if ray.kind == "bent" and not ray.origin])
    determinant = bent[:, 0] * bent[:, 2] - bent[:, 1] ** 2
    doubly = np.abs(determinant) > 1e-6 * (bent**2).sum(axis=1)
    assert doubly.any() and not doubly.all()


def test_bending_and_shear_under_tension_go_on_from_that_tension(cell: PeriodicCell) -> None:
    rays, curled, sheared = load_rays(cell, solves=600), Counter[bool](), []
    longest = max(len(ray.levels) for ray in rays)
    for ray in (ray for ray in rays if ray.origin):
        before, level = divmod(ray.origin // ITERATES, longest)
        assert {loads for loads, _ in ray.levels} == {rays[before].levels[level][0]}
        last = ray.levels[-1][1]
        if len(last.values) == 4:
            sheared.append(float(last.values[-1]))
        elif len(last.values) == 3 and np.abs(last.values).max() * cell.pattern.radius > 0.2:
            curled[bool(abs(last.values[2]) > abs(last.values[0]))] += 1
    assert curled == {True: 6, False: 6}  # about course and wale, at three loads, to both sides
    assert min(sheared) < -0.1 and max(sheared) > 0.1


def test_plans_are_the_same_every_time_and_longer_ones_begin_alike(cell: PeriodicCell) -> None:
    few, many = load_rays(cell, solves=300), load_rays(cell, solves=500)
    assert [ray.plain() for ray in few] == [ray.plain() for ray in load_rays(cell, solves=300)]
    assert len(few) < len(many)
    assert [ray.plain() for ray in few] == [ray.plain() for ray in many][: len(few)]
    assert [ray.plain() for ray in load_rays(cell, solves=300, seed=1)] != [ray.plain() for ray in few]


def test_rays_survive_being_written(cell: PeriodicCell) -> None:
    for ray in load_rays(cell, solves=200):
        again = Ray.from_plain(json.loads(json.dumps(ray.plain())))
        assert again.plain() == ray.plain()


def test_box_states_bend_in_every_direction() -> None:
    strains = np.array(list(islice(box_strains(0.001, 0), 64)))
    assert (np.abs(strains[:, 1]) <= 0.6).all() and (strains[:, [0, 2]] >= -0.2).all()
    assert (np.abs(strains[:, 4]) > 1.0).mean() > 0.3
    determinant = strains[:, 3] * strains[:, 5] - strains[:, 4] ** 2
    assert (determinant > 1.0).any() and (determinant < -1.0).any()
    assert ray_to(strains[0]).levels[-1][1].values == pytest.approx(strains[0])


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"limit": 0.0}, "largest load"),
        ({"limit": 1e9}, "twice as long"),
        ({"limit": float("nan")}, "largest load"),
        ({"solves": 3}, "number of solves"),
    ],
)
def test_plans_without_states_are_refused(cell: PeriodicCell, options: dict, message: str) -> None:
    with pytest.raises(InputError, match=message):
        load_rays(cell, **options)


@pytest.fixture
def sampled(cell: PeriodicCell, tmp_path: Path, inline: None, monkeypatch: pytest.MonkeyPatch) -> SampleStore:
    monkeypatch.setattr(fabrics_module, "TIGHTEST", 1e-5)
    store = create_ray_store(tmp_path / "store", cell, RAYS)
    sample(cell, store)
    return store


def test_tension_goes_on_behind_one_load_without_equilibrium(
    cell: PeriodicCell, tmp_path: Path, inline: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(fabrics_module, "TIGHTEST", 1e-5)
    impossible = (Loads(), Prescribed.components(II11=900.0))
    pulls = tuple((Loads.components(s_x=load, s_y=load), FLAT) for load in (0.1, 0.2))
    rays = [REST, *(Ray("tension", (impossible,) * n + pulls[: 3 - n]) for n in (1, 2))]
    store = create_ray_store(tmp_path / "store", cell, rays)
    sample(cell, store)
    found = (store.status().reshape(store.shape) == CODE_OF["converged"]).any(axis=2)
    assert found[1:].tolist() == [[False, True, True], [False, False, False]]


def test_samples_are_equilibria_that_meet_their_loads(cell: PeriodicCell, sampled: SampleStore, tmp_path: Path) -> None:
    codes = sampled.status().reshape(sampled.shape)
    converged, stalled, excluded = (CODE_OF[name] for name in ("converged", "stalled", "excluded"))
    assert codes[0].tolist() == [[converged, excluded, excluded], [excluded] * 3, [excluded] * 3]
    assert codes[1, 0, 0] == codes[1, 2, 0] == converged
    assert (codes[1, 1] == excluded).all()  # the load of the level before: passed over
    assert codes[2].tolist() == [[stalled, excluded, excluded], [excluded] * 3, [excluded] * 3]
    states = FabricStates.of(sampled)
    assert Counter(states.kinds.tolist()).keys() == {"rest", "tension"}
    assert np.isfinite(states.moduli).all()
    assert states.strains[:, 3:] == pytest.approx(0.0)
    assert (states.density, states.radius) == (pytest.approx(cell.area_density), cell.pattern.radius)
    assert states.stresses[-1][[0, 2]] == pytest.approx([0.5, 0.5], rel=0.25)
    moved, step = states.strains[-1].copy(), 1e-4
    moved[0] += step
    ahead = cell.relax(ShellStrain.from_vector(moved))
    slope = (ahead.stress - states.stresses[-1]) / step
    assert slope[:3] == pytest.approx(states.moduli[-1][0, :3], rel=0.05, abs=0.05)

    # What a killed run leaves, a level of which one state is written, is done again to the same end.
    torn = tmp_path / "torn"
    shutil.copytree(sampled.path, torn)
    for place in range(ITERATES - 2, ITERATES):
        (torn / "status" / "c" / "1" / "2" / str(place)).unlink()
    again = SampleStore(torn)
    assert (again.status() == 0).sum() == (sampled.status() == 0).sum() + 2
    sample(cell, again)
    assert np.array_equal(FabricStates.of(again).strains, states.strains)
    assert np.array_equal(FabricStates.of(again).moduli, states.moduli)


def test_rays_are_added_behind_those_that_are_there(cell: PeriodicCell, sampled: SampleStore) -> None:
    before = FabricStates.of(sampled)
    longer = sampled.extended([ray_to(np.array([0.05, 0.02, 0, 0, 0, 0]), 1).plain()])
    assert resumed_ray_store(longer, cell, RAYS) is longer
    assert longer.shape[0] == 4
    summary = sample(cell, longer)
    states = FabricStates.of(longer)
    assert summary.converged == len(states.energies) > len(before.energies)
    assert np.array_equal(states.strains[: len(before.strains)], before.strains)
    assert states.strains[-1] == pytest.approx([0.05, 0.02, 0, 0, 0, 0])


def test_only_the_same_loads_resume(cell: PeriodicCell, tmp_path: Path) -> None:
    store = create_ray_store(tmp_path / "store", cell, RAYS)
    visited = Ray(VISITED, ((Loads(), strains_held(np.full(6, 0.01))),), 3)
    store = store.extended([visited.plain()])
    more = resumed_ray_store(store, cell, [*RAYS, TENSION])
    assert [ray["kind"] for ray in more.rays] == ["rest", "tension", "strain", VISITED, "tension"]
    assert resumed_ray_store(more, cell, RAYS) is more
    with pytest.raises(InputError, match="cannot resume: other loads"):
        resumed_ray_store(store, cell, [REST, TOO_TIGHT])
    with pytest.raises(InputError, match="cannot resume: another pattern"):
        resumed_ray_store(store, PeriodicCell(library.build("twill-2x1"), cell.material), RAYS)
    grid = create_store(tmp_path / "grid", cell, StrainGrid().axes, scattered=False)
    with pytest.raises(InputError, match="cannot resume: a store without loads"):
        resumed_ray_store(grid, cell, RAYS)
    with pytest.raises(InputError, match="rays cannot be added"):
        grid.extended([REST.plain()])


def test_visited_states_are_reached_from_their_nearest_samples(cell: PeriodicCell, sampled: SampleStore) -> None:
    known = FabricStates.of(sampled)
    scale = np.array([0.5] * 3 + [0.1 / cell.pattern.radius] * 3)
    far, near = known.strains[-1] + np.array([0, 0.2, 0, 0, 0, 0]), known.strains[-1] + 1e-3 * scale
    rays = visiting_rays(sampled, np.array([near, far, far + 1e-4, np.full(6, np.nan)]), scale)
    assert [ray.kind for ray in rays] == ["visited"]
    assert sampled.read(rays[0].origin, "strain") == pytest.approx(known.strains[-1])
    longer = sampled.extended([ray.plain() for ray in rays])
    sample(cell, longer)
    states = FabricStates.of(longer)
    assert states.kinds[-1] == "visited"
    assert states.strains[-1] == pytest.approx(far, abs=2e-4)
    assert not visiting_rays(longer, far[None], scale)


def test_samples_of_a_material_and_those_that_judge_it_are_apart(
    cell: PeriodicCell, tmp_path: Path, inline: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    plans: list[dict] = []

    def plan(cell: PeriodicCell, **options: object) -> list[Ray]:
        plans.append(options)
        return [REST, TENSION] if options.get("fixed", True) else [REST, ray_to(np.array([0.1, 0, 0, 0, 0, 0]), 1)]

    monkeypatch.setattr(load_samples, "load_rays", plan)
    found = load_samples.sample_loads(cell, tmp_path, solves=400, limit=7.0)
    assert [(p["solves"], p["limit"]) for p in plans] == [(400, 7.0), (40, 7.0)]
    assert plans[1]["seed"] != plans[0].get("seed", 0)
    assert set(found.samples.kinds) == {"rest", "tension"} and set(found.unseen.kinds) == {"rest", "strain"}
    assert found.summary.converged == len(found.samples.energies) + len(found.unseen.energies) == found.summary.states
    with pytest.raises(InputError, match="output exists"):
        load_samples.sample_loads(cell, tmp_path, solves=400, limit=7.0)
    far = np.array([[0.0, 0.3, 0.0, 0.0, 0.0, 0.0]])
    more = load_samples.sample_loads(cell, tmp_path, solves=400, limit=7.0, resume=True, visited=far)
    assert set(more.samples.kinds) == {"rest", "tension", "visited"}
    again = load_samples.sample_loads(cell, tmp_path, solves=400, limit=7.0, resume=True, visited=far)
    assert len(again.samples.energies) == len(more.samples.energies)
