"""Diagrams are written for samples with and without failures."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from matplotlib.image import imread

from yarnscale.errors import InputError
from yarnscale.show.plots import AxisSamples, axis_plots, error_histogram, line_plot, plane_plot

STIFFNESS = np.array([3.0, 1.0, 2.0, 1e-4, 1e-4, 2e-4])


def energy(strains: np.ndarray) -> np.ndarray:
    return 0.5 * strains**2 @ STIFFNESS


def stress(strains: np.ndarray) -> np.ndarray:
    return strains * STIFFNESS


def samples(component: str, reach: float) -> AxisSamples:
    values = np.linspace(-reach, reach, 7)
    empty = AxisSamples(component, values, values)
    states = empty.strains(values)
    return AxisSamples(
        component, values, energy(states), stress(states)[:, empty.index], values < 0.9 * reach
    )


def test_axis_plots(tmp_path: Path) -> None:
    axes = [samples("s_x", 0.5), samples("II22", 80.0)]
    axis_plots(tmp_path / "axes.png", axes, energy, stress, title="quadratic")
    axis_plots(tmp_path / "axes.svg", axes, energy)
    assert imread(tmp_path / "axes.png").std() > 0.05
    assert (tmp_path / "axes.svg").read_text().lstrip().startswith("<?xml")


def test_strain_vectors_hold_the_other_components() -> None:
    base = np.array([0.1, 0, 0, 0, 0, 0])
    axis = AxisSamples("s_y", np.array([0.2]), np.zeros(1), base=base)
    assert axis.strains(axis.values).tolist() == [[0.1, 0, 0.2, 0, 0, 0]]


def test_plane_histogram_and_lines(tmp_path: Path) -> None:
    generator = np.random.default_rng(1)
    points = generator.uniform(-0.5, 0.5, (30, 2))
    states = np.zeros((30, 6))
    states[:, [0, 2]] = points
    plane_plot(
        tmp_path / "plane.png", ("s_x", "s_y"), points, energy(states), energy, converged=points[:, 0] < 0.4
    )
    plane_plot(
        tmp_path / "log.png", ("s_x", "s_y"), points, energy(states), lambda s: energy(s) - 0.01, scale="log"
    )
    error_histogram(tmp_path / "errors.png", {"s_x": generator.normal(size=50), "s_y": np.zeros(3)})
    line_plot(tmp_path / "l.png", {"a": (points[:, 0], points[:, 1])}, x_label="x [m]", y_label="y [m]")
    assert len(list(tmp_path.iterdir())) == 4


def test_errors_are_one_line(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="strain component"):
        axis_plots(tmp_path / "a.png", [AxisSamples("sx", np.arange(3.0), np.arange(3.0))], energy)
    with pytest.raises(InputError, match="at least one finite"):
        error_histogram(tmp_path / "a.png", {"s_x": np.array([np.nan])})
    with pytest.raises(InputError, match="cannot be written"):
        line_plot(tmp_path / "no" / "a.png", {"a": (np.arange(2.0),) * 2}, x_label="", y_label="")
    assert list(tmp_path.iterdir()) == []
