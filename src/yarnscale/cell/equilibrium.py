"""A relaxed cell: places of its yarns, energy, stress, and how the solve ended."""

from __future__ import annotations

from dataclasses import astuple, dataclass

from yarnscale.arrays import Array
from yarnscale.kinematics import COMPONENTS, ShellStrain
from yarnscale.numerics.newton import Status


@dataclass(frozen=True, eq=False)
class Equilibrium:
    """A relaxed cell.

    positions: vertices of the primary tile (n, 3) [m]; a flat cell's copy in tile (a, b) is moved by S (a px, b py).
    twist: (n,) [rad]. fluctuation: co-rotated û (n, 3) [m]. energy_density: Ψ per reference area [J/m²].
    energy_parts: its terms [J/m²]. stress: ∂Ψ/∂(s_x, s_a, s_y) [J/m²], ∂Ψ/∂(II11, II12, II22) [J/m].
    residual: force norm over the summed norms of the terms. contacts: pairs of segments that touch.
    min_distance_over_diameter: closest approach of two yarns' centre lines; inf where nothing is near.
    passages: whether yarns passed through each other since the rest shape: a state of another fabric, not to be used.
    """

    strain: ShellStrain
    positions: Array
    twist: Array
    fluctuation: Array
    energy_density: float
    energy_parts: dict[str, float]
    stress: Array
    status: Status
    residual: float
    iterations: int
    factorisations: int
    seconds: float
    contacts: int
    min_distance_over_diameter: float
    passages: bool = False

    def __repr__(self) -> str:
        stress = ", ".join(f"{s:.4g}" for s in self.stress)
        state = ", ".join(f"{c}={v:.4g}" for c, v in zip(COMPONENTS, astuple(self.strain), strict=True) if v)
        found = f"{self.outcome} at {state or 'no strain'}: {self.energy_density:.4g} J/m²"
        return f"Equilibrium({found}, stress [{stress}])"

    @property
    def converged(self) -> bool:
        """Whether the cell is at rest, at a minimum."""
        return self.status is Status.CONVERGED

    @property
    def usable(self) -> bool:
        """Whether the cell is at rest and still the fabric that it was: without passages."""
        return self.converged and not self.passages

    @property
    def outcome(self) -> str:
        """``passages``, or the name of the status in lower case."""
        return "passages" if self.passages else self.status.name.lower()
