"""Every built-in pattern has room, even edges and the entanglement that its chart implies."""

from __future__ import annotations

import numpy as np
import pytest

from yarnscale.drawing import library
from yarnscale.drawing.loop_paths import row_paths
from yarnscale.drawing.stitches import StitchChart
from yarnscale.errors import InputError
from yarnscale.yarn.clearance import closest_approach


@pytest.mark.parametrize("name", library.names())
def test_room_edges_and_bends(name: str) -> None:
    pattern = library.build(name)
    share = closest_approach(pattern).distance / (2 * pattern.radius)
    assert 0.85 < share < 1.1  # jersey's finely cut yarns are 1.094 apart
    edge = pattern.rest_length / pattern.radius
    assert edge.min() > 0.8
    assert edge.max() < 1.2
    tangent = pattern.edge_vectors() / np.linalg.norm(pattern.edge_vectors(), axis=1)[:, None]
    bend = np.degrees(np.arccos((tangent[pattern.previous_vertex] * tangent).sum(axis=1).clip(-1, 1)))
    assert bend.max() < 75.0
    assert pattern.name == name
    assert library.structure(name).definition.endswith(".")


@pytest.mark.parametrize("name", [n for n in library.names() if library.structure(n).chart])
def test_charts_of_the_library_can_be_drawn(name: str) -> None:
    chart = StitchChart.read(library.structure(name).chart)
    assert len(row_paths(chart)) == chart.courses


def test_cartridge_belt_rib_looks_the_same_from_behind() -> None:
    chart = StitchChart.read(library.structure("cartridge-belt-rib").chart)
    behind = {"k": "p", "p": "k", "b": "f", "f": "b"}
    turned = ["".join(behind[symbol] for symbol in row[::-1]) for row in chart.rows]
    moves = [[row[step:] + row[:step] for row in (turned[up:] + turned[:up])] for step in range(4) for up in range(2)]
    assert list(chart.rows) in moves


def test_small_variants_are_a_tenth() -> None:
    for name, large in (("stockinette-small", "stockinette"), ("satin-small", "satin-5")):
        assert np.allclose(10.0 * library.build(name).vertices, library.build(large).vertices)


def test_unknown_names_are_answered() -> None:
    with pytest.raises(InputError, match="unknown pattern; expected stockinette, "):
        library.structure("lace")
