"""What a file of a structure says (a chart, a weaving draft, a machine file), before it is drawn."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from yarnscale.drawing.library import Structure
from yarnscale.drawing.proportions import check_proportions
from yarnscale.drawing.stitches import StitchChart
from yarnscale.errors import InputError
from yarnscale.yarn.pattern import YarnPattern


@contextmanager
def placed(place: Callable[[InputError], object]) -> Iterator[None]:
    """Faults that name no place get that which ``place`` finds for them."""
    try:
        yield
    except InputError as error:
        if error.where is not None:
            raise
        raise error.at(place(error)) from None


@dataclass(frozen=True, eq=False)
class StructureFile:
    """A structure as a file has it; ``place`` finds the file and line of a fault of the structure."""

    path: Path
    structure: Structure
    place: Callable[[InputError], object]

    def pattern(self) -> YarnPattern:
        """The pattern drawn; InputError with file and line for what cannot be knitted or woven."""
        with placed(self.place):
            pattern = self.structure.build()
        check_proportions(pattern, where=self.path)
        return pattern

    def stitches(self) -> StitchChart | None:
        """The stitches of a knit, None of a weave; InputError as ``pattern``."""
        if self.structure.woven:
            return None
        with placed(self.place):
            return StitchChart.read(self.structure.chart)
