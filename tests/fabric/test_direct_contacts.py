"""Which pairs of segments are listed, have a place in the matrix, and may meet on their way."""

from __future__ import annotations

import numpy as np

from yarnscale.fabric.direct_energy import FabricEnergy
from yarnscale.fabric.sheet import YarnSheet
from yarnscale.yarn.close_pairs import close_pairs, pair_gaps
from yarnscale.yarn.material import YarnMaterial

SOLID = YarnMaterial(5e5, 2e5, 1.0, 60.0, 120.0)
RADIUS = 1e-3


def _tangle(seed: int, lines: int = 12) -> YarnSheet:
    """Wavy yarns through a small box."""
    random = np.random.default_rng(seed)
    steps = np.cumsum(random.normal(scale=0.8 * RADIUS, size=(lines, 15, 3)), axis=1)
    return YarnSheet.from_lines(list(steps + 6.0 * RADIUS * random.random((lines, 1, 3))), RADIUS)


def test_pairs_that_may_meet_are_those_that_every_pair_tells() -> None:
    """Against all pairs of segments: none is missed that moves towards another by more than its distance."""
    sheet, random = _tangle(0), np.random.default_rng(1)
    positions, ends = sheet.vertices / RADIUS, sheet.following
    moves = random.normal(scale=1.0, size=positions.shape)
    segments = sheet.edges
    first, second = (index.ravel() for index in np.meshgrid(segments, segments, indexing="ij"))
    yarn = sheet.yarn_of_vertex
    kept = (first < second) & ((yarn[first] != yarn[second]) | (second - first > 3))
    first, second = first[kept], second[kept]
    gaps = pair_gaps(positions, ends, first, second)
    largest = np.max(
        [np.linalg.norm(moves[a] - moves[b], axis=1) for a in (first, ends[first]) for b in (second, ends[second])],
        axis=0,
    )  # fmt: skip
    must = set(zip(first[gaps < largest].tolist(), second[gaps < largest].tolist(), strict=True))
    found = close_pairs(sheet.strands, positions, 0.0, neighbours=3, moves=moves)
    listed = set(zip(found[0].tolist(), found[1].tolist(), strict=True))
    assert must and must <= listed
    assert len(listed) < 0.5 * len(first)
    still = close_pairs(sheet.strands, positions, 2.0, neighbours=3)
    common = close_pairs(sheet.strands, positions, 2.0, neighbours=3, moves=np.full_like(positions, 5.0))
    expected = set(zip(first[gaps < 2.0].tolist(), second[gaps < 2.0].tolist(), strict=True))
    for pairs in (still, common):
        assert set(zip(pairs[0].tolist(), pairs[1].tolist(), strict=True)) == expected


def test_a_hessian_has_the_pairs_that_come_to_touch() -> None:
    """The matrix after yarns have moved is that of an energy which sees them there for the first time."""
    sheet, random = _tangle(2), np.random.default_rng(3)
    energy = FabricEnergy(sheet, SOLID)
    x = energy.start()
    vector = random.standard_normal(len(x))
    patterns = []
    for _ in range(4):
        x[: 3 * energy.count] += random.normal(scale=0.15, size=3 * energy.count)
        value, forces, block, entries = energy.hessian(x)
        fresh = FabricEnergy(sheet, SOLID)
        other = fresh.hessian(x)
        np.testing.assert_allclose(value, other[0], rtol=1e-12)
        gradient = forces.sum(axis=0)
        np.testing.assert_allclose(gradient, other[1].sum(axis=0), atol=1e-10 * np.abs(gradient).max())
        product, expected = (
            block.pattern.multiply(entries, vector),
            other[2].pattern.multiply(other[3], vector),
        )
        np.testing.assert_allclose(product, expected, atol=1e-10 * np.abs(expected).max())
        patterns.append(block)
        # Ties are there where pairs are, and resist no common motion.
        common = np.concatenate([np.tile([1.0, 2.0, 3.0], energy.count), np.zeros(energy.count)])
        ties = energy.ties(x)
        np.testing.assert_allclose(block.pattern.multiply(ties, common), 0.0, atol=1e-9 * ties.max())
    assert any(one is not patterns[0] for one in patterns[1:])  # new pairs asked for room


def test_a_step_stops_before_yarns_meet_however_long_it_is() -> None:
    sheet = _tangle(4)
    energy, random = FabricEnergy(sheet, SOLID), np.random.default_rng(5)
    x = energy.start()
    for size in (0.1, 1.0, 30.0):
        step = np.concatenate([random.normal(scale=size, size=3 * energy.count), np.zeros(energy.count)])
        positions, fraction = energy.positions(x), energy.bound(x, step)
        pairs = close_pairs(sheet.strands, positions, 12.0, neighbours=3)
        before = pair_gaps(positions, sheet.following, *pairs)
        for share in np.linspace(0.1, 1.0, 10):
            after = pair_gaps(energy.positions(x + share * fraction * step), sheet.following, *pairs)
            assert (after >= 0.2 * before - 1e-12).all()
        assert 0.0 < fraction <= 1.0
