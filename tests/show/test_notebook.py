"""What notebooks show of the main objects."""

from __future__ import annotations

import pytest

import yarnscale as ys
from yarnscale.displayed import Displayed
from yarnscale.show.notebook import shown


def test_main_objects_show_a_picture_and_a_table() -> None:
    cell = ys.PeriodicCell(ys.patterns.build("plain"), ys.YarnMaterial.preset("wool"))
    cloth = ys.OrthotropicMaterial(10.0, 1.0, 10.0, 0.2, bend_weft=1e-5, bend_warp=1e-5)
    cases = (
        (cell, "area density [g/m²]</td><td>"),
        (cell.relax(ys.ShellStrain(s_x=0.1)), "<td>s_x; stress [N/m]</td><td>0.1; "),
        (cloth, "OrthotropicMaterial"),
        (ys.run(ys.scenes.hang(cloth, spacing=0.1)), "<td>status</td>"),
    )
    for thing, said in cases:
        text = thing._repr_html_()
        assert '<img src="data:image/' in text and said in text, text[-2000:]
    for kind in (ys.YarnPattern, ys.FabricEstimate, ys.CompactMaterial, ys.SplineMaterial):
        assert issubclass(kind, Displayed) and shown.dispatch(kind) is not shown.dispatch(object)
    with pytest.raises(TypeError, match="no picture of int"):
        shown(3)
