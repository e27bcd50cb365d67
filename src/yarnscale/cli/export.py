"""Command ``export``: a shell material in the form that other programs read."""

from __future__ import annotations

import argparse

import numpy as np

from yarnscale.cli.console import print_notice, print_status, report, writable_file
from yarnscale.cli.values import refuse
from yarnscale.errors import InputError
from yarnscale.files.material_json import read_material, write_material
from yarnscale.shell.materials.compact import CompactMaterial
from yarnscale.shell.materials.material import ShellMaterial
from yarnscale.shell.materials.spline_material import SplineMaterial

_ENDINGS = {"hylc": ".json", "c": ".c", "warp": ".py", "newton": ".json"}


def export(options: argparse.Namespace) -> int:
    """Write HYLC JSON, C or Warp source, or parameters of Newton's cloth; losses go to the standard error."""
    writable_file(options.out, _ENDINGS[options.format])
    if options.format != "newton":
        refuse(options, ("loads",), "--format newton with it")
    material = read_material(options.material)
    lost: list[str] = []
    if material.remembers:
        lost.append("friction: the exported cloth is elastic and remembers nothing")
        print_notice(f"note: {lost[0]}")
    if options.format == "hylc":
        lost.append(_hylc(options, material))
    elif options.format == "newton":
        lost.extend(_newton(options, material))
    else:
        if not isinstance(material, CompactMaterial):
            raise InputError(
                "material cannot be exported", where=options.material,
                expected="kind 'compact', which homogenize writes",
            )  # fmt: skip
        from yarnscale.files.energy_source import write_energy_source

        write_energy_source(options.out, material, options.format)
    summary = {"out": str(options.out), "format": options.format, "lost": lost}
    report(options, summary, f"{options.out}: exported from {options.material}")
    return 0


def _newton(options: argparse.Namespace, material: ShellMaterial) -> list[str]:
    """Write Newton's cloth and, beside it, the table of the material's tests; what that cloth cannot do."""
    from yarnscale.files.newton_cloth import errors_by_test, write_newton_cloth, write_tests_table
    from yarnscale.laboratory.style3d import RANGE, fit_style3d

    table = options.out.with_suffix(".tests.csv")
    writable_file(table, ".csv")
    fit = fit_style3d(material, options.loads or RANGE)
    write_tests_table(table, fit.tests)
    write_newton_cloth(options.out, fit, str(options.material))
    print_status(f"{table}: all tests of the material, for other engines")
    print_status(f"errors of Newton's cloth, median and largest, from {fit.loads[0]:g} to {fit.loads[1]:g} N/m:")
    for name, errors in errors_by_test(fit.deviations).items():
        print_status(f"  {name}: {errors}")
    for loss in fit.lost:
        print_notice(f"note: not in Newton's cloth: {loss}")
    return list(fit.lost)


def _hylc(options: argparse.Namespace, material: object) -> str:
    """Write HYLC JSON; what it loses."""
    from yarnscale.homogenize.compact_problem import StressErrors
    from yarnscale.homogenize.homogenize import published_form

    lost = "the sampled range and the provenance"
    if isinstance(material, CompactMaterial):
        known = np.delete(material.samples, 4, axis=1)
        box = np.stack([known.min(axis=0), known.max(axis=0)], axis=1)
        box[1] = np.max(np.abs(box[1])) * np.array([-1, 1])
        published = published_form(material, box)
        errors = StressErrors.of(published.stress(material.samples), material.stress(material.samples), material.scale)
        lost = (
            "what more than two strains do together: the stress differs by "
            f"{100 * errors.median:.3g} % (median) and {100 * errors.high:.3g} % (95th percentile) at sampled states"
        )
    elif isinstance(material, SplineMaterial):
        published = material
    else:
        raise InputError("material cannot be exported", where=options.material, expected="kind 'compact' or HYLC JSON")
    write_material(options.out, published)
    print_notice(f"note: not in HYLC JSON: {lost}")
    return lost
