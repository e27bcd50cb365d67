"""From measurements to the shell of a fabric and to the uniform data that yarns are fitted to, in one call."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

from yarnscale.checked import checked
from yarnscale.errors import InputError
from yarnscale.shell.materials.orthotropic import DirectionalMaterial
from yarnscale.swatches.bend_fit import BendFit, fit_bending
from yarnscale.swatches.measurements import SwatchMeasurements
from yarnscale.swatches.membrane_constants import ShellModel
from yarnscale.swatches.shell_fit import ShellFit, fit_membrane
from yarnscale.swatches.uniform_data import UniformBend, UniformData, corrected_data, uniform_bending, uniform_data


@dataclass(frozen=True, eq=False)
class FabricShell:
    """The shell fitted to a fabric: its membrane, and its bending where pear loops were measured."""

    measurements: SwatchMeasurements
    membrane: ShellFit
    bending: BendFit | None

    @property
    def material(self) -> DirectionalMaterial:
        """The material with everything that was fitted."""
        return self.membrane.material if self.bending is None else self.bending.material

    def uniform_data(self, *, follow: Literal["shell", "measured"] = "shell") -> UniformData:
        """The curves that a yarn model is fitted to.

        follow: stress of the shell itself (EST22 eq. 3), or the measured curves, from which the shell only takes out
        the effect of the clamps.
        """
        if follow not in ("shell", "measured"):
            raise InputError("follow", expected="shell or measured", found=follow)
        translate = uniform_data if follow == "shell" else corrected_data
        data = translate(self.membrane, self.measurements)
        strips = self.measurements.rigidity
        bent = tuple(UniformBend(strip.direction, 0.5 * strip.rigidity) for strip in strips)
        return replace(data, bending=bent if self.bending is None else uniform_bending(self.bending))


@checked
def fit_shell(measurements: SwatchMeasurements, *, model: ShellModel = "stiffening") -> FabricShell:
    """Fit membrane and bending to everything that was measured. Raises InputError without a stretch test.

    model: a shell that stiffens (``StiffeningMaterial``), or "stvk", that of EST22 (``OrthotropicMaterial``).
    """
    membrane = fit_membrane(measurements, model=model)
    bending = fit_bending(measurements, membrane.material) if measurements.bend else None
    return FabricShell(measurements, membrane, bending)
