"""What a file of a structure says (a chart, a weaving draft, a machine file), before it is drawn."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from yarnscale.drawing.library import Structure
from yarnscale.drawing.proportions import check_proportions
from yarnscale.drawing.stitches import StitchChart
from yarnscale.errors import InputError, located
from yarnscale.yarn.pattern import YarnPattern


@dataclass(frozen=True, eq=False)
class StructureFile:
    """A structure as a file has it; ``place`` finds the file and line of a fault of the structure."""

    path: Path
    structure: Structure
    place: Callable[[InputError], object]

    def pattern(self) -> YarnPattern:
        """The pattern drawn; InputError with file and line for what cannot be knitted or woven."""
        with located(self.place):
            pattern = self.structure.build()
        check_proportions(pattern, where=self.path)
        return pattern

    def stitches(self) -> StitchChart | None:
        """The stitches of a knit, None of a weave; InputError as ``pattern``."""
        if self.structure.woven:
            return None
        with located(self.place):
            return StitchChart.read(self.structure.chart)
