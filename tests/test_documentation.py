"""What README and docs say works: commands parse and run, Python runs, samples and pages are there."""

from __future__ import annotations

import importlib.util
import re
import tomllib
from pathlib import Path

import pytest

import yarnscale
from yarnscale.cli import _joined, main
from yarnscale.cli.arguments import parser
from yarnscale.cli.guide import SAMPLES, pages
from yarnscale.files.grid_toml import read_grid
from yarnscale.files.material_toml import read_yarn_material
from yarnscale.files.measurements import read_measurements
from yarnscale.files.obj_garment import read_garment
from yarnscale.files.patterns import read_pattern
from yarnscale.files.scene_toml import read_scene

ROOT = Path(__file__).resolve().parents[1]
PAGES = [ROOT / "README.md", *sorted(p for p in (ROOT / "docs").rglob("*.md") if p.name != "index.md")]
"""All but the index of the site, which includes README."""
_spec = importlib.util.spec_from_file_location("run_commands", ROOT / "docs" / "run_commands.py")
assert _spec is not None and _spec.loader is not None
run_commands = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(run_commands)
COMMANDS = [(page.name, line, text) for page in PAGES for line, text in run_commands.commands(page)]


@pytest.mark.parametrize(("page", "line", "arguments"), COMMANDS, ids=[f"{p}-{n}" for p, n, _ in COMMANDS])
def test_commands_parse_as_they_stand_and_made_small(page: str, line: int, arguments: list[str]) -> None:
    parser().parse_args(_joined(arguments))
    if (small := run_commands.small(arguments)) is not None:
        parser().parse_args(_joined(small))


def test_there_are_commands() -> None:
    assert len(COMMANDS) > 25
    for reason in run_commands.PARSED_ONLY.values():
        assert (ROOT / reason.rpartition("; ")[2]).exists()


def test_files_that_commands_name_are_samples_or_made_before() -> None:
    there = {path.name for path in SAMPLES.iterdir()}
    for page, line, arguments in COMMANDS:
        if page != "README.md" and "samples" not in [text[0] for name, _, text in COMMANDS if name == page]:
            continue
        made = {
            text[text.index("--out") + 1] for name, n, text in COMMANDS if name == page and n < line and "--out" in text
        }
        for word in arguments[1:]:
            path = Path(word)
            if path.suffix in (".csv", ".toml", ".chart", ".obj") and arguments[arguments.index(word) - 1] != "--out":
                assert word in there or word in made, (page, line, word)


def test_other_lines_of_consoles_name_what_is_there() -> None:
    """Commands of yarnscale are run in ``.ci/run`` (docs/run_commands.py); benchmarks and targets are looked up."""
    targets = re.findall(r"^(\w+):", (ROOT / "Makefile").read_text(), re.MULTILINE)
    for page in PAGES:
        for line, language, content in run_commands.blocks(page):
            for text in content.replace("\\\n", " ").splitlines() if language == "console" else ():
                program, *words = text.split("#")[0].split()
                assert program in ("yarnscale", "make", "python"), (page.name, line, text)
                if program == "make":
                    assert words[0] in targets, (page.name, line, text)
                if program == "python":
                    source = (ROOT / words[0]).read_text(encoding="utf-8")
                    assert all(f'"{word}"' in source for word in words if word.startswith("--")), (
                        page.name,
                        line,
                        text,
                    )


def test_files_of_pages_are_what_readers_take(tmp_path: Path) -> None:
    chart = 0
    for page in PAGES:
        for line, language, content in run_commands.blocks(page):
            if language == "toml":
                tomllib.loads(content)
            if language == "" and "kind = " in content:
                (tmp_path / f"c{line}.chart").write_text(content)
                assert len(read_pattern(tmp_path / f"c{line}.chart").edges)
                chart += 1
    assert chart >= 2


def test_links_lead_to_files() -> None:
    for page in [*PAGES, ROOT / "CONTRIBUTING.md", ROOT / "CHANGELOG.md"]:
        for target in re.findall(r"\]\((?!https?:)([^)#\s]+)", page.read_text(encoding="utf-8")):
            assert (page.parent / target).exists(), (page.name, target)


def test_the_reference_lists_the_public_names() -> None:
    text = (ROOT / "docs" / "reference" / "python.md").read_text(encoding="utf-8")
    assert set(re.findall(r"`(\w+)`", text)) >= set(dir(yarnscale)) - {"__version__"}


def test_modules_and_names_that_pages_mention_are_there() -> None:
    for page in PAGES:
        for dotted in re.findall(r"(?<![\w./])yarnscale((?:\.\w+)+)", page.read_text(encoding="utf-8")):
            place, source = ROOT / "src" / "yarnscale", ""
            for name in dotted[1:].split("."):
                if (place / name).is_dir() or (place / f"{name}.py").is_file():
                    place = place / name
                    file = place.with_suffix(".py") if place.with_suffix(".py").is_file() else place / "__init__.py"
                    source = file.read_text(encoding="utf-8")
                else:
                    source = source or (place / "__init__.py").read_text(encoding="utf-8")
                    assert re.search(rf"\b{name}\b", source), (page.name, dotted)


def test_contributors_find_what_the_list_of_places_names() -> None:
    listed = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    places = re.findall(r"^\| [^|]+ \| `(\S+\.py)` \| ([^|]+) \|$", listed, re.MULTILINE)
    assert len(places) > 25
    for path, names in places:
        source = (ROOT / "src" / "yarnscale" / path).read_text(encoding="utf-8")
        for name in re.findall(r"`(\w+)`", names):
            assert re.search(rf"^ *(?:def |class |){name}\b *(?:[=(:\[]|, )", source, re.MULTILINE), (
                path,
                name,
            )


def test_samples_are_what_readers_take(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["samples", "--out", str(tmp_path)]) == 0
    assert main(["samples", "--out", str(tmp_path)]) == 2
    assert main(["samples", "--out", str(tmp_path), "--overwrite"]) == 0
    assert "curves.csv" in capsys.readouterr().out
    for name in ("flag.toml", "scene.toml"):
        assert read_scene(tmp_path / name).name == Path(name).stem
    for name in ("curves.csv", "fabric.toml"):
        measured = read_measurements(tmp_path / name)
        assert {test.direction.value for test in measured.stretch} == {"weft", "warp"}
    for name in ("basket.chart", "overshot.chart"):
        assert read_pattern(tmp_path / name).name == Path(name).stem
    assert read_yarn_material(tmp_path / "yarn.toml").name == "soft wool"
    assert read_grid(tmp_path / "grid.toml").s_x == (0.0, 0.1)
    assert read_garment(tmp_path / "mesh.obj").vertex_count == 81


def test_the_guide_is_in_every_installation(capsys: pytest.CaptureFixture[str]) -> None:
    wheel = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["hatch"]["build"]["targets"]["wheel"]
    packed = [ROOT / name for name in wheel["force-include"]]
    assert all(path.exists() for path in packed)
    assert all(page in packed or page.parent in packed for page in PAGES)
    assert set(pages().values()) == set(PAGES)
    assert main(["help"]) == 0 and "chart " in capsys.readouterr().out
    assert main(["help", "chart"]) == 0 and "# Chart files" in capsys.readouterr().out
    assert main(["help", "lace"]) == 2 and "unknown topic" in capsys.readouterr().err
    source = "\n".join(path.read_text() for path in (ROOT / "src").rglob("*.py") if "_options" in path.name)
    for line in source.splitlines():
        if "yarnscale help " in line:
            assert line.split("yarnscale help ")[1].split()[0].strip("',\").") in pages()
        assert "docs/" not in line
