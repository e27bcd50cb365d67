"""The command ``test``: virtual tests of a fabric, alone or beside another."""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Iterator
from dataclasses import asdict, replace

from yarnscale.cell import PeriodicCell
from yarnscale.cli.console import ProgressLine, plain_json, print_notice, print_status, report
from yarnscale.cli.given_pattern import pattern_of, settled_drawing
from yarnscale.cli.values import refuse
from yarnscale.cli.yarn_choice import YarnChoice, common_friction, yarn_for
from yarnscale.errors import InputError
from yarnscale.files.atomic import write_text
from yarnscale.files.material_json import is_material, read_material
from yarnscale.files.newton_cloth import write_tests_table
from yarnscale.files.patterns import is_drawing
from yarnscale.files.run_folder import RunFolder
from yarnscale.homogeneous.fabrics import fabric_of
from yarnscale.laboratory.drape import drape_test
from yarnscale.laboratory.homogeneous_tests import LOADS, default_curvatures
from yarnscale.laboratory.programme import Difference, FabricTests, Programme, difference, run_tests
from yarnscale.shell.materials.material import ShellMaterial
from yarnscale.yarn.friction import YarnFriction


def test(options: argparse.Namespace) -> int:
    """Test one fabric, or two side by side; write ``tests.json``, ``tests.csv`` and ``index.html``."""
    from yarnscale.show.laboratory import write_page

    subjects = [options.subject] if options.against is None else [options.subject, options.against]
    shells = {name: read_material(name) for name in subjects if is_material(name)}
    drawn = {name: pattern_of(name, options.radius) for name in subjects if name not in shells}
    yarns = {name: yarn_for(name, pattern, options.material) for name, pattern in drawn.items()}
    programme = Programme(
        options.directions, options.loads or LOADS, "free" if options.free_curvature else "flat", options.curvatures,
        _friction(options, yarns.values()), options.cycles,
    )  # fmt: skip
    if not drawn:
        refuse(options, ("material", "radius"), "a pattern to test, not shell materials alone")
        refuse(options, ("friction",), "a pattern to test; a shell material has its own friction")
    elif programme.cycles is not None and programme.friction is None:
        refuse(options, ("cycles",), "--friction too, for yarns that have none of their own")
    for name, yarn in yarns.items():
        if programme.cycles is None and yarn.rubs:
            print_notice(f"note: {name} is tested without the friction of its yarn, which acts in --cycles")
    for name, shell in shells.items():
        if programme.cycles is None and shell.remembers:
            print_notice(f"note: {name} is tested without its friction, which acts in --cycles")
        if programme.cycles is not None and not shell.remembers:
            expected = "a shell material with friction, which 'yarnscale homogenize --friction' makes"
            raise InputError("cycles", where=name, expected=expected, found="one without")
    if not shells:
        refuse(options, ("drape",), "a shell material, which 'yarnscale homogenize' makes, not a cell")
    makes = ("tests.json", "tests.csv", "index.html", "tension.png", "bending.png", "cycles.png", "drape.png")
    results = RunFolder(options.out, "test", makes, overwrite=options.overwrite)
    tested: list[PeriodicCell | ShellMaterial] = []
    for name in subjects:
        if name in shells:
            tested.append(shells[name])
        else:
            pattern, yarn = drawn[name], yarns[name].materials
            yarns[name].print_status()
            if is_drawing(name) and not options.as_drawn:
                pattern = settled_drawing(pattern, yarn)
            tested.append(PeriodicCell(pattern, yarn))
    if len(tested) > 1 and programme.curvatures is None:
        # One list for both, so that their numbers come from the same points: that of the yarns, where there are any.
        lead = next((subject for subject in tested if isinstance(subject, PeriodicCell)), tested[1])
        programme = replace(programme, curvatures=default_curvatures(fabric_of(lead)))
    found = []
    for name, subject in zip(subjects, tested, strict=True):
        progress = ProgressLine(f"testing {name}").show
        tests = run_tests(subject, name=name, programme=programme, progress=progress)
        if options.drape and isinstance(subject, ShellMaterial):
            print_status(f"draping {tests.subject}")
            tests = replace(tests, drape=drape_test(subject))
        found.append(tests)
    compared = _compare(found)
    content = found[0].plain() | (yarns[subjects[0]].summary if subjects[0] in yarns else {})
    if compared is not None:
        content |= {"against": found[1].plain(), "difference": asdict(compared)}
    with results as folder:
        write_text(folder / "tests.json", plain_json(content, indent=1) + "\n")
        write_tests_table(folder / "tests.csv", found[0])
        write_page(folder, found, compared)
    failed = sum(tests.failed for tests in found)
    report(options, content, *_lines(found, compared), f"{folder / 'index.html'}: curves and numbers")
    if failed:
        print_notice(f"{failed} points have no equilibrium under their load; see status")
    return 1 if failed else 0


def _friction(options: argparse.Namespace, yarns: Iterable[YarnChoice]) -> YarnFriction | None:
    """That of the option; in cycles else that of the yarns. InputError where two patterns' yarns differ in it."""
    if options.friction is not None:
        return YarnFriction(options.friction)
    if options.cycles is None:
        return None
    known = common_friction((yarn.friction for yarn in yarns), "both patterns")
    return None if known is None else YarnFriction(known)


def _compare(found: list[FabricTests]) -> Difference | None:
    """The first against the second; a cell is the reference of a shell, whichever comes first."""
    if len(found) < 2:
        return None
    tested, reference = found
    if tested.kind == "cell" and reference.kind == "shell":
        tested, reference = reference, tested
    return difference(tested.tension, reference.tension)


def _lines(found: list[FabricTests], compared: Difference | None) -> Iterator[str]:
    """What the console says of the tests."""
    for tests in found:
        yield f"{tests.subject} ({tests.kind}), {1e3 * tests.density:.4g} g/m²"
        for pulled in tests.tensile:
            reached = "none" if pulled.EMT is None else f"{pulled.EMT:.4g} at {pulled.largest_load:.4g} N/m"
            yield f"  stretch along {pulled.direction:g}°: {reached}"
        for cycle in tests.cycles:
            if cycle.test == "tension":
                share = f"{cycle.returned:.3f} of {cycle.work:.4g} J/m²" if cycle.status == "converged" else "none"
                yield f"  work returned along {cycle.direction:g}°, cycle {cycle.number}: {share}"
        stopped = {(cycle.test, cycle.direction): cycle.stopped for cycle in reversed(tests.cycles) if cycle.stopped}
        for (test, direction), where in stopped.items():
            yield f"  {test} along {direction:g}° stopped: {where}"
        for bent in tests.bend:
            rigidity = "none" if bent.B is None else f"{1e6 * bent.B:.4g} µN·m"
            yield f"  bending rigidity along {bent.direction:g}°: {rigidity}"
        for roll in tests.rolls:
            yield f"  natural curvature along {roll.direction:g}°: {roll.curvature:.4g} /m, inside: {roll.side}"
        if tests.drape is not None:
            drape = tests.drape
            found_text = f"{drape.coefficient:.3f}, {drape.folds} folds" if drape.succeeded else drape.status
            yield f"  drape coefficient {found_text}"
    if compared is not None:
        yield (
            f"tension, {compared.points} points: stretch differs by at most {compared.stretch:.3g}, contraction by "
            f"{compared.contraction:.3g}"
        )
