"""Every built-in pattern comes to rest, and stays entangled as it was drawn."""

from __future__ import annotations

import pytest

from yarnscale.cell import PeriodicCell
from yarnscale.drawing import library
from yarnscale.yarn.material import YarnMaterial


@pytest.mark.parametrize("name", library.names())
def test_rest(name: str) -> None:
    """The solver lets no yarn pass through another; a rest with room between the yarns is that of the drawn fabric."""
    material = YarnMaterial.preset(library.structure(name).material)
    state = PeriodicCell(library.build(name), material).relax()
    assert state.converged
    assert state.min_distance_over_diameter > 0.85
    assert state.contacts > 0
