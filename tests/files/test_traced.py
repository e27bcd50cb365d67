"""Curves traced in a drawing program or a table."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from yarnscale.errors import InputError
from yarnscale.files.traced import read_traced

SVG = """<svg xmlns="http://www.w3.org/2000/svg" xmlns:inkscape="http://www.inkscape.org/namespaces/inkscape"
 width="40mm" height="20mm" viewBox="0 0 400 200">
<g inkscape:label="Front side"><g transform="translate(10 0)"><path d="M 0 0 L 100 0 c 10 0 20 10 20 20"/></g></g>
<g id="back"><polyline points="0,0 0,50 20,50"/></g>
<rect id="period" x="5" y="5" width="120" height="80"/></svg>"""


def test_paths_of_layers_in_metres(tmp_path: Path) -> None:
    path = tmp_path / "traced.svg"
    path.write_text(SVG)
    found = read_traced(path, None)
    assert found.period == pytest.approx([12e-3, 8e-3])
    (front,), (back,) = found.lines["front"], found.lines["back"]
    assert front[0] == pytest.approx([1e-3, 0.0]) and front[-1] == pytest.approx([13e-3, -2e-3])
    assert back[-1] == pytest.approx([2e-3, -5e-3])
    scaled = read_traced(path, 1e-3)
    assert scaled.period is not None and np.ptp(scaled.lines["back"][0][:, 1]) > 0.0


def test_the_period_among_other_rectangles_and_names(tmp_path: Path) -> None:
    path = tmp_path / "traced.svg"
    ground = '<g inkscape:label="Background"><rect width="400" height="200"/><path d="M 0 0 L 9 9"/></g>'
    path.write_text(SVG.replace('<g id="back">', ground + '<g id="back">'))
    found = read_traced(path, None)
    assert found.period == pytest.approx([12e-3, 8e-3]) and len(found.lines["back"]) == 1
    path.write_text(path.read_text().replace('id="period"', 'id="rect7"'))
    with pytest.raises(InputError, match="period of the drawing is not clear"):
        read_traced(path, None)
    path.write_text(SVG.replace('id="period"', 'id="rect7"'))
    assert read_traced(path, None).period == pytest.approx([12e-3, 8e-3])


def test_tables_and_faults(tmp_path: Path) -> None:
    path = tmp_path / "traced.csv"
    path.write_text("side,curve,x,y\nfront,a,0,0\nfront,a,1,0.5\nback,b,0,0\nback,b,2,0\n")
    found = read_traced(path, None)
    assert found.period is None and found.lines["front"][0] == pytest.approx(np.array([[0, 0], [1e-3, 5e-4]]))
    for text, fault in (
        ("x,y\n1,2\n", "traced.csv:1: header of the table"),
        ("side,curve,x,y\nfront,a,0,0\nfront,a,1,one\n", "traced.csv:3: x, y"),
        ("side,curve,x,y\nfront,a,0,0\nleft,a,1,1\n", "traced.csv:3: side"),
        ("side,curve,x,y\nfront,a,0,0\n", "curve 'a' of front has too few points"),
        ("side,curve,x,y\nfront,a,0,0\nfront,a,1,1\n", "back has no curve"),
        ("side,curve,x,y\nfront,a,0\n", "traced.csv:2: row of the table"),
    ):
        path.write_text(text)
        with pytest.raises(InputError, match=fault):
            read_traced(path, None)
    svg = tmp_path / "traced.svg"
    for text, fault in (
        ("<svg", "file is no SVG drawing"),
        (SVG.replace('width="40mm"', 'width="40"'), "size of the drawing is unknown"),
        (SVG.replace('id="back"', 'id="other"'), "back has no curve"),
        ('<!DOCTYPE svg [<!ENTITY a "b">]>' + SVG, "file has entities"),
    ):
        svg.write_text(text)
        with pytest.raises(InputError, match=fault):
            read_traced(svg, None)
    with pytest.raises(InputError, match="unknown file type"):
        read_traced(tmp_path / "traced.dxf", None)
