"""The Warp source of a material: run on the processor, it agrees with the material."""

from __future__ import annotations

import importlib.util
from dataclasses import replace

import numpy as np
import pytest

from yarnscale.files.energy_source import write_energy_source
from yarnscale.shell.materials.compact import SpringNetwork, shapes_of

PROGRAM = """

@wp.kernel
def at_all(strains: wp.array(dtype=vec6), numbers: wp.array(dtype=wp.float64), found: wp.array(dtype=wp.float64)):
    n = wp.tid()
    found[n] = yarnscale_energy(strains[n], numbers)
"""


def test_energy_and_its_gradient_agree(tmp_path, compact, states):
    # More units than loops that Warp unrolls: in longer ones it differentiates sums alone.
    rng = np.random.default_rng(2)
    numbers = SpringNetwork(*(rng.normal(size=tuple(shape)) for shape in shapes_of(18, 20, 17)))
    positive = {n: np.abs(getattr(numbers, n)) for n in ("stiffnesses", "background", "wall_stiffnesses")}
    compact = replace(compact, springs=numbers._replace(**positive))
    wp = pytest.importorskip("warp")
    wp.config.kernel_cache_dir = str(tmp_path / "cache")
    path = tmp_path / "exported.py"
    write_energy_source(path, compact, "warp")
    path.write_text(path.read_text() + PROGRAM)
    spec = importlib.util.spec_from_file_location("exported", path)
    assert spec is not None and spec.loader is not None
    exported = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(exported)
    strains = states(0.9, 20)
    given = wp.array(strains, dtype=exported.vec6, device="cpu", requires_grad=True)
    numbers = wp.array(exported.NUMBERS, dtype=wp.float64, device="cpu")
    found = wp.zeros(len(strains), dtype=wp.float64, device="cpu", requires_grad=True)
    with wp.Tape() as tape:
        wp.launch(exported.at_all, dim=len(strains), inputs=[given, numbers], outputs=[found], device="cpu")
    np.testing.assert_allclose(found.numpy(), compact.energy_density(strains), rtol=1e-12)
    tape.backward(grads={found: wp.array(np.ones(len(strains)), dtype=wp.float64, device="cpu")})
    np.testing.assert_allclose(given.grad.numpy(), compact.stress(strains), rtol=1e-9, atol=1e-12)
