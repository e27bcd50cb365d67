"""The command ``view``: a page on which a pattern, cell, material, run or estimate turns, stretches and plays."""

from __future__ import annotations

import argparse
import time
import webbrowser
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from yarnscale.cell.periodic import PeriodicCell
from yarnscale.cli.console import ProgressLine, print_status, report, writable_file
from yarnscale.cli.given_pattern import LARGE, at_rest
from yarnscale.cli.yarn_choice import yarn_for
from yarnscale.drawing import library
from yarnscale.errors import InputError, misspelt
from yarnscale.files.animation import read_animation
from yarnscale.files.atomic import write_text
from yarnscale.files.cell_origin import CellOrigin
from yarnscale.files.curve_frames import CURVES
from yarnscale.files.equilibrium_file import read_equilibrium
from yarnscale.files.fields import read_json
from yarnscale.files.material_json import is_material, read_material
from yarnscale.files.material_library import MATERIAL, file_of, names
from yarnscale.files.patterns import WRITERS, read_pattern
from yarnscale.homogenize.store import SampleStore
from yarnscale.kinematics import COMPONENTS
from yarnscale.show.local_page import NONCE, PAGE, LocalPage
from yarnscale.show.pane import Pane
from yarnscale.show.report import Cell, Picture, Section, Table, report_page
from yarnscale.show.run_pane import run_pane
from yarnscale.show.strained_pane import States, cell_pane, sheet_pane

LARGEST_PAGE = 10_000_000
"""Of an exported page [bytes]."""
PATIENCE = 90.0
"""Processor time after which a view begins no other equilibrium of a pattern [s]."""
_KINDS = (
    "a built-in pattern, a pattern file, STATE.npz of 'relax', a folder of 'sample', 'homogenize', 'simulate', "
    "'detail', 'fabric' or 'estimate', or a shell material (a name of the library or .json)"
)


@dataclass(frozen=True)
class View:
    """What a page shows: panes, facts in a strip on top, and tables and still pictures below."""

    title: str
    panes: tuple[Pane, ...]
    facts: Mapping[str, Cell]
    tables: tuple[Table, ...] = ()
    stills: tuple[Path, ...] = ()

    def page(self, nonce: str = "") -> str:
        """HTML."""
        pictures = [Picture(None, pane.title, wide=True, pane=pane) for pane in self.panes]
        pictures += [Picture(path, path.stem, wide=True) for path in self.stills]
        words = ["Drag to turn, right drag or Shift to move, wheel to come closer; arrow keys, + and − do the same."]
        sections = [Section("View", words, (), pictures)]
        sections += [Section(table.caption, (), [table]) for table in self.tables]
        return report_page(self.title, sections, facts=dict(self.facts), nonce=nonce)


class ViewPage(LocalPage):
    """Serves one page."""

    def __init__(self, page: str, *, port: int = 0) -> None:
        self._page = page.encode()
        super().__init__(port=port)

    def content(self, name: str) -> tuple[str, bytes] | None:
        """The page, and nothing else."""
        return (PAGE, self._page) if name == "" else None


def view(options: argparse.Namespace) -> int:
    """Serve or export a page."""
    writable_file(options.export, ".html", ".htm")
    found = view_of(options)
    if options.export is not None:
        page = found.page()
        if (size := len(page.encode())) > LARGEST_PAGE:
            raise InputError("page", where=options.export, expected="below 10 MB", found=f"{size / 1e6:.1f} MB")
        write_text(options.export, page)
        summary = {"out": str(options.export), "bytes": size, "panes": [pane.title for pane in found.panes]}
        report(options, summary, f"{options.export}: {found.title}, {size / 1e6:.1f} MB, needs no network")
        return 0
    served = ViewPage(found.page(NONCE), port=options.port)
    print_status(f"{served.address}  (open it in a browser; Ctrl-C here ends)")
    if options.browser:
        webbrowser.open(served.address)
    try:
        served.serve()
    except KeyboardInterrupt:
        print_status("")
    return 0


def view_of(options: argparse.Namespace) -> View:
    """What the command line names; InputError where it is nothing that can be seen."""
    target, path = options.thing, Path(file_of(options.thing, MATERIAL))
    known = (*library.names(), *names())
    if target in known and Path(target).exists():
        print_status(f"{target}: the one that comes with yarnscale; ./{target} is your own")
    if target in library.names():
        return _pattern(options, target)
    if path.is_dir():
        for there, make in _FOLDERS:
            if there(path):
                return make(options, path)
        raise InputError("folder holds nothing to view", where=path, expected=_KINDS)
    if not path.exists():
        raise InputError("nothing to view", expected=_KINDS, found=misspelt(target, known))
    if path.suffix.lower() == ".npz":
        return _equilibrium(path)
    if is_material(path):
        return _material(path, target if target in known else path.name)
    if path.suffix.lower() in WRITERS or path.suffix == "":
        return _pattern(options, target)
    raise InputError("file is nothing to view", where=path, expected=_KINDS, found=repr(path.suffix))


def _pattern(options: argparse.Namespace, source: str) -> View:
    drawn = read_pattern(source)
    yarn = yarn_for(source, drawn, options.material)
    yarn.print_status()
    options.pattern = source
    cell = PeriodicCell(at_rest(options, drawn, yarn.materials), yarn.materials)
    return View(drawn.name, (_cell(cell),), _facts(cell))


