"""Every field that ``--json`` prints is in docs/reference/json_output.md, with its unit."""

from __future__ import annotations

import inspect
import json
import re
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

import pytest

from yarnscale.cli import convert, detail, fabric_models, materials, register
from yarnscale.fabric.imposed import ImposedShape
from yarnscale.files.material_json import write_material
from yarnscale.laboratory.programme import FabricTests
from yarnscale.motion.run import Run
from yarnscale.shell.materials.orthotropic import OrthotropicMaterial
from yarnscale.shell.scenes.scene import SceneResult
from yarnscale.swatches.yarn_estimate import FabricEstimate

PAGE = Path(__file__).parents[2] / "docs" / "reference" / "json_output.md"


def rows() -> Iterator[list[str]]:
    """Cells of the tables' rows, without heads and rules."""
    for line in PAGE.read_text().splitlines():
        if line.startswith("| ") and "| unit |" not in line:
            yield [cell.strip() for cell in line.strip("| ").split(" | ")]


def test_every_field_has_a_unit() -> None:
    for row in rows():
        unit = row[-2]
        assert unit and "`" not in unit, row


def documented() -> set[str]:
    return {
        name for row in rows() for cell in row for name in re.findall(r"\w+", " ".join(re.findall("`(.+?)`", cell)))
    }


@pytest.mark.parametrize(
    "summary",
    [
        FabricEstimate.summary, FabricTests.plain, Run.summary, SceneResult.summary, convert.convert, detail.detail,
        materials.homogenize, register._report, fabric_models._imposed, ImposedShape.measures,
    ],
    ids=lambda function: function.__qualname__,
)  # fmt: skip
def test_what_long_runs_print_is_on_the_page(summary: Callable[..., object]) -> None:
    names = set(re.findall(r'(?<!== )"(\w+)":', inspect.getsource(summary)))
    assert names and names <= documented()


@pytest.mark.parametrize(
    "arguments",
    [
        "patterns", "pattern plain --as-drawn --out p.json", "relax plain --as-drawn",
        "study plain --as-drawn --sizes 1x1",
        "evaluate cloth.json --strain 0.1,0,0,0,0,0", "fabric jersey --rows 3 --columns 3 --count",
        "fabric plain --rows 3 --columns 3 --method direct --count",
        "fabric jersey --rows 3 --columns 3 --volume 4,4,2 --method compare --duration 0.005 --out run",
        "stretch cloth.json --direction course --amount 0.01 --duration 0.02 --spacing 0.03 --out run",
    ],
)  # fmt: skip
def test_what_commands_print_is_on_the_page(run, monkeypatch, tmp_path: Path, arguments: str) -> None:
    monkeypatch.chdir(tmp_path)
    write_material(
        tmp_path / "cloth.json",
        OrthotropicMaterial(40.0, 9.0, 25.0, 6.0, bend_weft=4e-6, bend_bias=3e-6, bend_warp=2e-6),
    )
    known = documented()
    found = json.loads(run(*arguments.split(), "--json").out)

    def check(content: object) -> None:
        if isinstance(content, Mapping):
            for name, value in content.items():
                assert name in known
                if name != "energy_parts":
                    check(value)
        elif isinstance(content, list):
            for entry in content:
                check(entry)

    check(found)
