"""Nested dissection: smallest separators, halves that do not meet, and factors that are the same with less fill."""

from __future__ import annotations

import itertools

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from yarnscale.numerics.block_pattern import BlockPattern
from yarnscale.numerics.dissection import Dissection, separator
from yarnscale.numerics.factor import Factorisation

Grid = tuple[np.ndarray, np.ndarray, np.ndarray]


def _grid(width: int, height: int) -> Grid:
    """Edges of a square grid, and where its nodes are, in a random order."""
    number = np.random.default_rng(3).permutation(width * height).reshape(height, width)
    first = np.concatenate([number[:, :-1].ravel(), number[:-1].ravel()])
    second = np.concatenate([number[:, 1:].ravel(), number[1:].ravel()])
    places = np.empty((width * height, 2))
    places[number.ravel()] = np.stack(np.meshgrid(np.arange(width), np.arange(height)), -1).reshape(-1, 2)
    return first, second, places


def test_a_separator_is_the_smallest_there_is() -> None:
    generator = np.random.default_rng(5)
    for _ in range(20):
        joined = generator.random((5, 6)) < 0.25
        whole = np.zeros((11, 11), np.int8)
        whole[:5, 5:] = joined
        found = separator(csr_array(whole + whole.T), np.arange(5), np.arange(5, 11))
        edges = [(a, 5 + b) for a, b in np.argwhere(joined)]
        sizes = (
            k
            for k in range(6)
            for chosen in itertools.combinations(range(11), k)
            if all(a in chosen or b in chosen for a, b in edges)
        )
        assert all(a in found or b in found for a, b in edges)
        assert len(found) == len(set(found.tolist())) == next(sizes)


def test_the_last_stage_parts_a_grid_into_halves() -> None:
    first, second, places = _grid(61, 20)
    stage = Dissection.of(first, second, places, leaf=50).stage
    last = stage == stage.max()
    assert last.sum() == 20  # straight across the narrow way
    kept = ~last[first] & ~last[second]
    graph = csr_array((np.ones(kept.sum()), (first[kept], second[kept])), shape=(len(places),) * 2)
    _, component = connected_components(graph, directed=False)
    sizes = np.sort(np.bincount(component[~last]))
    assert sizes.tolist() == [600, 600]
    # Below, too: what an earlier stage is joined with at its own or a later one, no part of another branch.
    assert np.bincount(stage).max() <= 50


def test_nodes_in_one_place_are_one_stage() -> None:
    first, second = np.triu_indices(30, 1)
    assert (Dissection.of(first, second, np.zeros((30, 2)), leaf=5).stage == 0).all()


def test_a_factor_of_a_dissected_matrix_solves_as_any_other() -> None:
    first, second, places = _grid(30, 25)
    sizes = np.full(len(places), 2)
    pairs = np.concatenate(
        [np.stack([2 * first + k, 2 * second + j], 1) for k in (0, 1) for j in (0, 1)]
        + [np.stack([2 * np.arange(len(places)), 2 * np.arange(len(places)) + 1], 1)]
    )
    plain = BlockPattern.of(sizes, [pairs])
    staged = plain.staged(Dissection.of(*plain.meetings(), places, leaf=20).stage)
    generator = np.random.default_rng(7)
    values = generator.standard_normal(plain.pattern.entries)
    values[plain.pattern.diagonal] += 40.0
    right = generator.standard_normal(plain.pattern.size)
    solutions = []
    for pattern in (plain.pattern, staged.pattern):
        factor = Factorisation(pattern)
        assert factor.factor(values)
        solutions.append(factor.solve(right))
        np.testing.assert_allclose(pattern.multiply(values, solutions[-1]), right, atol=1e-10)
        values[plain.pattern.diagonal[7]] -= 1e3
        assert not factor.factor(values)
        values[plain.pattern.diagonal[7]] += 1e3
    np.testing.assert_allclose(*solutions, atol=1e-11)


def test_new_edges_move_their_nodes_to_what_separates_both_ends() -> None:
    """No edge joins two branches, before and after; the numbers of stages stay."""
    first, second, places = _grid(40, 30)
    dissection = Dissection.of(first, second, places, leaf=40)
    generator = np.random.default_rng(0)
    more = [np.concatenate([ends, generator.integers(0, len(places), 15)]) for ends in (first, second)]
    repaired, moved = dissection.repaired(*more)
    assert 0 < moved <= 40
    assert dissection.repaired(first, second)[1] == 0
    for stage, (a, b) in ((dissection.stage, (first, second)), (repaired.stage, more)):
        for low, high in zip(np.minimum(stage[a], stage[b]), np.maximum(stage[a], stage[b]), strict=True):
            while low < high:
                low = dissection.parent[low]
            assert low == high
    assert (repaired.stage >= dissection.stage).all()
