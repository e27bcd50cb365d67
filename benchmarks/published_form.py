"""Ablations of the form of HYLC20 (Figures 11, 14 and 17), all fitted to the samples of one homogenization.

python benchmarks/published_form.py PATTERN DIR [--solves 400] [--workers 2]

Writes DIR/NAME.json for every variant; ``yarnscale simulate drape --shell DIR/NAME.json --format png`` draws it.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from yarnscale.cell import PeriodicCell
from yarnscale.cell.rest import settled
from yarnscale.drawing import library
from yarnscale.files.material_json import write_material
from yarnscale.homogenize.homogenize import errors_at, fit_published, homogenize
from yarnscale.homogenize.published_fit import PublishedOptions
from yarnscale.homogenize.store import SampleStore
from yarnscale.yarn.material import YarnMaterial

VARIANTS = {
    "published": PublishedOptions(),
    "little-regularisation": PublishedOptions(smoothing=0.1),
    "even-knots": PublishedOptions(even_knots=True),
    "terms-of-one-strain": PublishedOptions(pairs=False),
}


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("pattern", choices=library.names(), metavar="PATTERN")
    parser.add_argument("folder", type=Path, metavar="DIR")
    parser.add_argument("--solves", type=int, default=400)
    parser.add_argument("--workers", type=int, default=2)
    options = parser.parse_args()
    yarn = YarnMaterial.preset(library.structure(options.pattern).material)
    cell = PeriodicCell(settled(library.build(options.pattern), yarn).pattern, yarn)
    options.folder.mkdir(parents=True, exist_ok=True)
    unseen = homogenize(
        cell, options.folder, form="hylc2020", solves=options.solves, workers=options.workers, resume=True
    ).unseen
    store = SampleStore(options.folder / "samples")
    for name, variant in VARIANTS.items():
        material = fit_published(store, options=variant)
        write_material(options.folder / f"{name}.json", material)
        errors = errors_at(material, unseen)
        print(
            f"{name:22} error of the stress at unseen states: median {errors.median:.1%}, 95 % {errors.high:.1%}"
        )


if __name__ == "__main__":
    main()
