"""The contact energy of two segments: derivatives, symmetry, poles, reach and quadrature."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from yarnscale.numerics.energy import LinearTerms, StencilEnergy
from yarnscale.numerics.kernel import compile_kernel, run_columns
from yarnscale.yarn.contact import Sample, contact_energy, contact_samples
from yarnscale.yarn.material import ContactRule

KERNELS = ("hylc2020", "est2022")
LOWER = np.tril_indices(12)


def energy_of(kernel: str, rule: ContactRule | None = None) -> StencilEnergy:
    return contact_energy(kernel, contact_samples(rule or ContactRule(), polyline=True))


def parameters(kernel: str, count: int, reach: float = 2.0) -> np.ndarray:
    row = [3.0, 1 / reach**2] + ([200.0, 1 / (0.4 * reach) ** 2] if kernel == "est2022" else [])
    return np.tile(row, (count, 1))


def random_pairs(count: int, seed: int = 0) -> np.ndarray:
    """Segments of about unit length whose middles are 0.3 to 2.2 apart: all, some or no points in reach."""
    rng = np.random.default_rng(seed)
    first, second = rng.normal(size=(2, count, 3))
    first /= np.linalg.norm(first, axis=1)[:, None]
    second /= np.linalg.norm(second, axis=1)[:, None]
    apart = np.cross(first, second)
    apart *= (np.linspace(0.3, 2.2, count) / np.linalg.norm(apart, axis=1))[:, None]
    middle = 0.2 * rng.normal(size=(count, 3))
    ends = [-0.5 * first, 0.5 * first, apart + middle - 0.5 * second, apart + middle + 0.5 * second]
    return np.concatenate(ends, axis=1)


def values(energy: StencilEnergy, q: np.ndarray, p: np.ndarray) -> np.ndarray:
    return run_columns(energy.value, q, p)[0][:, 0]


def by_hand(kernel: str, q: np.ndarray, p: np.ndarray, samples: tuple[Sample, ...]) -> float:
    """The double sum, written out from the formulas with square roots and clips."""
    a0, a1, b0, b1 = q.reshape(4, 3)
    total = 0.0
    for s, v, near in samples:
        for t, w, reach in samples:
            distance = np.linalg.norm((1 - s) * a0 + s * a1 - (1 - t) * b0 - t * b1)
            for stiffness, inverse in p.reshape(-1, 2):
                d = distance * np.sqrt(inverse) / min(near, reach)
                if d >= 1:
                    continue
                f = 1 / d**2 + d**2 - 2 if kernel == "hylc2020" else -((d**2 - 1) ** 2) * np.log(d**2)
                total += v * w * stiffness * f
    return total


@pytest.mark.parametrize("kernel", KERNELS)
@pytest.mark.parametrize("rule", [ContactRule(), ContactRule(points=3, weights="simpson"), ContactRule(points=7)])
@pytest.mark.parametrize("polyline", [True, False])
def test_values_are_the_double_sum(kernel: str, rule: ContactRule, polyline: bool) -> None:
    q, p, samples = random_pairs(19), parameters(kernel, 19), contact_samples(rule, polyline=polyline)
    expected = [by_hand(kernel, *row, samples) for row in zip(q, p, strict=True)]
    found = values(contact_energy(kernel, samples), q, p)
    np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-14)


def test_few_places_hold_yarns_that_cross_as_the_published_five_do() -> None:
    """Wherever two straight yarns of edges 1.04 r cross at no distance, the barrier is as high as the published one."""
    rule, edges = ContactRule(), 1.04 * np.arange(-3, 5)
    lowest = []
    for polyline in (False, True):
        energy, found = contact_energy("hylc2020", contact_samples(rule, polyline=polyline)), []
        for place in 1.04 * np.linspace(0.0, 1.0, 9):
            ends = [np.zeros((64, 3)) for _ in range(4)]
            for pair, (a, b) in enumerate((a, b) for a in edges for b in edges):
                ends[0][pair, 0], ends[1][pair, 0] = a - place, a + 1.04 - place
                ends[2][pair, 1], ends[3][pair, 1] = b - place, b + 1.04 - place
                ends[2][pair, 2] = ends[3][pair, 2] = 1e-3
            found.append(values(energy, np.concatenate(ends, axis=1), parameters("hylc2020", 64)).sum())
        lowest.append(min(found))
    assert lowest[0] > 0.9 * lowest[1]


@pytest.mark.parametrize("kernel", KERNELS)
def test_gradient_and_hessian_against_differences(kernel: str) -> None:
    energy, count = energy_of(kernel), 41
    q, p = random_pairs(count), parameters(kernel, count)
    value, gradient, lower = run_columns(energy.hessian, q, p)
    np.testing.assert_allclose(value[:, 0], values(energy, q, p), rtol=1e-12)
    np.testing.assert_allclose(gradient, run_columns(energy.gradient, q, p)[1], rtol=1e-9, atol=1e-11)
    hessian = np.zeros((count, 12, 12))
    hessian[:, LOWER[0], LOWER[1]] = hessian[:, LOWER[1], LOWER[0]] = lower
    touching = value[:, 0] > 1e-8
    assert 10 < touching.sum() < count, "some touch and some do not"
    assert (np.abs(gradient[touching]).max(axis=1) > 0).all()
    assert (np.abs(hessian[touching]).max(axis=(1, 2)) > 0).all()
    step = 1e-6
    for k in range(12):
        move = step * np.eye(12)[k]
        slope = (values(energy, q + move, p) - values(energy, q - move, p)) / (2 * step)
        ahead, behind = (run_columns(energy.gradient, q + sign * move, p)[1] for sign in (1, -1))
        curve = (ahead - behind) / (2 * step)
        scale = np.abs(gradient).max(axis=1)
        np.testing.assert_array_less(np.abs(slope - gradient[:, k]), 1e-6 * scale + 1e-8)
        scale = np.abs(hessian).max(axis=(1, 2))
        # A point that enters the reach makes the second derivative of the published kernel jump.
        jump = 1e-5 if kernel == "est2022" else 1e-4
        np.testing.assert_array_less(np.abs(curve - hessian[:, k]).max(axis=1), jump * scale + 1e-4)


@pytest.mark.parametrize("kernel", KERNELS)
def test_nested_terms_are_the_plain_second_derivative(kernel: str) -> None:
    """``LinearTerms`` only changes how the Hessian is assembled, not what it is."""
    energy = energy_of(kernel)
    q, p, symbolic = energy._symbolic()

    def scalar(energy: ca.SX | LinearTerms, variables: ca.SX) -> ca.SX:
        if not isinstance(energy, LinearTerms):
            return energy
        return sum((scalar(inner(m @ variables), m @ variables) for m, inner in energy.terms), ca.SX(0))

    plain = ca.densify(ca.hessian(scalar(symbolic, q), q)[0])
    kernel_of_plain = compile_kernel(ca.Function("plain", [q, p], [ca.vec(plain)], {"cse": True}), "plain")
    rows, values_of = random_pairs(23, 3), parameters(kernel, 23)
    expected = run_columns(kernel_of_plain, rows, values_of)[0].reshape(-1, 12, 12)[:, LOWER[0], LOWER[1]]
    found = run_columns(energy.hessian, rows, values_of)[2]
    np.testing.assert_allclose(found, expected, rtol=1e-8, atol=1e-9 * np.abs(expected).max())


@pytest.mark.parametrize("kernel", KERNELS)
def test_parameter_derivatives_against_differences(kernel: str) -> None:
    energy = energy_of(kernel)
    names = tuple(energy.parameters)
    q, p = random_pairs(15, 4), parameters(kernel, 15)
    by_parameter, mixed = run_columns(energy.mixed(names), q, p)
    mixed = mixed.reshape(15, 12, len(names))
    for k in range(len(names)):
        move = 1e-6 * np.abs(p[0, k]) * np.eye(len(names))[k]
        slope = (values(energy, q, p + move) - values(energy, q, p - move)) / (2 * move[k])
        ahead, behind = (run_columns(energy.gradient, q, p + sign * move)[1] for sign in (1, -1))
        assert np.abs(slope).max() > 0
        np.testing.assert_allclose(by_parameter[:, k], slope, rtol=1e-6, atol=1e-6 * np.abs(slope).max())
        curve = (ahead - behind) / (2 * move[k])
        np.testing.assert_allclose(mixed[:, :, k], curve, rtol=1e-5, atol=1e-6 * np.abs(curve).max())


@pytest.mark.parametrize("kernel", KERNELS)
def test_rigid_motion_and_exchange_change_nothing(kernel: str) -> None:
    energy, count = energy_of(kernel), 17
    q, p = random_pairs(count, 1), parameters(kernel, count)
    turn = Rotation.random(random_state=0).as_matrix()
    moved = (q.reshape(count, 4, 3) @ turn.T + [3.0, -2.0, 1.0]).reshape(count, 12)
    reference = values(energy, q, p)
    np.testing.assert_allclose(values(energy, moved, p), reference, rtol=1e-11, atol=1e-13)
    for order in ([2, 3, 0, 1], [1, 0, 2, 3], [0, 1, 3, 2]):
        exchanged = q.reshape(count, 4, 3)[:, order].reshape(count, 12)
        np.testing.assert_allclose(values(energy, exchanged, p), reference, rtol=1e-11, atol=1e-13)
    force = run_columns(energy.gradient, q, p)[1].reshape(count, 4, 3)
    scale = np.abs(force).max()
    np.testing.assert_allclose(force.sum(axis=1), 0, atol=1e-12 * scale)
    torque = np.cross(q.reshape(count, 4, 3), force).sum(axis=1)
    np.testing.assert_allclose(torque, 0, atol=1e-12 * scale)


@pytest.mark.parametrize("kernel", KERNELS)
def test_infinite_where_two_points_meet_and_zero_beyond_reach(kernel: str) -> None:
    energy = energy_of(kernel)
    crossing = np.array([-0.5, 0, 0, 0.5, 0, 0, 0, -0.5, 0, 0, 0.5, 0])
    heights = np.array([0.0, 1e-160, 1e-3, 0.1, 1.0, 2.0, 2.0001, 50.0, 1e160])
    q = np.tile(crossing, (len(heights), 1))
    q[:, 8] = q[:, 11] = heights
    found = values(energy, q, parameters(kernel, len(heights)))
    assert found[0] == np.inf
    assert found[1] > found[2] > found[3] > found[4] > 0 == found[5]
    np.testing.assert_array_equal(found[5:], 0.0)
    value, gradient, lower = run_columns(energy.hessian, q[6:8], parameters(kernel, 2))
    assert not value.any() and not gradient.any() and not lower.any()


@pytest.mark.parametrize("kernel", KERNELS)
def test_energy_and_force_are_continuous_at_the_reach(kernel: str) -> None:
    energy = energy_of(kernel)
    parallel = np.array([0, 0, 0, 1e-9, 0, 0, 0, 0, 0, 1e-9, 0, 0])
    q = np.tile(parallel, (2, 1))
    q[:, 8] = q[:, 11] = [2.0 - 1e-6, 2.0 + 1e-6]
    value, gradient = run_columns(energy.gradient, q, parameters(kernel, 2))
    assert 0 <= value[0, 0] < 1e-10 and value[1, 0] == 0
    assert np.abs(gradient[0]).max() < 1e-4 and not gradient[1].any()


def test_quadrature_weights() -> None:
    for points in (3, 5, 9):
        simpson = ContactRule(points=points, weights="simpson")
        published = ContactRule(points=points, weights="published")
        assert sum(simpson.quadrature_weights) == pytest.approx(1)
        assert sum(published.quadrature_weights) == pytest.approx((points - 1) / points)
        assert simpson.quadrature_points[0] == 0 and simpson.quadrature_points[-1] == 1
        # Simpson's rule is exact for cubics.
        moments = [
            sum(w * s**k for s, w in zip(simpson.quadrature_points, simpson.quadrature_weights, strict=True))
            for k in range(4)
        ]
        np.testing.assert_allclose(moments, [1, 1 / 2, 1 / 3, 1 / 4], rtol=1e-13)


def test_published_weights_are_those_of_the_published_energies() -> None:
    """(1, 4, 2, 4, 1)/15: two touching points count 0.64 of a normalised rule."""
    np.testing.assert_allclose(ContactRule().quadrature_weights, np.array([1, 4, 2, 4, 1]) / 15)
    assert ContactRule().quadrature_points == (0, 0.25, 0.5, 0.75, 1)
    q = np.zeros((1, 12))
    q[0, [8, 11]] = 1.0  # two points at half the reach: f(1/2) = 4 + 1/4 − 2
    p = np.array([[3.0, 0.25]])
    assert values(energy_of("hylc2020"), q, p)[0] == pytest.approx(0.64 * 3.0 * 2.25)