def _cell(cell: PeriodicCell) -> Pane:
    """Relaxed here, at several states or, where that would take long, at one."""
    name = cell.pattern.name
    line = ProgressLine(f"relaxing {name}")
    if len(cell.pattern.edges) > LARGE:
        print_status(f"{name}: {len(cell.pattern.edges)} vertices, shown at rest only; 'homogenize' samples it")
        return cell_pane(cell, States.of([cell.with_options(watch=line.note_solve).relax()]), name)
    began = time.process_time()
    states = States.loaded(cell, line.show, PATIENCE)
    if time.process_time() - began > PATIENCE:
        print_status(
            f"{name}: {len(states.strains)} states in {PATIENCE:.0f} s, others are left out; 'homogenize' has all"
        )
    return cell_pane(cell, states, name)


def _facts(cell: PeriodicCell) -> dict[str, Cell]:
    pattern = cell.pattern
    width, height = 1e3 * pattern.period
    return {
        "yarn": cell.material_name, "period [mm]": f"{width:.4g} × {height:.4g}",
        "yarn radius [mm]": 1e3 * pattern.radius, "yarns": len(pattern.yarns), "vertices": len(pattern.edges),
        "area density [g/m²]": 1e3 * cell.area_density,
    }  # fmt: skip


def _equilibrium(path: Path) -> View:
    cell, found = read_equilibrium(path)
    strain, stress, moved = (found[name].reshape(1, -1) for name in ("strain", "stress", "fluctuation"))
    states = States(strain, found["energy_density"].reshape(1), stress, moved)
    rows: list[list[Cell]] = [[name, float(value)] for name, value in zip(COMPONENTS, found["strain"], strict=True)]
    table = Table(["component", "strain [–, 1/m]"], rows, "State")
    pane = cell_pane(cell, states, path.name)
    return View(f"{cell.pattern.name}, relaxed", (pane,), _facts(cell), (table,))


def _store(options: argparse.Namespace, path: Path, source: Path | None = None) -> View:
    store, source = SampleStore(path), source or path.parent / "pattern.json"
    origin = CellOrigin.of(store.attributes["provenance"], path)
    if origin is None or not (source.is_file() or origin.name in library.names()):
        raise InputError("pattern of the samples", where=path, expected=f"{source}, or a built-in pattern")
    named = str(source) if source.is_file() else origin.name
    cell = PeriodicCell(origin.cell_pattern(read_pattern(named), named), origin.yarns)
    states = States.stored(store, cell.pattern.woven)
    if len(states.strains) == 0:
        raise InputError("samples", where=path, expected="a state that converged", found="none")
    facts = {**_facts(cell), "equilibria": len(states.strains)}
    return View(f"{cell.pattern.name}, sampled", (cell_pane(cell, states, cell.pattern.name),), facts)


def _homogenized(options: argparse.Namespace, path: Path) -> View:
    found = _store(options, path / "samples")
    if not (path / "material.json").is_file():
        return found
    shell = _material(path / "material.json", path.name)
    return View(f"{found.panes[0].title}, homogenized", (*found.panes, *shell.panes), {**found.facts, **shell.facts})


def _material(path: Path, name: str) -> View:
    material = read_material(path)
    facts = {"shell material": type(material).__name__, "density [g/m²]": 1e3 * material.density}
    title = f"shell material {name}"
    return View(title, (sheet_pane(material, States.material(material), title),), facts)


def _run(options: argparse.Namespace, path: Path) -> View:
    from yarnscale.cli.cloth import MATERIAL

    animation = read_animation(path)
    places = [place / MATERIAL for place in (path, path.parent)]
    material = next((read_material(place) for place in places if place.is_file()), None)
    shown = {"yarns" if animation.cloth is None else "cloth": animation}
    if animation.cloth is not None and animation.yarns is not None:
        cloth = read_animation(path / "frames" if (path / "frames").is_dir() else path)
        shown = {"yarns of the cloth": animation, "cloth": cloth}
    panes = [run_pane(one, name, material=material) for name, one in shown.items()]
    facts: dict[str, Cell] = {"frames": len(animation), "time [s]": float(animation.times[-1])}
    if animation.cloth is not None:
        facts["triangles"] = len(animation.cloth.triangles)
    if animation.yarns is not None:
        facts |= {"yarns": len(animation.yarns), "yarn vertices": animation.yarns.point_count}
    return View(f"run {path.name}", tuple(panes), facts)


def _estimate(options: argparse.Namespace, path: Path) -> View:
    content = read_json(path / "estimate.json")
    parameters = content.get("parameters")
    if not isinstance(parameters, dict):
        raise InputError("field 'parameters'", where=path / "estimate.json", expected="a table of numbers")
    table = Table(["", "SI units"], [[str(name), value] for name, value in parameters.items()], "Parameters")
    source, curves, found = path / "pattern.json", path / "curves.png", None
    pattern_hash = read_pattern(source).content_hash()
    for samples in (path / "homogenized" / place / "samples" for place in ("refitted", "")):
        if found is None and samples.is_dir():
            origin = CellOrigin.of(SampleStore(samples).attributes["provenance"], samples)
            if origin is not None and origin.pattern_hash == pattern_hash:
                found = _store(options, samples, source)
    found = found or _pattern(options, str(source))
    stills = (curves,) if curves.is_file() else ()
    return replace(found, title=f"estimated yarn of {path.name}", tables=(table,), stills=stills)


_FOLDERS: tuple[tuple[Callable[[Path], bool], Callable[[argparse.Namespace, Path], View]], ...] = (
    (lambda path: (path / "estimate.json").is_file(), _estimate),
    (lambda path: (path / "zarr.json").is_file(), _store),
    (lambda path: (path / "samples" / "zarr.json").is_file(), _homogenized),
    (lambda path: any((path / name).exists() for name in ("frames", "mesh.npz", CURVES, "yarns")), _run),
    (
        lambda path: (path / "pattern.json").is_file(),
        lambda options, path: _pattern(options, str(path / "pattern.json")),
    ),
)
"""Signs of a folder -> its view."""
