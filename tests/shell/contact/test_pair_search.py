"""Search for near pairs, closest points and bounds of steps against brute force, and the same result every time."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from scipy.optimize import minimize

from yarnscale.motion.obstacles import MeshObstacle
from yarnscale.numerics.pair_distance import advance, closest_points
from yarnscale.shell.contact.broad_phase import Surfaces, near_pairs
from yarnscale.shell.contact.cloth_contact import ClothContact, ContactSettings
from yarnscale.shell.contact.pair_hessian import positive_terms
from yarnscale.shell.contact.pair_search import PairSearch
from yarnscale.shell.mesh import rectangle


def overlap(low: np.ndarray, high: np.ndarray, a: list[int], b: list[int]) -> bool:
    below = low[a].min(axis=0) <= high[b].max(axis=0)
    return bool((below & (low[b].min(axis=0) <= high[a].max(axis=0))).all())


@pytest.mark.parametrize("within_cloth", [True, False])
def test_every_pair_of_overlapping_boxes_is_found_once(within_cloth: bool) -> None:
    rng = np.random.default_rng(0)
    mesh = rectangle(1.0, 1.0, 0.2)
    cloth, count = len(mesh.triangles), mesh.vertex_count
    low = np.concatenate([mesh.assembled, mesh.assembled]) + 0.2 * rng.standard_normal((2 * count, 3))
    high = low + 0.1 * rng.random((2 * count, 3))
    triangles = np.concatenate([mesh.triangles, mesh.triangles + count])
    surfaces = Surfaces.of(triangles, cloth)
    corners, met = near_pairs(surfaces, low, high, within_cloth=within_cloth)

    def meant(a: list[int], b: list[int]) -> bool:
        bodies = (min(a) >= count) + (min(b) >= count)
        return not set(a) & set(b) and (bodies == 1 or (bodies == 0 and within_cloth))

    vertices = {
        (v, t)
        for v in range(2 * count)
        for t, face in enumerate(triangles.tolist())
        if meant([v], face) and overlap(low, high, [v], face)
    }
    edges = surfaces.edges.tolist()
    pairs = {
        frozenset((e, f))
        for e, f in itertools.combinations(range(len(edges)), 2)
        if meant(edges[e], edges[f]) and overlap(low, high, edges[e], edges[f])
    }
    assert len(vertices) > 500 and len(pairs) > 500
    assert len(corners) == len(vertices) and {(v, t) for v, t in corners.tolist()} == vertices
    assert len(met) == len(pairs) and {frozenset(pair) for pair in met.tolist()} == pairs


@pytest.mark.parametrize("is_corner", [True, False])
def test_closest_points_are_closest(is_corner: bool) -> None:
    rng = np.random.default_rng(1)
    kinds = set()
    for _ in range(60):
        x, c = rng.standard_normal((4, 3)), np.empty(4)
        square = closest_points(x, is_corner, c)
        assert square == pytest.approx(np.sum((c @ x) ** 2))
        kinds.add(int((c != 0.0).sum()))

        def away(w: np.ndarray, x: np.ndarray = x) -> float:
            if is_corner:
                weights = np.array([1.0, w[0] + w[1] - 1.0, -w[0], -w[1]])
            else:
                weights = np.array([1.0 - w[0], w[0], w[1] - 1.0, -w[1]])
            return float(np.sum((weights @ x) ** 2))

        sums = ({"type": "ineq", "fun": lambda w: 1.0 - w[0] - w[1]},) if is_corner else ()
        best = minimize(
            away, [0.3, 0.3], bounds=[(0, 1)] * 2, constraints=sums, method="SLSQP", options={"ftol": 1e-14}
        )
        assert square == pytest.approx(best.fun, rel=1e-5, abs=1e-9)
    assert kinds == {2, 3, 4}


def test_an_advance_ends_where_the_kept_distance_is_left() -> None:
    rng = np.random.default_rng(2)
    met = 0
    for is_corner, _ in itertools.product((True, False), range(200)):
        x, p = rng.standard_normal((4, 3)), 2.0 * rng.standard_normal((4, 3))
        c, y = np.empty(4), np.empty((4, 3))
        start = np.sqrt(closest_points(x, is_corner, c))
        fraction = advance(x, p, is_corner, 0.0, 0.1, 1.0, c, y)
        way = [np.sqrt(closest_points(x + s * p, is_corner, c)) for s in np.linspace(0.0, fraction, 200)]
        assert min(way) >= 0.1 * start * (1 - 1e-9)
        if fraction < 1.0:
            met += 1
            assert way[-1] < 0.12 * start
    assert met > 5


@pytest.mark.parametrize("is_corner", [True, False])
def test_the_positive_model_is_above_the_exact_hessian_and_touches_it(is_corner: bool) -> None:
    """E = b(d) with b' < 0 < b'': the model less the exact Hessian is positive, and no more than what was negative."""
    rng = np.random.default_rng(3)
    for _ in range(40):
        x = rng.standard_normal((4, 3))
        c, vectors, sizes = np.empty(4), np.empty((6, 4, 3)), np.empty(6)

        def slope(flat: np.ndarray) -> np.ndarray:
            place, weights = flat.reshape(4, 3), np.empty(4)
            d = np.sqrt(closest_points(place, is_corner, weights))
            return np.outer(weights, weights @ place).ravel() / d * -np.exp(-d)

        d = np.sqrt(closest_points(x, is_corner, c))
        count = positive_terms(x, c, is_corner, -np.exp(-d), np.exp(-d), 0.0, 0.0, vectors, sizes)
        flat = vectors[:count].reshape(count, 12)
        model = (flat.T * sizes[:count]) @ flat
        step = 1e-6
        exact = np.stack([(slope(x.ravel() + e) - slope(x.ravel() - e)) / (2 * step) for e in step * np.eye(12)])
        scale = np.abs(np.linalg.eigvalsh(exact)).max()
        assert np.linalg.eigvalsh(model - exact)[0] > -1e-5 * scale
        normal = c[:, None] * (c @ x) / d
        assert normal.ravel() @ model @ normal.ravel() >= np.exp(-d) * (c @ c) ** 2 * (1 - 1e-9)
        # Projected: tight along the positive directions of the exact geometric part.
        along = np.outer(normal, normal) * np.exp(-d)
        kept = np.linalg.eigh(exact - along)
        positive = (kept[1] * np.maximum(kept[0], 0.0)) @ kept[1].T
        np.testing.assert_allclose(model - along, positive, atol=1e-4 * scale)


