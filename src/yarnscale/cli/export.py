"""Command ``export``: a shell material in the form that other programs read."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence

from yarnscale.cli.console import print_json, writable_file
from yarnscale.errors import InputError
from yarnscale.files.material_json import read_material
from yarnscale.shell.materials.spline_material import SplineMaterial


def export(options: argparse.Namespace) -> int:
    """Write HYLC JSON or C source; what the format cannot hold goes to the standard error."""
    writable_file(options.out, ".json" if options.format == "hylc" else ".c")
    material = read_material(options.material)
    if not isinstance(material, SplineMaterial):
        raise InputError("material cannot be exported", where=options.material, expected="kind 'spline'")
    lost: Sequence[str] = ()
    if options.format == "hylc":
        from yarnscale.files.hylc_export import lost_in_hylc, write_hylc_json

        write_hylc_json(options.out, material)
        lost = lost_in_hylc(material)
        for phrase in lost:
            print(f"yarnscale: note: not in HYLC JSON: {phrase}", file=sys.stderr)
    else:
        from yarnscale.files.c_export import write_c_source

        write_c_source(options.out, material)
    if options.json:
        print_json({"out": str(options.out), "format": options.format, "lost": list(lost)})
    else:
        print(f"{options.out}: exported from {options.material}")
    return 0
