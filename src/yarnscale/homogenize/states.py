"""Sampled states as plain arrays."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from yarnscale.arrays import Array, Flags
from yarnscale.homogenize.store import SampleStore
from yarnscale.homogenize.worker import CODE_OF, strain_of


@dataclass(frozen=True, eq=False)
class FabricStates:
    """Converged states of any store: strains (n, 6), energies (n,) [J/m²], stresses (n, 6), moduli (n, 6, 6).

    Components in the order of ``kinematics.COMPONENTS``. Moduli are NaN where the store has none, or where the cell is
    on the verge of buckling. kinds (n,): those of their rays (``homogenize.rays.Ray``), "strain" for a grid.
    density [kg/m²] and yarn radius [m] of the fabric.
    """

    strains: Array
    energies: Array
    stresses: Array
    moduli: Array
    kinds: NDArray[np.str_]
    density: float
    radius: float

    @classmethod
    def of(cls, store: SampleStore) -> FabricStates:
        """The converged states of a store, of a grid of strains or of rays of loads."""
        good = np.flatnonzero(store.status() == CODE_OF["converged"])
        if store.rays:
            strains = [store.read(int(i), "strain") for i in good]
            ray = np.array([entry["kind"] for entry in store.rays])
            kinds = ray[good // (store.shape[1] * store.shape[2])]
        else:
            strains = [strain_of(state).vector for state in store.states[good]]
            kinds = np.full(len(good), "strain")
        moduli = np.full((len(good), 6, 6), np.nan)
        if store.has_moduli and len(good):
            moduli[:] = [store.read(int(i), "moduli") for i in good]
        provenance = store.attributes["provenance"]
        return cls(
            np.array(strains).reshape(-1, 6),
            np.array([float(store.read(int(i), "energy_density")) for i in good]),
            np.array([store.read(int(i), "stress") for i in good]).reshape(-1, 6),
            moduli,
            kinds,
            float(provenance["area_density"]),
            float(provenance["radius"]),
        )

    def chosen(self, states: Flags) -> FabricStates:
        """Some of the states."""
        names = ("strains", "energies", "stresses", "moduli", "kinds")
        return replace(self, **{name: getattr(self, name)[states] for name in names})
