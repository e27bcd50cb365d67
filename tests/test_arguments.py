"""The public face in Python: wrong arguments, copies, representations, names."""

from __future__ import annotations

import copy
import inspect
import pickle
from collections.abc import Callable

import numpy as np
import pytest

import yarnscale as ys
from yarnscale.checked import WrongArgument, checked
from yarnscale.homogenize.published_fit import PublishedOptions
from yarnscale.shell.mesh import rectangle

PATTERN, YARN = ys.patterns.build("plain"), ys.YarnMaterial.preset("wool")
CELL = ys.PeriodicCell(PATTERN, YARN)
CLOTH = ys.OrthotropicMaterial(10.0, 1.0, 10.0, 1.0, bend_weft=1e-5, bend_warp=1e-5)


@pytest.mark.parametrize(
    ("call", "expected"),
    [
        (lambda: ys.PeriodicCell("plain", YARN), "argument pattern; expected YarnPattern"),
        (lambda: ys.PeriodicCell(PATTERN, "wool"), "yarn material; expected YarnMaterial"),
        (lambda: ys.PeriodicCell(PATTERN, CLOTH), "yarn material; expected YarnMaterial"),
        (lambda: ys.PeriodicCell(PATTERN, [YARN, 3]), "expected YarnMaterial"),
        (lambda: ys.PeriodicCell(PATTERN), "PeriodicCell: missing a required argument: 'material'"),
        (lambda: CELL.relax([0.1, 0, 0, 0, 0, 0]), "relax: argument strain; expected ShellStrain"),
        (
            lambda: CELL.relax(ys.ShellStrain(), start="rest"),
            "argument start; expected Start (an Equilibrium is one)",
        ),
        (lambda: CELL.moduli(ys.ShellStrain()), "argument state; expected Equilibrium"),
        (lambda: ys.ShellStrain("0.1"), "argument s_x; expected a number; found str '0.1'"),
        (lambda: ys.settled("plain", YARN), "argument pattern; expected YarnPattern"),
        (lambda: ys.scenes.stretch("file.json"), "argument material; expected ShellMaterial"),
        (lambda: ys.scenes.sweater(YARN), "argument material; expected ShellMaterial"),
        (lambda: ys.scenes.hang(CLOTH, spacing="1 cm"), "argument spacing; expected a number"),
        (lambda: ys.run("sweater"), "argument scene; expected SimulatedScene (scenes.stretch"),
        (lambda: ys.run(CLOTH), "argument scene; expected SimulatedScene"),
        (lambda: ys.Cloth("mesh.obj", CLOTH), "argument mesh; expected TriangleMesh"),
        (lambda: ys.fit("samples.zarr"), "argument store; expected SampleStore"),
        (lambda: ys.RodScene(CELL, None), "argument fabric; expected RodFabric"),  # type: ignore[arg-type]
        (lambda: ys.fit(CELL, options=PublishedOptions()), "argument store; expected SampleStore"),
        (lambda: ys.fit_shell("curves.csv"), "argument measurements; expected SwatchMeasurements"),
        (lambda: ys.sample(PATTERN, "store"), "argument cell; expected PeriodicCell"),
        (lambda: ys.homogenize_cell(PATTERN, "out"), "argument cell; expected PeriodicCell"),
        (lambda: ys.read_pattern(3), "argument source; expected a text or a path; found int 3"),
        (lambda: ys.read_material(YARN), "expected a text or a path; found YarnMaterial"),
        (lambda: ys.write_material(CLOTH, "cloth.json"), "argument path; expected a text or a path"),
        (lambda: ys.write_pattern("plain.pyp", PATTERN), "argument pattern; expected YarnPattern"),
        (lambda: ys.patterns.build(PATTERN), "argument name; expected a text"),
    ],
)
def test_wrong_arguments_fail_at_once_with_the_expected_type(call: Callable, expected: str) -> None:
    with pytest.raises(ys.InputError) as caught:
        call()
    assert expected in str(caught.value)
    assert isinstance(caught.value, TypeError)
    assert "\n" not in str(caught.value) and len(str(caught.value)) < 300


def test_charts_that_are_no_text() -> None:
    with pytest.raises(ys.InputError, match="chart is no text of stitches"):
        ys.knit(5)  # type: ignore[arg-type]


def test_numbers_of_numpy_and_paths_are_taken() -> None:
    @checked
    def area(width: float, count: int, name: str = "a", strain: ys.ShellStrain | None = None) -> float:
        return width * count

    assert area(np.float32(2.0), np.int64(3), name=np.str_("b")) == 6.0
    assert list(inspect.signature(area).parameters) == ["width", "count", "name", "strain"]
    with pytest.raises(WrongArgument, match=r"area: too many positional arguments; expected width, count"):
        area(1.0, 2, "a", None, 5)  # type: ignore[call-arg]
    with pytest.raises(WrongArgument, match=r"count; expected a whole number; found float 1\.5"):
        area(1.0, 1.5)  # type: ignore[arg-type]


@pytest.mark.parametrize("value", [PATTERN, YARN, CELL, CLOTH, ys.ShellStrain(0.1), rectangle(0.1, 0.1, 0.05)])
def test_copies_are_equal(value: object) -> None:
    for again in (pickle.loads(pickle.dumps(value)), copy.copy(value), copy.deepcopy(value)):
        assert repr(again) == repr(value)
    if value is CLOTH:
        strain = np.array([0.1, 0.0, 0.05, 0, 0, 0])
        assert pickle.loads(pickle.dumps(CLOTH)).energy_density(strain) == CLOTH.energy_density(strain)


def test_representations_are_one_short_line() -> None:
    scene = ys.scenes.hang(CLOTH, spacing=0.05)
    state = CELL.relax(ys.ShellStrain(s_x=0.05))
    for value in (PATTERN, YARN, CELL, CLOTH, scene, scene.cloth, scene.cloth.mesh, state):
        assert "\n" not in repr(value) and 20 < len(repr(value)) < 250
    assert "4 yarns" in repr(PATTERN) and "'wool'" in repr(YARN) and "converged at s_x=0.05" in repr(state)


def test_only_public_names_are_listed() -> None:
    assert dir(ys) == sorted(ys.__all__)
    for room in (ys.scenes, ys.patterns):
        assert dir(room) and all(name in room.__all__ and hasattr(room, name) for name in dir(room))
        assert not {"np", "math", "annotations"} & set(dir(room))
    assert {"stretch", "sweater", "hang"} <= set(dir(ys.scenes))
