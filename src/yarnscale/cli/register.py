"""The command ``register``: the yarns of a fabric from its photographs and its chart."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path

import numpy as np

from yarnscale.arrays import Array
from yarnscale.cli.console import ProgressLine, print_status, report, writable_file
from yarnscale.cli.values import refuse
from yarnscale.drawing.library import Structure
from yarnscale.errors import InputError, located
from yarnscale.files.fingerprint import fingerprint
from yarnscale.files.pattern_json import write_pattern_json
from yarnscale.files.patterns import stitches_of, structure_of
from yarnscale.files.photograph import Photograph, read_photograph
from yarnscale.files.registration_json import Session, read_session, session_path
from yarnscale.files.traced import read_traced
from yarnscale.swatches.registration.registration import Registration, registered
from yarnscale.swatches.registration.start import drawn, flattened
from yarnscale.swatches.registration.traced_fit import onto_lines
from yarnscale.yarn.pattern import YarnPattern


def register(options: argparse.Namespace) -> int:
    """Register a pattern."""
    writable_file(options.out, ".json")
    structure = _structure(options)
    if options.traced is not None:
        drawing, found = _traced(options, structure)
        pattern = found.pattern(drawing)
        write_pattern_json(pattern, options.out)
        _report(options, pattern, structure, found)
        return 0
    if options.front is None:
        raise InputError("--front is missing", expected="a photograph of the right side")
    files = {"front": options.front, "back": options.back}
    photographs = _photographs({side: path for side, path in files.items() if path is not None})
    pixel = _pixel(options, photographs)
    pictures = flattened({side: photograph.brightness for side, photograph in photographs.items()})
    period = None if options.period is None else np.array(options.period)
    drawing, guess = registered(
        structure, pictures, pixel=pixel, name=options.out.stem, radius=options.radius, period=period
    )
    session = _session(options, structure, pictures, guess)

    def write(finished: Session) -> None:
        write_pattern_json(finished.current.pattern(drawing), options.out)

    if not options.no_page:
        session = _corrected(options, session, photographs, pictures, write)
    pattern = session.current.pattern(drawing)
    write_pattern_json(pattern, options.out)
    _report(options, pattern, structure, session.current)
    return 0


def _photographs(files: dict[str, Path]) -> dict[str, Photograph]:
    """The pictures, all reduced as much as the largest of them."""
    found = {side: read_photograph(path) for side, path in files.items()}
    most = max(photograph.reduced for photograph in found.values())
    return {
        side: one if one.reduced == most else read_photograph(files[side], reduced=most) for side, one in found.items()
    }


def _structure(options: argparse.Namespace) -> Structure:
    """What ``--chart`` says."""
    structure = structure_of(options.chart)
    if structure is None:
        expected = "a .chart, .wif or .k file or a built-in pattern, which say what yarns cross"
        raise InputError("--chart", expected=expected, found=options.chart)
    stitches_of(options.chart)  # faults with their line
    return structure


def _traced(options: argparse.Namespace, structure: Structure) -> tuple[YarnPattern, Registration]:
    """The drawing and its curves on the lines of ``--traced``."""
    for name in ("front", "back"):
        if getattr(options, name) is not None:
            raise InputError(f"--{name}", expected="photographs or --traced, not both", found=getattr(options, name))
    refuse(options, ("no_page", "port", "overwrite"), "photographs with it: traced curves need no page")
    if options.traced.suffix.lower() == ".csv":
        refuse(options, ("scale",), "a drawing (.svg): lengths of a table are in mm")
    if options.radius is None:
        raise InputError("--radius is missing", expected="the radius of the yarn for traced curves [m]")
    traced = read_traced(options.traced, options.scale)
    period = traced.period if options.period is None else np.array(options.period)
    if period is None:
        expected = "a rectangle named period in the drawing, or --period WxH"
        raise InputError("period of the traced curves is unknown", where=options.traced, expected=expected)
    drawing, curves = drawn(structure, period, options.radius, name=options.out.stem)
    with located(options.traced):
        return drawing, onto_lines(curves, traced.lines)


def _session(
    options: argparse.Namespace, structure: Structure, pictures: dict[str, Array], guess: Registration
) -> Session:
    """The state beside the pattern, or a new one after the automatic fit."""
    path = session_path(options.out)
    given = (guess.pixel, options.radius, options.period)
    inputs = fingerprint(pictures, list(structure.chart), structure.draft, structure.sizes, *given)
    session = None if options.overwrite else read_session(path, inputs)
    if session is not None:
        print_status(f"{path}: going on from here; --overwrite begins anew")
        return session
    line = ProgressLine(f"moving the yarns of {options.out.stem}")
    fitted = guess.fitted(pictures, progress=line.note)
    line.end()
    return Session(path, inputs, fitted, (guess,)).saved()


def _corrected(
    options: argparse.Namespace,
    session: Session,
    photographs: dict[str, Photograph],
    pictures: dict[str, Array],
    write: Callable[[Session], None],
) -> Session:
    """The session after its user has finished on the page."""
    from yarnscale.show.register_page import RegistrationPage

    images = {side: photograph.png() for side, photograph in photographs.items()}
    page = RegistrationPage(session, images, pictures, write, port=options.port)
    print_status(f"{page.address}  (open it in a browser; Ctrl-C here stops, what was changed is kept)")
    try:
        page.serve()
    except KeyboardInterrupt:
        kept = f"{session.path} is kept, the same command goes on from it"
        raise KeyboardInterrupt(kept) from None
    return page.session


def _pixel(options: argparse.Namespace, photographs: dict[str, Photograph]) -> float:
    """Size of a pixel of the pictures as they are used [m]; InputError where nothing says it."""
    reduced = photographs["front"].reduced
    if options.scale is not None:
        return options.scale * reduced
    known = {photograph.dpi for photograph in photographs.values()}
    if None in known or len(known) > 1:
        expected = "--scale, such as 40px/mm, 600dpi, 1.8um/px or 820px=20mm"
        raise InputError("scale of the pictures is unknown", where=options.front, expected=expected)
    dpi = known.pop()
    assert dpi is not None
    print_status(f"{options.front}: {dpi:g} dpi as the file says; --scale takes another")
    return 25.4e-3 / dpi * reduced


def _report(options: argparse.Namespace, pattern: YarnPattern, structure: Structure, found: Registration) -> None:
    """What was found, in counts of a knitter."""
    if structure.draft is not None:
        stitches = np.array(structure.draft.shape[::-1])
    else:
        stitches = np.array([len(structure.chart[0].replace("|", "")), len(structure.chart)])
    wales, courses = 1e-2 * stitches / pattern.period
    length = float(pattern.rest_length.sum() / stitches.prod())
    names = ("ends", "picks") if structure.woven else ("wales", "courses")
    summary = {
        "out": str(options.out), "pattern": pattern.name, "period": pattern.period, "radius": pattern.radius,
        f"{names[0]}_per_cm": wales, f"{names[1]}_per_cm": courses, "yarn_in_stitch": length,
        "explained": dict(found.explained), "set_by_hand": len(found.pins),
    }  # fmt: skip
    shares = ", ".join(f"{side} {100 * share:.0f} %" for side, share in found.explained.items())
    width, height = 1e3 * pattern.period
    report(
        options, summary,
        f"{options.out}: {pattern.name}, {len(pattern.edges)} vertices, period {width:.4g} × {height:.4g} mm",
        f"  density          {wales:.4g} {names[0]}/cm, {courses:.4g} {names[1]}/cm",
        f"  yarn             radius {1e3 * pattern.radius:.4g} mm, {1e3 * length:.4g} mm in a stitch",
        f"  brightness       explained {shares or 'not measured'}",
        *([f"  set by hand      {len(found.pins)} points"] if found.pins else []),
    )  # fmt: skip
