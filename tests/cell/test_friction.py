"""Friction in a periodic cell: Coulomb's law on a sliding yarn, exact stress, loops, dissipation, and its limits."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from yarnscale.cell import Equilibrium, PeriodicCell
from yarnscale.cell.friction import CellHistory
from yarnscale.cell.supercell import supercell, tiled
from yarnscale.drawing import library
from yarnscale.drawing.curves import PeriodicCurve, pattern_from_curves
from yarnscale.errors import InputError
from yarnscale.homogeneous.histories import path_with_friction
from yarnscale.kinematics import ShellStrain
from yarnscale.numerics.newton import Status
from yarnscale.yarn.friction import YarnFriction
from yarnscale.yarn.friction_pairs import FrictionPairs
from yarnscale.yarn.material import ContactRule, YarnMaterial

FRICTION = 0.3
SCALE = np.array([0.1, 0.1, 0.1, 60.0, 60.0, 60.0])
"""Strains of like importance of this knit, bent to radii of 17 mm."""


@pytest.fixture(scope="module")
def cell() -> PeriodicCell:
    return PeriodicCell(library.build("stockinette"), YarnMaterial.preset("hylc2020-stockinette"))


@pytest.fixture(scope="module")
def rest(cell: PeriodicCell) -> Equilibrium:
    return cell.relax()


def path(*turns: list[float], steps: int) -> list[ShellStrain]:
    """Straight ways between states, in so many steps each."""
    corners = [np.zeros(6), *map(np.array, turns)]
    ways = [np.linspace(a, b, steps + 1)[1:] for a, b in pairwise(corners)]
    return [ShellStrain.from_vector(state) for way in ways for state in way]


def test_springs_of_an_estimated_yarn_count_both_barriers_of_its_contact() -> None:
    """8 Σ k/R²: with the inner barrier 10⁴ times as stiff as the outer one, nearly all comes from it."""
    stiffness = []
    for inner in (1.0, 1e4):
        contact = ContactRule(kernel="est2022", outer_radius_ratio=1.0, inner_radius_ratio=0.95, inner_stiffness=inner)
        yarn = replace(YarnMaterial.preset("hylc2020-stockinette"), contact=contact, contact_stiffness=1.0)
        cell = PeriodicCell(library.build("stockinette"), yarn)
        (found,) = path_with_friction(
            CellHistory.begin(cell, YarnFriction(FRICTION), cell.relax()), [ShellStrain(s_x=0.02)]
        )
        stiffness.append(np.median(found.friction_pairs.stiffness))
    assert stiffness[1] / stiffness[0] == pytest.approx((1 + 1e4 / 0.95**2) / (1 + 1 / 0.95**2), rel=0.05)


PULLED, BENT = [0.15, 0.03, -0.05, 0, 0, 0], [0.02, 0, 0, 80.0, 0, 0]


def loop(
    cell: PeriodicCell, rest: Equilibrium, strains: list[ShellStrain], friction: float = FRICTION
) -> list[CellHistory]:
    start = CellHistory.begin(cell, YarnFriction(friction), rest)
    found = [start, *path_with_friction(start, strains)]
    assert len(found) == 1 + len(strains)
    return found


def work(found: list[CellHistory]) -> float:
    """∮ stress · d strain [J/m²]."""
    stress, strain = (np.array(v) for v in zip(*((h.state.stress, h.state.strain.vector) for h in found), strict=True))
    return float((0.5 * (stress[1:] + stress[:-1]) * np.diff(strain, axis=0)).sum())


@pytest.mark.parametrize("turn", [PULLED, BENT], ids=["flat", "bent"])
def test_stress_is_the_derivative_of_what_is_minimised(
    cell: PeriodicCell, rest: Equilibrium, turn: list[float]
) -> None:
    """Energy and potential of friction at fixed fluctuations, by every strain."""
    history = loop(cell, rest, path(turn, steps=3))[-1]
    ahead = replace(cell, friction_pairs=history.friction_pairs)
    state, step = history.state, 1e-6 * SCALE
    energy = ahead.energy(state.strain)
    random = np.random.default_rng(1)
    x = energy.start(state.fluctuation / cell.pattern.radius, state.twist) + 1e-3 * random.normal(size=4 * energy.count)

    def value(strain: np.ndarray) -> float:
        return ahead.energy(ShellStrain.from_vector(strain)).value(x) * energy.unit / cell.pattern.area

    z = state.strain.vector
    slopes = [(value(z + d) - value(z - d)) / (2 * d.sum()) for d in np.diag(step)]
    stress, without = energy.stress(x), cell.energy(state.strain).stress(x)
    np.testing.assert_allclose(stress * SCALE, slopes * SCALE, atol=1e-5 * np.abs(stress * SCALE).max())
    assert np.abs((stress - without) * SCALE).max() > 0.02 * np.abs(stress * SCALE).max()


def test_a_state_without_slip_is_in_equilibrium_with_its_springs(cell: PeriodicCell, rest: Equilibrium) -> None:
    """Springs hold static friction: once pressures have settled, steps that go nowhere change nothing, however many."""
    found = loop(cell, rest, [*path(PULLED, [0.1, 0.02, -0.03, 0, 0, 0], steps=4)])
    still = loop_on(found[-1], [found[-1].state.strain] * 8)
    np.testing.assert_allclose(still[-1].state.stress[:3], still[-3].state.stress[:3], rtol=1e-5)
    assert sum(h.dissipated for h in still[-3:]) < 1e-7 * sum(h.dissipated for h in found)


def loop_on(history: CellHistory, strains: list[ShellStrain]) -> list[CellHistory]:
    return list(path_with_friction(history, strains))


def test_without_friction_the_cell_is_elastic(cell: PeriodicCell, rest: Equilibrium) -> None:
    tight = cell.with_options(tolerance=1e-10)
    strains = path(PULLED, BENT, steps=2)
    for history, strain in zip(loop(tight, rest, strains, 0.0)[1:], strains, strict=True):
        elastic = tight.relax(strain, start=history.state)
        np.testing.assert_allclose(
            history.state.stress * SCALE,
            elastic.stress * SCALE,
            atol=1e-8 * np.abs(elastic.stress * SCALE).max(),
        )
        assert history.stored == pytest.approx(elastic.energy_density, rel=1e-8)
        assert history.dissipated == 0.0


def test_loops_converge_with_the_steps_and_their_work_is_what_friction_takes(
    cell: PeriodicCell, rest: Equilibrium
) -> None:
    takes, errors = [], []
    for steps in (3, 6, 12):
        found = loop(cell, rest, path(PULLED, [0.0] * 6, steps=steps))
        takes.append(sum(h.dissipated for h in found))
        errors.append(abs(work(found) - takes[-1] - (found[-1].stored - found[0].stored)))
        assert min(h.dissipated for h in found) >= 0.0
    assert takes[-1] > 0.002
    assert abs(takes[2] - takes[1]) < 0.5 * abs(takes[1] - takes[0])
    assert errors[2] < 0.7 * errors[1] < 0.5 * errors[0]
    assert errors[2] < 0.1 * takes[2]


def test_a_cell_of_two_periods_has_the_same_loop(cell: PeriodicCell, rest: Equilibrium) -> None:
    strains = path(BENT, PULLED, steps=3)
    one, two = loop(cell, rest, strains), loop(supercell(cell, (2, 1)), tiled(rest, (2, 1)), strains)
    for a, b in zip(one, two, strict=True):
        # Moments across a cylinder depend on how far the midsurface is solved for, with and without friction.
        mine, other = ((h.state.stress * SCALE)[:4] for h in (a, b))
        np.testing.assert_allclose(other, mine, atol=1e-5 * np.abs(mine).max())
        assert b.dissipated == pytest.approx(a.dissipated, rel=1e-5)


@pytest.mark.parametrize("seed", [0, 1])
def test_random_paths_of_all_strains(cell: PeriodicCell, rest: Equilibrium, seed: int) -> None:
    random = np.random.default_rng(seed)
    turns = [list(SCALE * random.uniform(-0.5, 0.5, 6)) for _ in range(4)]
    found = loop(cell, rest, path(*turns, steps=2))
    for history in found:
        assert history.dissipated >= 0.0
        friction_pairs = history.friction_pairs
        assert (
            np.linalg.norm(friction_pairs.spring, axis=1)
            <= friction_pairs.limit / friction_pairs.stiffness * (1 + 1e-9)
        ).all()
    assert max(h.stored for h in found) < 1.0


def test_a_yarn_dragged_over_another_slides_at_its_share_of_the_pressure() -> None:
    """Springs and sliders of two crossing yarns: a force of μ N, and a cycle loses 4 μ N (A − h)."""
    radius, along = 1e-3, np.arange(8) * 1e-3
    zero = np.zeros(8)
    lines = np.stack([along, zero, zero], 1), np.stack([zero + 2.9e-3, along, zero + 1.6e-3], 1)
    curves = [PeriodicCurve(line, turn) for line, turn in zip(lines, ((1, 0), (0, 1)), strict=True)]
    pattern = pattern_from_curves(curves, np.array([8e-3, 8e-3]), radius)
    cell = PeriodicCell(pattern, YarnMaterial(5e5, 2e5, 1.0, 60.0, 120.0), sliding=True)
    state = cell.with_options(max_iterations=0).relax()
    state = replace(state, fluctuation=np.zeros_like(state.fluctuation), status=Status.CONVERGED)

    def dragged(history: CellHistory, way: float) -> CellHistory:
        moved = state.fluctuation.copy()
        moved[:, 0] = np.where(pattern.yarn_of_vertex == 0, -0.5, 0.5) * way * radius
        found = history.step(lambda *_: replace(state, fluctuation=moved))
        assert found is not None
        return found

    size, found = 0.15, [CellHistory.begin(cell, YarnFriction(FRICTION), state)]
    for way in size * np.concatenate([[1.0], np.linspace(1, -1, 21), np.linspace(-1, 1, 21)]):
        found.append(dragged(found[-1], way))
    friction_pairs, unit = found[-1].friction_pairs, cell.energy(ShellStrain()).unit
    limit = friction_pairs.limit[above := friction_pairs.pairs[:, 0] < 8]
    force = np.linalg.norm((friction_pairs.stiffness[:, None] * friction_pairs.spring)[above].sum(axis=0))
    # Some of the pressures lean along the way: their sum is an upper bound, their resultant a lower one.
    least = np.linalg.norm((limit[:, None] * friction_pairs.normal[above]).sum(axis=0))
    assert least <= force <= limit.sum() < 1.1 * least
    loss = sum(h.dissipated for h in found[3:]) * pattern.area / unit
    expected = [
        4 * g.limit @ (size * np.sqrt(1.0 - g.normal[:, 0] ** 2) - g.limit / g.stiffness)
        for g in (h.friction_pairs for h in found[2:])
    ]
    # Pressure moves from pair to pair as the yarn goes on, and springs of pairs that it leaves lose their energy.
    assert loss == pytest.approx(np.mean(expected), rel=0.02)


def test_springs_are_found_by_their_pair_among_any_number_of_vertices() -> None:
    pairs = np.array([[0, 1 << 16, 0, 0], [1, 0, 0, 0], [70_000, 3, -1, 2], [3, 70_000, 1, -2], [1, 0, -1, 0]])
    springs, numbers = np.arange(15.0).reshape(5, 3), np.ones(5)
    friction_pairs = FrictionPairs(pairs, np.zeros((5, 2)), springs, springs, numbers, numbers, springs)
    wanted = np.concatenate([pairs[::-1], [[1, 1, 0, 0], [0, 0, 0, 0]]])
    np.testing.assert_array_equal(friction_pairs._found(wanted), np.concatenate([springs[::-1], np.zeros((2, 3))]))
    assert friction_pairs._found(np.empty((0, 4), np.int64)).shape == (0, 3)
    np.testing.assert_array_equal(FrictionPairs.none()._found(pairs), np.zeros((5, 3)))


def test_a_path_begins_at_an_equilibrium():
    cell = PeriodicCell(library.build("plain"), YarnMaterial.preset("acrylic"))
    state = cell.with_options(max_iterations=1).relax()
    with pytest.raises(InputError, match="path with friction; expected an equilibrium; found iteration_limit"):
        CellHistory.begin(cell, YarnFriction(0.2), state)
