"""A relaxed cell: how it is found, places of its yarns, energy, stress, and how the solve ended."""

from __future__ import annotations

from dataclasses import astuple, dataclass, field

import numpy as np

from yarnscale.arrays import Array
from yarnscale.cell.energy import CellEnergy
from yarnscale.errors import InputError
from yarnscale.kinematics import COMPONENTS, ShellStrain
from yarnscale.numerics.newton import Solution, Status, Watch
from yarnscale.numerics.regularisation import ShiftRule


@dataclass(frozen=True)
class EquilibriumOptions:
    """How equilibria of a cell are found.

    tolerance, max_iterations: of each solve. starts: how
    many starts compete for the lowest energy, the others being random perturbations of the first equilibrium, drawn
    with ``seed``. shift: regularisation at the beginning of each solve; small only where starts are very near. watch:
    called at every iteration of every solve with its number and the residual.
    """

    tolerance: float = 1e-6
    max_iterations: int = 400
    shift: float = ShiftRule.start
    starts: int = 1
    seed: int = 0
    watch: Watch | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        if self.starts < 1:
            raise InputError("number of starts", expected="at least 1", found=self.starts)


@dataclass(frozen=True, eq=False)
class Start:
    """What a solve starts from: the strain, fluctuation (n, 3) [m] and twist (n,) [rad] of a neighbouring state."""

    strain: ShellStrain
    fluctuation: Array
    twist: Array


@dataclass(frozen=True, eq=False)
class Equilibrium(Start):
    """A relaxed cell.

    positions: vertices of the primary tile (n, 3) [m]; a flat cell's copy in tile (a, b) is moved by S (a px, b py).
    twist: (n,) [rad]. fluctuation: co-rotated û (n, 3) [m]. energy_density: Ψ per reference area [J/m²].
    energy_parts: its terms [J/m²]. stress: ∂Ψ/∂(s_x, s_a, s_y) [J/m²], ∂Ψ/∂(II11, II12, II22) [J/m].
    residual: force norm over the summed norms of the terms. contacts: pairs of segments that touch.
    min_distance_over_diameter: closest approach of two yarns' centre lines; inf where nothing is near.
    passages: whether yarns passed through each other since the rest shape: a state of another fabric, not to be used.
    """

    positions: Array
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

    @classmethod
    def of(cls, energy: CellEnergy, solution: Solution, seconds: float, *, passages: bool) -> Equilibrium:
        """What a solve has found, in units."""
        pattern, x, gaps = energy.pattern, solution.x, energy.gaps(solution.x)
        fluctuation, twist = energy.split(x)
        return cls(
            strain=energy.strain,
            fluctuation=fluctuation * pattern.radius,
            twist=twist.copy(),
            positions=energy.positions(x),
            energy_density=solution.value * energy.unit / pattern.area,
            energy_parts=energy.parts(x),
            stress=energy.stress(x),
            status=solution.status,
            residual=solution.residual,
            iterations=solution.iterations,
            factorisations=solution.factorisations,
            seconds=seconds,
            contacts=int((gaps < 1.0).sum()),
            min_distance_over_diameter=float(gaps.min(initial=np.inf)),
            passages=passages,
        )

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