def state() -> tuple[ClothContact, np.ndarray]:
    rng = np.random.default_rng(4)
    mesh = rectangle(0.04, 0.04, 0.004)
    body = rectangle(0.05, 0.05, 0.007)
    points = np.column_stack([body.panel, np.zeros(body.vertex_count)])
    contact = ClothContact(mesh, ContactSettings(friction=0.3), (MeshObstacle(points, body.triangles),))
    positions = np.column_stack([mesh.panel, np.full(mesh.vertex_count, 5e-4)])
    return contact, positions + 1e-4 * rng.standard_normal(positions.shape)


def test_self_contact_has_the_energy_and_forces_of_ipctk(monkeypatch: pytest.MonkeyPatch) -> None:
    """With its weights, a quarter of the areas of vertices and edges, for ours."""
    ipctk = pytest.importorskip("ipctk")

    def quarter_of_both(search: PairSearch, met: np.ndarray) -> np.ndarray:
        return 0.25 * search.edge_areas[met].sum(axis=1)

    monkeypatch.setattr(PairSearch, "_met", lambda search, over, around: over)
    monkeypatch.setattr(PairSearch, "_edge_areas", quarter_of_both)
    rng = np.random.default_rng(6)
    mesh, settings = rectangle(0.1, 0.04, 0.004), ContactSettings()
    angle = mesh.panel[:, 0] / 0.008
    radius = 0.008 + 6e-4 * angle / (2 * np.pi)
    positions = np.column_stack([radius * np.sin(angle), mesh.panel[:, 1], -radius * np.cos(angle)])
    positions = np.asfortranarray(positions + 2e-5 * rng.standard_normal(positions.shape))
    faces = np.asfortranarray(mesh.triangles.astype(np.int32))
    whole = ipctk.CollisionMesh(np.asfortranarray(mesh.assembled), ipctk.edges(faces), faces)
    pairs = ipctk.NormalCollisions()
    pairs.use_area_weighting = True
    pairs.build(whole, positions, settings.thickness)
    potential = ipctk.BarrierPotential(settings.thickness, settings.stiffness)
    value, gradient = ClothContact(mesh, settings).gradient(positions)
    assert value == pytest.approx(potential(pairs, whole, positions), rel=1e-9)
    expected = potential.gradient(pairs, whole, positions).reshape(-1, 3)
    np.testing.assert_allclose(gradient, expected, atol=1e-9 * np.abs(expected).max())
    assert np.abs(expected).max() > 1e-3


