"""What notebooks show of the main objects."""

from __future__ import annotations

import sys
from collections.abc import Callable
from importlib import import_module
from types import SimpleNamespace

import pytest

import yarnscale as ys
from yarnscale.show.notebook import html_of, shown


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
        text = html_of(thing)
        assert '<img src="data:image/' in text and said in text, text[-2000:]
    for kind in (ys.YarnPattern, ys.FabricEstimate, ys.CompactMaterial, ys.SplineMaterial):
        assert shown.dispatch(kind) is not shown.dispatch(object)
    with pytest.raises(TypeError, match="no picture of int"):
        shown(3)


def test_a_running_notebook_is_told_how(monkeypatch: pytest.MonkeyPatch) -> None:
    """IPython looks classes up by module and name, and then by their base classes."""
    told: dict[tuple[str, str], Callable[[object], str]] = {}
    pages = SimpleNamespace(for_type_by_name=lambda module, name, draw: told.__setitem__((module, name), draw))
    shell = SimpleNamespace(display_formatter=SimpleNamespace(formatters={"text/html": pages}))
    monkeypatch.setitem(sys.modules, "IPython", SimpleNamespace(get_ipython=lambda: shell))  # type: ignore[arg-type]
    ys._show_in_notebooks()
    pattern = ys.patterns.build("plain")
    assert "<td>plain</td>" in told[type(pattern).__module__, type(pattern).__qualname__](pattern)
    for module, name in told:
        kind = getattr(import_module(module), name)
        assert shown.dispatch(kind) is not shown.dispatch(object)
