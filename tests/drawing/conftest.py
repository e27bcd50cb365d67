"""Fixtures for tests of yarn geometry."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from yarnscale.yarn.pattern import YarnPattern


def _crossing_words(pattern: YarnPattern) -> list[str]:
    """For each yarn, one letter per crossing in the order along the yarn: O(ver) or U(nder), seen from +z."""
    edge, start = pattern.edge_vectors(), pattern.vertices
    found: list[list[tuple[float, str]]] = [[] for _ in pattern.yarns]
    spread = np.ceil(np.ptp(start[:, :2], axis=0) / pattern.period).astype(int) + 1
    for a in range(-spread[0], spread[0] + 1):
        for b in range(-spread[1], spread[1] + 1):
            offset = np.array([a * pattern.period[0], b * pattern.period[1], 0.0])
            gap = (start + offset)[None, :, :] - start[:, None, :]
            d, e = edge[:, None, :], edge[None, :, :]
            with np.errstate(divide="ignore", invalid="ignore"):
                s = (gap[..., 0] * e[..., 1] - gap[..., 1] * e[..., 0]) / (
                    d[..., 0] * e[..., 1] - d[..., 1] * e[..., 0]
                )
                u = (gap[..., 0] * d[..., 1] - gap[..., 1] * d[..., 0]) / (
                    d[..., 0] * e[..., 1] - d[..., 1] * e[..., 0]
                )
            for i, k in np.argwhere((s >= 0) & (s < 1) & (u >= 0) & (u < 1)):
                rise = gap[i, k, 2] + u[i, k] * edge[k, 2] - s[i, k] * edge[i, 2]
                if i == k or (pattern.next_vertex[i] == k) or (pattern.next_vertex[k] == i):
                    continue
                place = float(pattern.position_along_yarn[i] + s[i, k])
                found[pattern.yarn_of_vertex[i]].append((place, "U" if rise > 0 else "O"))
    return ["".join(letter for _, letter in sorted(row)) for row in found]


def _same_cycle(word: str, other: str) -> bool:
    """Whether two words are the same up to where they begin."""
    return len(word) == len(other) and word in other + other


@pytest.fixture(scope="session")
def crossing_words() -> Callable[[YarnPattern], list[str]]:
    """Crossings of a pattern's yarns in the plan."""
    return _crossing_words


@pytest.fixture(scope="session")
def same_cycle() -> Callable[[str, str], bool]:
    """Compares words of closed yarns."""
    return _same_cycle
