"""Fit a compact energy to energies, stresses and moduli of sampled states.

Strains are in units, so that all stresses are energies by a strain of the size of the fabric's. A start is chosen among
many springs by their stiffnesses (``compact_start``), then all numbers are refined together (``compact_problem``).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import KDTree

from yarnscale.arrays import Array
from yarnscale.homogenize.compact_problem import (
    STAGES,
    STRESS_FLOOR,
    CompactOptions,
    Problem,
    Samples,
    StressErrors,
)
from yarnscale.homogenize.compact_start import start_of
from yarnscale.homogenize.spring_jacobian import unknowns_of
from yarnscale.kinematics import strain_units
from yarnscale.numerics.threads import on_one_thread
from yarnscale.shell.materials.compact import MIRROR, CompactMaterial, SpringNetwork

__all__ = ["CompactOptions", "StressErrors", "fit_compact_material"]

_COVERING = 200
"""States, at most, that stand for all samples."""
_NO_COUPLING = 0.05
"""Median coupling of shear or twist with another strain, over the geometric mean of their moduli, that is still none:
knits have 0.012 at most, twills 0.11 and more."""


@on_one_thread
def fit_compact_material(
    strains: ArrayLike,
    energies: ArrayLike,
    stresses: ArrayLike,
    moduli: ArrayLike | None = None,
    *,
    kinds: ArrayLike | None = None,
    density: float,
    radius: float,
    options: CompactOptions | None = None,
    start: CompactMaterial | None = None,
    provenance: Mapping[str, object] | None = None,
) -> CompactMaterial:
    """Compact material of sampled states.

    strains (n, 6) [-, 1/m] in the order of ``kinematics.COMPONENTS``; energies (n,) [J/m²]; stresses (n, 6) [N/m,
    N]; moduli (n, 6, 6), NaN where unknown; kinds (n,) of their rays (``rays.Ray``); density [kg/m²]; radius of the
    yarn [m]. The undeformed state should be among them. start: an earlier fit with the same options, to be
    refined at the last floor. Raises InputError on arrays that do not match, or fewer than 10 states.
    """
    options, scale = options or CompactOptions(), strain_units(radius)
    data = Samples.of(strains, energies, stresses, moduli, kinds, scale)
    known = options.symmetric if start is None else start.mirrored
    mirrored = _is_symmetric(data) if known is None else known
    problem = Problem(data, mirrored, options)
    first, done = _raced(problem) if start is None else (unknowns_of(*_working(start)), [])
    final, last = problem.search(first, options.iterations, STAGES[-1:])
    springs, constant = problem.network(final)
    samples, spacing = _representative(data.x, mirrored)
    record = {
        "states": len(data.energies),
        "options": asdict(options),
        "iterations": [*done, *last],
        "errors": problem.errors(final)._asdict(),
    }
    return CompactMaterial(
        constant, scale, _walled(_filled(springs, options.springs), data, mirrored), density=density,
        mirrored=mirrored, samples=samples * scale, spacing=spacing,
        provenance={**(provenance or {}), "fit": record},
    )  # fmt: skip


def _raced(problem: Problem) -> tuple[Array, list[int]]:
    """The best of some starts after all stages but the last, and the steps it took: a fifth of the starts end badly."""
    found = []
    options = problem.options
    for seed in range(options.starts * options.seed, options.starts * (options.seed + 1)):
        start = start_of(problem, np.random.default_rng(seed))
        found.append(problem.search(start, options.iterations, STAGES[:-1]))
    return min(found, key=lambda entry: problem.loss(entry[0]))


def _is_symmetric(data: Samples) -> bool:
    """Whether the fabric looks like its own mirror image.

    The stresses of s_a and II12 vanish then where these strains do, and their moduli are not coupled to the other
    strains: a twill shears as it bends, which its tension hides. Half of the states near there decide: single ones
    may have buckled to one side.
    """
    odd = MIRROR < 0
    known = np.asarray(np.isfinite(data.moduli).all(axis=(1, 2)))
    away = np.abs(data.x[:, odd]).max(axis=1)
    near = np.asarray(away < np.where(known, 0.03, 1e-9))
    if not near.any():
        return True
    if (near & known).any():
        moduli = data.moduli[near & known]
        sizes = np.sqrt(np.abs(np.einsum("nii->ni", moduli)))
        coupled = moduli / (sizes[:, :, None] * sizes[:, None, :] + 1e-300)
        if np.abs(np.median(coupled[:, ~odd][:, :, odd], axis=0)).max() > _NO_COUPLING:
            return False
    moduli = np.where(known[near, None, None], data.moduli[near], 0.0)[:, odd][:, :, odd]
    back = np.einsum("nij,nj->ni", moduli, data.x[near][:, odd])
    stresses = data.stresses[near]
    left = np.linalg.norm(stresses[:, odd] - back, axis=1)
    return bool(np.median(left / (np.linalg.norm(stresses, axis=1) + STRESS_FLOOR)) < 0.05)


def _representative(x: Array, mirrored: bool) -> tuple[Array, float]:
    """States that cover all samples, and how far from the nearest one a state may lie.

    Each next one is the sample farthest from those before.
    """
    images = [x, x * MIRROR] if mirrored else [x]
    chosen, distance = [0], np.full(len(x), np.inf)
    while len(chosen) < min(_COVERING, len(x)):
        for image in images:
            distance = np.minimum(distance, np.linalg.norm(x - image[chosen[-1]], axis=1))
        chosen.append(int(np.argmax(distance)))
    nearest = KDTree(x).query(x, k=2)[0][:, 1]
    return x[chosen], float(max(distance.max(), np.percentile(nearest, 95)))


def _filled(springs: SpringNetwork, count: int) -> SpringNetwork:
    """The network with springs of no stiffness up to a number, so that all materials share their compiled kernels."""
    none = SpringNetwork(*(np.zeros((count, *part.shape[1:])) for part in springs))
    own = ("springs", "bends", "spring_offsets", "stiffnesses")
    return springs._replace(**{n: np.concatenate([getattr(springs, n), getattr(none, n)])[:count] for n in own})


def _working(material: CompactMaterial) -> tuple[SpringNetwork, float]:
    """The network without springs of no stiffness, and its constant."""
    springs, some = material.springs, material.springs.stiffnesses > 0
    own = ("springs", "bends", "spring_offsets", "stiffnesses")
    return springs._replace(**{name: getattr(springs, name)[some] for name in own}), material.constant


def _walled(springs: SpringNetwork, data: Samples, mirrored: bool) -> SpringNetwork:
    """The network with walls around all samples: outside, no state is softer than at the border.

    Walls stand along both directions of every strain, where the samples end.
    """
    x = np.concatenate([data.x, data.x * MIRROR]) if mirrored else data.x
    directions = np.concatenate([np.eye(6), -np.eye(6)])
    offsets = (x @ directions.T).max(axis=0)
    size = np.median(np.abs(np.linalg.norm(data.stresses, axis=1)))
    return springs._replace(
        walls=directions, wall_offsets=offsets, wall_stiffnesses=np.full(len(directions), max(size, 1.0))
    )
