"""The minimiser: what it must find, and what it must say when it cannot."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from yarnscale.numerics.factor import SymmetricPattern
from yarnscale.numerics.kkt import LinearConstraints
from yarnscale.numerics.linear_solver import linear_solver
from yarnscale.numerics.newton import NewtonOptions, Reuse, Solution, Status, minimise
from yarnscale.numerics.regularisation import ShiftRule


def full_pattern(n: int) -> SymmetricPattern:
    return SymmetricPattern.from_keys(n, np.array([j * n + i for j in range(n) for i in range(j, n)]))


class Model:
    def __init__(self, matrix: np.ndarray, pattern: SymmetricPattern) -> None:
        self.matrix, self.pattern = matrix, pattern

    def values(self, shift: float) -> np.ndarray:
        columns = np.repeat(np.arange(self.pattern.size), np.diff(self.pattern.starts))
        return (self.matrix + shift * np.eye(self.pattern.size))[self.pattern.rows, columns]


class Dense:
    """An objective from three plain functions; counts its evaluations and keeps its best trial."""

    residual_scale = 1.0

    def __init__(
        self,
        n: int,
        value: Callable[[np.ndarray], float],
        gradient: Callable[[np.ndarray], np.ndarray],
        hessian: Callable[[np.ndarray], np.ndarray],
    ) -> None:
        self._value, self._gradient, self._hessian = value, gradient, hessian
        self.pattern, self.values = full_pattern(n), 0

    def value(self, x: np.ndarray) -> float:
        self.values += 1
        return self._value(x)

    def gradient(self, x: np.ndarray) -> tuple[float, np.ndarray]:
        return self._value(x), self._gradient(x)

    def quadratic(self, x: np.ndarray) -> tuple[float, np.ndarray, Model]:
        return self._value(x), self._gradient(x), Model(self._hessian(x), self.pattern)


def quadratic_form(matrix: np.ndarray, right: np.ndarray) -> Dense:
    return Dense(
        len(right),
        lambda x: float(0.5 * x @ matrix @ x - right @ x),
        lambda x: matrix @ x - right,
        lambda x: matrix,
    )


def positive_definite(n: int, seed: int = 0) -> np.ndarray:
    root = np.random.default_rng(seed).normal(size=(n, n))
    return root @ root.T + np.eye(n)


def rosenbrock(n: int) -> Dense:
    def value(x: np.ndarray) -> float:
        return float((100 * (x[1:] - x[:-1] ** 2) ** 2 + (1 - x[:-1]) ** 2).sum())

    def gradient(x: np.ndarray) -> np.ndarray:
        g, gap = np.zeros(n), x[1:] - x[:-1] ** 2
        g[:-1] += -400 * x[:-1] * gap - 2 * (1 - x[:-1])
        g[1:] += 200 * gap
        return g

    def hessian(x: np.ndarray) -> np.ndarray:
        h = np.zeros((n, n))
        k = np.arange(n - 1)
        h[k, k] += 1200 * x[:-1] ** 2 - 400 * x[1:] + 2
        h[k + 1, k + 1] += 200
        h[k, k + 1] -= 400 * x[:-1]
        h[k + 1, k] -= 400 * x[:-1]
        return h

    return Dense(n, value, gradient, hessian)


def never_nan(solution: Solution) -> None:
    assert isinstance(solution.status, Status)
    assert not math.isnan(solution.value)
    assert np.isfinite(solution.x).all()
    assert all(not math.isnan(energy) for energy, _ in solution.history)


NO_SHIFT = ShiftRule(start=0.0, lowest=0.0, lowest_is_zero=True)


def test_a_convex_quadratic_takes_one_step() -> None:
    matrix, right = positive_definite(8), np.arange(8.0)
    solution = minimise(quadratic_form(matrix, right), np.ones(8), NewtonOptions(shift=NO_SHIFT, tolerance=1e-9))
    assert (solution.status, solution.iterations, solution.factorisations) == (Status.CONVERGED, 1, 2)
    np.testing.assert_allclose(solution.x, np.linalg.solve(matrix, right), rtol=1e-10)
    assert solution.residual <= 1e-9


def test_no_step_from_a_minimum() -> None:
    matrix, right = positive_definite(4), np.ones(4)
    solution = minimise(quadratic_form(matrix, right), np.linalg.solve(matrix, right))
    assert (solution.status, solution.iterations) == (Status.CONVERGED, 0)


def test_linear_constraints_hold_exactly() -> None:
    rng = np.random.default_rng(1)
    matrix, right = positive_definite(9), rng.normal(size=9)
    rows, wanted = rng.normal(size=(3, 9)), rng.normal(size=3)
    kkt = np.block([[matrix, rows.T], [rows, np.zeros((3, 3))]])
    expected = np.linalg.solve(kkt, np.concatenate([right, wanted]))[:9]
    constraints = LinearConstraints(rows, wanted)
    solution = minimise(
        quadratic_form(matrix, right),
        np.zeros(9),
        NewtonOptions(shift=NO_SHIFT, tolerance=1e-9),
        linear=linear_solver(constraints),
    )
    assert solution.converged and solution.iterations == 1
    np.testing.assert_allclose(solution.x, expected, rtol=1e-9, atol=1e-11)
    np.testing.assert_allclose(rows @ solution.x, wanted, atol=1e-13)


def test_constraints_make_an_indefinite_hessian_a_minimum() -> None:
    """H is negative only across the constraint: a minimum, and no saddle to leave."""
    matrix = np.diag([1.0, 2.0, -0.5])
    constraints = LinearConstraints(np.array([[0.0, 0.0, 1.0]]), np.array([0.3]))
    solution = minimise(
        quadratic_form(matrix, np.ones(3)),
        np.zeros(3),
        NewtonOptions(tolerance=1e-9),
        linear=linear_solver(constraints),
    )
    assert solution.converged
    np.testing.assert_allclose(solution.x, [1.0, 0.5, 0.3], atol=1e-8)


def test_constraints_are_met_from_an_infeasible_start_with_a_bounded_step() -> None:
    constraints = LinearConstraints(np.ones((1, 6)), np.array([12.0]))

    def bound(x: np.ndarray, step: np.ndarray) -> float:
        return min(1.0, 0.25 / np.abs(step).max())

    solution = minimise(
        rosenbrock(6),
        np.zeros(6),
        NewtonOptions(tolerance=1e-8),
        bound=bound,
        linear=linear_solver(constraints),
    )
    assert solution.converged
    assert abs(solution.x.sum() - 12.0) < 1e-10
    gradient = rosenbrock(6).gradient(solution.x)[1]
    np.testing.assert_allclose(gradient, gradient.mean(), atol=1e-6)


@pytest.mark.parametrize("n", [2, 5, 20])
def test_rosenbrock(n: int) -> None:
    start = np.tile([-1.2, 1.0], n)[:n]
    solution = minimise(rosenbrock(n), start, NewtonOptions(tolerance=1e-9, max_iterations=200))
    assert solution.converged and solution.iterations < 120
    gradient, hessian = rosenbrock(n).gradient(solution.x)[1], rosenbrock(n)._hessian(solution.x)
    np.testing.assert_allclose(gradient, 0, atol=1e-8)
    assert np.linalg.eigvalsh(hessian)[0] > 0
    energies = [energy for energy, _ in solution.history]
    assert (np.diff(energies) < 0).all(), "every accepted step lowers the energy"


def double_well(n: int = 2) -> Dense:
    """Σ ¼ (x₀² − 1)² + ½ x_k²: a saddle at 0, minima at ±1."""

    def gradient(x: np.ndarray) -> np.ndarray:
        g = x.copy()
        g[0] = x[0] * (x[0] ** 2 - 1)
        return g

    def hessian(x: np.ndarray) -> np.ndarray:
        return np.diag([3 * x[0] ** 2 - 1] + [1.0] * (n - 1))

    return Dense(n, lambda x: float(0.25 * (x[0] ** 2 - 1) ** 2 + 0.5 * (x[1:] ** 2).sum()), gradient, hessian)


def test_a_factor_used_again_saves_factorisations_on_the_way_to_the_same_minimum() -> None:
    constraints = LinearConstraints(np.ones((1, 30)), np.array([20.0]))
    start = np.linspace(0.0, 1.0, 30) + 1.0 / 6.0
    once, again = (
        minimise(
            rosenbrock(30),
            start,
            NewtonOptions(tolerance=1e-9, reuse=reuse),
            linear=linear_solver(constraints),
        )
        for reuse in (None, Reuse())
    )
    assert once.converged
    assert again.converged
    np.testing.assert_allclose(again.x, once.x, atol=1e-7)
    assert again.factorisations < 0.8 * once.factorisations


def test_a_start_on_a_saddle_is_left() -> None:
    solution = minimise(double_well(), np.zeros(2), NewtonOptions(tolerance=1e-9))
    assert solution.converged
    np.testing.assert_allclose(np.abs(solution.x), [1, 0], atol=1e-8)


def test_a_saddle_is_left_along_the_constraints() -> None:
    constraints = LinearConstraints(np.array([[0.0, 1.0, 1.0]]), np.array([0.5]))
    solution = minimise(
        double_well(3),
        np.array([0.0, 0.25, 0.25]),
        NewtonOptions(tolerance=1e-9),
        linear=linear_solver(constraints),
    )
    assert solution.converged
    np.testing.assert_allclose([abs(solution.x[0]), *solution.x[1:]], [1, 0.25, 0.25], atol=1e-8)


def test_a_saddle_may_be_accepted_on_request() -> None:
    solution = minimise(double_well(), np.zeros(2), NewtonOptions(check_minimum=False))
    assert solution.converged and not solution.x.any()


@pytest.mark.parametrize("bad", [math.inf, math.nan])
def test_an_invalid_start_is_told(bad: float) -> None:
    objective = Dense(2, lambda x: bad, lambda x: x, lambda x: np.eye(2))
    solution = minimise(objective, np.ones(2))
    assert solution.status is Status.INVALID and not solution.converged
    never_nan(solution)


def test_a_start_with_an_infinite_gradient_is_told() -> None:
    objective = Dense(2, lambda x: 1.0, lambda x: np.array([np.nan, 1.0]), lambda x: np.eye(2))
    solution = minimise(objective, np.ones(2))
    assert solution.status is Status.INVALID
    never_nan(solution)


def test_a_barrier_is_never_crossed() -> None:
    """−log x₀ + x₀: infinite for x₀ ≤ 0, and the first full steps would go there."""

    def value(x: np.ndarray) -> float:
        return math.inf if x[0] <= 0 else float(x[0] - math.log(x[0]) + 0.5 * x[1] ** 2)

    objective = Dense(2, value, lambda x: np.array([1 - 1 / x[0], x[1]]), lambda x: np.diag([1 / x[0] ** 2, 1.0]))
    seen = []
    solution = minimise(
        objective, np.array([5.0, 3.0]), NewtonOptions(tolerance=1e-9), after_step=lambda x: seen.append(x[0])
    )
    assert solution.converged and min(seen) > 0
    np.testing.assert_allclose(solution.x, [1, 0], atol=1e-8)
    never_nan(solution)


def test_the_bound_is_respected_by_every_step() -> None:
    visited = [np.array([-1.2, 1.0])]
    limit = 0.05

    def bound(x: np.ndarray, step: np.ndarray) -> float:
        return min(1.0, limit / np.linalg.norm(step))

    minimise(
        rosenbrock(2),
        visited[0],
        NewtonOptions(max_iterations=400),
        bound=bound,
        after_step=lambda x: visited.append(x.copy()),
    )
    moves = np.linalg.norm(np.diff(visited, axis=0), axis=1)
    assert len(moves) > 10 and moves.max() <= limit * (1 + 1e-12)
    np.testing.assert_allclose(visited[-1], 1, atol=1e-4)


def test_the_bound_holds_when_a_saddle_is_left() -> None:
    visited = [np.zeros(2)]
    minimise(
        double_well(),
        visited[0],
        bound=lambda x, step: min(1.0, 0.1 / np.linalg.norm(step)),
        after_step=lambda x: visited.append(x.copy()),
    )
    assert np.linalg.norm(np.diff(visited, axis=0), axis=1).max() <= 0.1 * (1 + 1e-12)


def test_the_iteration_limit_is_told_and_the_best_point_returned() -> None:
    start = np.array([-1.2, 1.0])
    solution = minimise(rosenbrock(2), start, NewtonOptions(max_iterations=3))
    assert (solution.status, solution.iterations) == (Status.ITERATION_LIMIT, 3)
    assert solution.value < rosenbrock(2).value(start)
    assert solution.value == pytest.approx(rosenbrock(2).value(solution.x))
    assert len(solution.history) == 4


def test_no_iterations_allowed() -> None:
    solution = minimise(rosenbrock(2), np.zeros(2), NewtonOptions(max_iterations=0))
    assert (solution.status, solution.iterations) == (Status.ITERATION_LIMIT, 0)


def test_an_unreachable_minimum_stalls() -> None:
    """The way down is closed by an inadmissible region right at the start."""

    def value(x: np.ndarray) -> float:
        return math.inf if x[0] < 1.0 else float(x @ x)

    objective = Dense(2, value, lambda x: 2 * x, lambda x: 2 * np.eye(2))
    solution = minimise(objective, np.array([1.0, 0.0]))
    assert solution.status is Status.STALLED
    np.testing.assert_array_equal(solution.x, [1, 0])
    never_nan(solution)


def test_a_forbidden_step_stalls() -> None:
    solution = minimise(rosenbrock(2), np.zeros(2), bound=lambda x, step: 0.0)
    assert solution.status is Status.STALLED
    never_nan(solution)


def test_a_wrong_gradient_stalls() -> None:
    form = quadratic_form(np.eye(2), np.zeros(2))
    objective = Dense(2, form._value, lambda x: -x, lambda x: np.eye(2))
    solution = minimise(objective, np.ones(2))
    assert solution.status is Status.STALLED
    assert solution.value == 1.0


def test_a_step_that_gains_too_little_is_the_last_but_not_one_that_failed() -> None:
    """½ x² from x = 1 can gain ½; where the energy rises along every step, short steps tell nothing of the end."""
    slope = quadratic_form(np.eye(1), np.zeros(1))
    seen: list[float] = []
    near = minimise(
        slope,
        np.ones(1),
        NewtonOptions(tolerance=1e-9, enough=0.6),
        after_step=lambda x: seen.append(float(x[0])),
    )
    assert near.status is Status.CONVERGED and near.factorisations == near.iterations == 1
    assert abs(near.x[0]) < 0.02 and seen == [near.x[0]] and near.gradient[0] == near.x[0]  # taken all the same
    far = minimise(slope, np.ones(1), NewtonOptions(tolerance=1e-9, enough=0.4))
    assert far.status is Status.CONVERGED and far.iterations == 2 and abs(far.x[0]) < abs(near.x[0])
    wrong = Dense(1, lambda x: float(-x[0]), lambda x: x, lambda x: np.eye(1))
    assert minimise(wrong, np.ones(1), NewtonOptions(tolerance=1e-9, enough=0.4)).status is Status.STALLED


def test_a_step_that_a_large_shift_shortened_is_not_taken_for_one_that_gains_little() -> None:
    """With a shift of 100 the first step of ½ x² gains less than a hundredth of what there is to gain."""
    slope = quadratic_form(np.eye(1), np.zeros(1))
    solution = minimise(slope, np.ones(1), NewtonOptions(tolerance=1e-9, enough=0.1, shift=ShiftRule(start=100.0)))
    assert solution.status is Status.CONVERGED and solution.iterations > 1
    assert 0.5 * solution.x[0] ** 2 < 0.1
    # A falling curvature is no end either, however little the step promises.
    saddle = Dense(
        1,
        lambda x: 0.25 * float(x[0] ** 4) - 0.5 * float(x[0] ** 2),
        lambda x: x**3 - x,
        lambda x: np.diag(3 * x**2 - 1),
    )
    left = minimise(saddle, np.full(1, 0.01), NewtonOptions(tolerance=1e-9, enough=0.01))
    assert left.status is Status.CONVERGED and left.value == pytest.approx(-0.25, abs=0.01)


def test_a_hessian_of_nan_stalls() -> None:
    objective = Dense(2, lambda x: float(x @ x), lambda x: 2 * x, lambda x: np.full((2, 2), np.nan))
    solution = minimise(objective, np.ones(2))
    assert solution.status is Status.STALLED
    never_nan(solution)


def test_a_gradient_that_turns_nan_on_the_way_is_no_convergence() -> None:
    form = quadratic_form(np.eye(2), np.zeros(2))
    objective = Dense(2, form._value, lambda x: x if x[0] > 0.9 else x * np.nan, lambda x: np.eye(2))
    solution = minimise(objective, np.ones(2))
    assert solution.status in (Status.STALLED, Status.INVALID)
    never_nan(solution)


def test_an_energy_without_a_minimum_reaches_the_limit_or_stalls() -> None:
    objective = Dense(2, lambda x: float(x[0]), lambda x: np.array([1.0, 0.0]), lambda x: np.zeros((2, 2)))
    solution = minimise(
        objective, np.zeros(2), NewtonOptions(max_iterations=30), bound=lambda x, p: min(1, 1 / abs(p).max())
    )
    assert solution.status is not Status.CONVERGED
    never_nan(solution)


def test_a_soft_valley_converges_below_the_noise_of_the_energy() -> None:
    """A large constant hides the last decreases; the gradient decides."""
    matrix, right = positive_definite(5), np.arange(5.0)
    form = quadratic_form(matrix, right)
    objective = Dense(5, lambda x: form._value(x) + 1e8, form._gradient, form._hessian)
    solution = minimise(objective, np.ones(5), NewtonOptions(tolerance=1e-10))
    assert solution.converged
    np.testing.assert_allclose(solution.x, np.linalg.solve(matrix, right), atol=1e-9)


def test_large_coordinates_do_not_make_feasible_points_infeasible() -> None:
    """Round-off of C x grows with x; the line search must not be switched off by it."""
    n, far = 4, 1e8
    constraints = LinearConstraints(np.array([[1.0, 2.0, 3.0, 0.5]]) / 3, np.array([6.5 * far / 3]))
    base = rosenbrock(n)
    objective = Dense(n, *(lambda x, f=f: f(x - far) for f in (base._value, base._gradient, base._hessian)))
    solution = minimise(objective, far + np.array([-1.2, 1.0, -1.2, 5.6]), linear=linear_solver(constraints))
    energies = [energy for energy, _ in solution.history]
    assert (np.diff(energies) < 1e-5).all(), "but for the round-off of x - far"


def test_the_shift_rule() -> None:
    rule = ShiftRule(start=1e-2, lowest=1e-6, highest=1.0, growth=5.0, least=1e-3, decay=0.2)
    assert rule.raised(0.0) == 1e-3
    assert rule.raised(1e-2) == pytest.approx(5e-2)
    assert rule.raised(0.9) == 1.0
    assert rule.decayed(1e-2) == pytest.approx(2e-3)
    assert rule.decayed(1e-2, 0.5) == pytest.approx(1e-3)
    assert rule.decayed(2e-6) == 1e-6
    assert ShiftRule(lowest=1e-6, lowest_is_zero=True).decayed(2e-6) == 0.0
    assert rule.decayed(rule.lowest) == rule.lowest


def test_the_highest_shift_ends_the_search() -> None:
    objective = Dense(2, lambda x: float(x @ x), lambda x: 2 * x, lambda x: -np.eye(2))
    solution = minimise(objective, np.ones(2), NewtonOptions(shift=ShiftRule(highest=0.5)))
    assert solution.status is Status.STALLED


def test_the_pattern_is_analysed_once() -> None:
    objective = rosenbrock(4)
    seen = []
    original = objective.quadratic

    def watched(x: np.ndarray) -> tuple[float, np.ndarray, Model]:
        seen.append(x.copy())
        return original(x)

    objective.quadratic = watched  # type: ignore[method-assign]
    solution = minimise(objective, np.zeros(4), NewtonOptions(tolerance=1e-9))
    assert solution.converged
    assert len(seen) == solution.iterations + 1


def test_the_start_is_not_changed() -> None:
    start = np.array([-1.2, 1.0])
    solution = minimise(rosenbrock(2), start, linear=linear_solver(None))
    assert solution.converged
    np.testing.assert_array_equal(start, [-1.2, 1.0])
