"""Sampled states as plain arrays."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from yarnscale.homogenize.observations import IN_STRESS
from yarnscale.homogenize.store import SampleStore
from yarnscale.homogenize.worker import CODE_OF

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class SampledStates:
    """Finished states: strains (n, 5), energies (n,) [J/m²], stresses (n, 5), converged (n,)."""

    strains: Array
    energies: Array
    stresses: Array
    converged: NDArray[np.bool_]

    @classmethod
    def of(cls, store: SampleStore) -> SampledStates:
        """The states of a store that were solved."""
        status = store.status()
        solved = np.flatnonzero((status != 0) & (status != CODE_OF["excluded"]))
        energies = np.array([store.read(int(i), "energy_density") for i in solved]).reshape(-1)
        stresses = np.array([store.read(int(i), "stress") for i in solved]).reshape(-1, 6)[:, IN_STRESS]
        return cls(store.states[solved], energies, stresses, status[solved] == CODE_OF["converged"])

    def chosen(self, states: NDArray[np.bool_]) -> SampledStates:
        """Some of them, by a mask (n,)."""
        return SampledStates(
            self.strains[states], self.energies[states], self.stresses[states], self.converged[states]
        )
