"""Linear constraints of a cell on fluctuations û and twists θ (theory §2): no translation, twist or sliding."""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array

from yarnscale.arrays import Array
from yarnscale.numerics.null_space import Chain, ChainConstraints
from yarnscale.yarn.frames import unit
from yarnscale.yarn.pattern import YarnPattern


def independent(rows: Array) -> Array:
    """Orthonormal rows that span the given ones (parallel yarns that all slide are a translation)."""
    sizes, vectors = np.linalg.eigh(rows @ rows.T)
    kept = sizes > 1e-14 * sizes[-1]
    return (vectors[:, kept] / np.sqrt(sizes[kept])).T @ rows


def vertex_tangents(pattern: YarnPattern) -> Array:
    """Mean direction of the yarn at each vertex at rest (n, 3)."""
    edge = unit(pattern.edge_vectors())
    return unit(edge + edge[pattern.previous_vertex])


def _translations_and_chains(pattern: YarnPattern, sliding: bool) -> tuple[Array, list[Chain]]:
    """Constraints on [û, θ], weighted by rest lengths [r]: rows of HYLC20 eq. 18 (3, 4n), and chains along the yarns.

    Each yarn's chains are its twist (eq. 27) and, unless ``sliding``, its motion along itself (EST22 §7.1). That is
    along the rest shape, not the deformed one: a constraint that moved with the macroscopic state would do work, and
    stress would no longer be ∂Ψ/∂z at fixed û.
    """
    n = len(pattern.edges)
    weight, length = pattern.voronoi_length / pattern.radius, pattern.rest_length / pattern.radius
    moves = weight[:, None] * vertex_tangents(pattern)
    translations = np.zeros((3, 4 * n))
    for axis in range(3):
        translations[axis, axis : 3 * n : 3] = weight
    chains = []
    for yarn in pattern.yarns:
        chains.append(Chain(n + yarn, length[yarn, None]))
        if not sliding:
            chains.append(Chain(yarn, moves[yarn]))
    return translations, chains


def constraint_rows(pattern: YarnPattern, sliding: bool) -> csr_array:
    """The constraints as rows on [û, θ] (m, 4n): three of translation, then of each yarn its twist and sliding."""
    n = len(pattern.edges)
    translations, chains = _translations_and_chains(pattern, sliding)
    columns = [
        3 * c.groups[:, None] + np.arange(3) if c.coefficients.shape[1] == 3 else 2 * n + c.groups for c in chains
    ]
    entries = np.concatenate([translations.ravel(), *(chain.coefficients.ravel() for chain in chains)])
    places = np.concatenate([np.tile(np.arange(4 * n), 3), *(c.ravel() for c in columns)])
    starts = np.concatenate([4 * n * np.arange(4), 12 * n + np.cumsum([c.size for c in columns])])
    return csr_array((entries, places, starts), shape=(3 + len(chains), 4 * n))


def constraint_chains(pattern: YarnPattern, sliding: bool) -> ChainConstraints:
    """The same constraints with each yarn as a chain of its own vertices."""
    n = len(pattern.edges)
    translations, chains = _translations_and_chains(pattern, sliding)
    return ChainConstraints(np.repeat([3, 1], n), chains, translations)
