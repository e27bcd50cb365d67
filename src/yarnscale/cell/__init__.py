"""One periodic cell of yarn under a macroscopic state."""

from yarnscale.cell.periodic import Equilibrium, PeriodicCell

__all__ = ["Equilibrium", "PeriodicCell"]