@pytest.mark.parametrize("spacing", [0.3, 0.05, 0.01, 0.003, 0.001, 0.0005])
@pytest.mark.parametrize("cloth", [0.01, 0.003])
def test_flat_bodies_press_as_told_however_fine_they_are(spacing: float, cloth: float) -> None:
    """At half the thickness above a flat body, askew: the pressure of the settings."""
    size = 0.1 if spacing > 0.02 else 0.04
    mesh = rectangle(size, size, cloth, irregularity=0.2)
    body = rectangle(max(1.5 * size, spacing), max(1.5 * size, spacing), spacing)
    settings, pressures = ContactSettings(self_contact=False), []
    for angle in (0.3, 0.7, 1.1):
        c, s = np.cos(angle), np.sin(angle)
        points = np.column_stack([body.panel @ np.array([[c, s], [-s, c]]), np.zeros(body.vertex_count)])
        contact = ClothContact(mesh, settings, (MeshObstacle(points, body.triangles),))
        raised = mesh.assembled + np.array([0.0, 0.0, 0.5 * settings.thickness])
        pressures.append(-contact.gradient(raised)[1][:, 2].sum() / mesh.areas.sum())
    assert np.mean(pressures) == pytest.approx(settings.pressure, rel=0.1)


def test_kept_searches_and_new_ones_give_the_same_energy_and_bound(monkeypatch: pytest.MonkeyPatch) -> None:
    """On a random walk of 3 mm, the kept search misses nothing that a new one finds."""
    contact, positions = state()
    searched, search = [], PairSearch._search
    monkeypatch.setattr(PairSearch, "_search", lambda own, *ends: searched.append(own) or search(own, *ends))
    rng, energies = np.random.default_rng(5), []
    drift = np.array([2e-4, 1e-4, 0.0])
    for _ in range(30):
        step = 5e-5 * rng.standard_normal(positions.shape) + drift
        fresh = state()[0]
        fraction = contact.bound(positions, step)
        assert fraction == fresh.bound(positions, step)
        positions = positions + fraction * step
        energies.append(contact.value(positions))
        assert energies[-1] == pytest.approx(state()[0].value(positions), rel=1e-12)
        assert not contact.intersects(positions)
    assert np.isfinite(energies).all() and min(energies) > 0
    assert 1 < sum(own is contact.parts[-1].search for own in searched) < 20


def test_contact_repeats_exactly(monkeypatch: pytest.MonkeyPatch) -> None:
    results = []
    for threads in ("1", "2", "2"):
        monkeypatch.setenv("YARNSCALE_THREADS", threads)
        contact, positions = state()
        contact.start_step(positions, 0.01)
        moved = positions + 1e-5
        results.append((*contact.gradient(moved), *contact.hessian(moved)))
    for again in results[1:]:
        for one, other in zip(results[0], again, strict=True):
            np.testing.assert_array_equal(one, other)
