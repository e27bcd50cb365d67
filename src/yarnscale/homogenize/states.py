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
    """Finished states: strains (n, 5), energies (n,) [J/m²], stresses (n, 5), converged (n,), moduli (n, 6, 6).

    Moduli are NaN where the store has none.
    """

    strains: Array
    energies: Array
    stresses: Array
    converged: NDArray[np.bool_]
    moduli: Array

    @classmethod
    def of(cls, store: SampleStore) -> SampledStates:
        """The states of a store that were solved."""
        status = store.status()
        solved = np.flatnonzero((status != 0) & (status != CODE_OF["excluded"]))
        energies = np.array([store.read(int(i), "energy_density") for i in solved]).reshape(-1)
        stresses = np.array([store.read(int(i), "stress") for i in solved]).reshape(-1, 6)[:, IN_STRESS]
        moduli = np.full((len(solved), 6, 6), np.nan)
        if store.has_moduli:
            moduli[:] = [store.read(int(i), "moduli") for i in solved]
        return cls(store.states[solved], energies, stresses, status[solved] == CODE_OF["converged"], moduli)

    def chosen(self, states: NDArray[np.bool_]) -> SampledStates:
        """Some of them, by a mask (n,)."""
        return SampledStates(
            self.strains[states],
            self.energies[states],
            self.stresses[states],
            self.converged[states],
            self.moduli[states],
        )
