"""One periodic cell of yarn under a macroscopic state."""

from yarnscale.cell.equilibrium import Equilibrium
from yarnscale.cell.periodic import PeriodicCell

__all__ = ["Equilibrium", "PeriodicCell"]
