"""Samples of a cell for a shell material: along rays of loads, others unseen by a fit, and where a simulation went."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import KDTree

from yarnscale.arrays import Array
from yarnscale.cell.periodic import PeriodicCell
from yarnscale.errors import InputError
from yarnscale.homogeneous.fabrics import CellFabric
from yarnscale.homogeneous.loads import Loads
from yarnscale.homogenize.rays import FEWEST, SOLVES, VISITED, Ray, load_rays, strains_held
from yarnscale.homogenize.sample import SampleSummary, SamplingProgress, create_ray_store, resumed_ray_store, sample
from yarnscale.homogenize.states import FabricStates
from yarnscale.homogenize.store import RAY_DIMS, SampleStore
from yarnscale.homogenize.worker import CODE_OF

UNSEEN_SHARE, UNSEEN_SEED = 0.1, 1
"""States that judge a fit, as a share of the solves for it, and the seed of their rays."""
NEAR = 0.1
"""Distance in scaled strains below which a visited state counts as sampled."""
MOST_VISITED = 60
"""Most states that one simulation adds."""
_CANDIDATES = 20_000


@dataclass(frozen=True, eq=False)
class LoadSamples:
    """States to fit, states that judge the fit, the store of the former, and what the solves of both cost."""

    samples: FabricStates
    unseen: FabricStates
    store: SampleStore
    runs: tuple[SampleSummary, SampleSummary]

    @property
    def summary(self) -> SampleSummary:
        """Of all solves."""
        return self.runs[0].joined(self.runs[1])

    def extended(self, cell: PeriodicCell, strains: Array, kind: str, most: int, **options: Any) -> LoadSamples:
        """With solves at those of ``strains`` (n, 6) that are far from all samples; options as ``sample``."""
        rays = visiting_rays(self.store, strains, CellFabric(cell).strain_scale, kind, most)
        store = self.store.extended([ray.plain() for ray in rays])
        run = self.runs[0].joined(sample(cell, store, **options), same_store=True)
        return replace(self, samples=FabricStates.of(store), store=store, runs=(run, self.runs[1]))


def sample_loads(
    cell: PeriodicCell,
    folder: Path,
    *,
    solves: int = SOLVES,
    limit: float | None = None,
    visited: Array | None = None,
    workers: int = 2,
    dask: str | None = None,
    resume: bool = False,
    progress: Callable[[SamplingProgress], None] | None = None,
) -> LoadSamples:
    """About ``solves`` states along rays of loads up to ``limit`` [N/m], and a tenth more that no fit sees.

    folder: for the stores ``samples`` and ``unseen``. resume: continue those that are there. visited: strains (n, 6)
    of a simulation; those far from all samples are solved too. Raises InputError for the stores of another run.
    """
    plans = {
        "samples": load_rays(cell, solves=solves, limit=limit),
        "unseen": load_rays(
            cell, solves=max(FEWEST, round(UNSEEN_SHARE * solves)), limit=limit, seed=UNSEEN_SEED, fixed=False
        ),
    }
    stores, runs = {}, {}
    for name, rays in plans.items():
        stores[name] = _opened(folder / name, cell, rays, resume=resume)
        runs[name] = sample(cell, stores[name], workers=workers, dask=dask, progress=progress)
    states = {name: FabricStates.of(store) for name, store in stores.items()}
    found = LoadSamples(**states, store=stores["samples"], runs=tuple(runs.values()))
    if visited is None:
        return found
    return found.extended(cell, visited, VISITED, MOST_VISITED, workers=workers, dask=dask, progress=progress)


def _opened(path: Path, cell: PeriodicCell, rays: list[Ray], *, resume: bool) -> SampleStore:
    if resume:
        SampleStore.recover(path)
    if not (resume and path.exists()):
        return create_ray_store(path, cell, rays)
    return resumed_ray_store(SampleStore(path), cell, rays)


def visiting_rays(
    store: SampleStore, strains: Array, scale: Array, kind: str = VISITED, most: int = MOST_VISITED
) -> list[Ray]:
    """Rays from the nearest sampled states to those of ``strains`` (n, 6) that are farthest from all samples.

    At most ``most``, one after the other the farthest from the samples and those chosen before, none nearer than
    ``NEAR`` in strains over ``scale`` (6,). Raises InputError for a store without loads, or without samples.
    """
    if store.dims != RAY_DIMS:
        raise InputError("samples without loads", where=store.path, expected="a store that 'homogenize' made anew")
    good = np.flatnonzero(store.status() == CODE_OF["converged"])
    if not len(good):
        raise InputError("no converged state to start from", where=store.path, expected="a finished sampling run")
    known = np.array([store.read(int(i), "strain") for i in good]) / scale
    strains = strains[np.isfinite(strains).all(axis=1)]
    if len(strains) > _CANDIDATES:
        strains = strains[np.random.default_rng(0).choice(len(strains), _CANDIDATES, replace=False)]
    places = strains / scale
    distance, nearest = (np.asarray(found) for found in KDTree(known).query(places))
    rays: list[Ray] = []
    while len(rays) < most and len(places) and distance.max() > NEAR:
        farthest = int(np.argmax(distance))
        levels = max(1, int(np.ceil(np.abs(places[farthest] - known[nearest[farthest]]).max())))
        target = (Loads(), strains_held(strains[farthest]))
        rays.append(Ray(kind, (target,) * min(levels, store.shape[1]), int(good[nearest[farthest]])))
        distance = np.minimum(distance, np.linalg.norm(places - places[farthest], axis=1))
    return rays
