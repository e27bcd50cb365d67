"""Microseconds per element of the generated kernels, one thread, on blocks that stay in cache.

Run ``python benchmarks/kernels.py``. With ``--jax`` (extra ``benchmark``) the same energies are measured as
``jax.jit(jax.vmap(...))`` beside them; with ``--shell`` the kernels of cloth on a curled sheet.
"""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Callable

import numba
import numpy as np

from yarnscale.numerics.address_call import call_address
from yarnscale.numerics.energy import StencilEnergy
from yarnscale.numerics.kernel import BLOCK, Kernel
from yarnscale.yarn.contact import contact_energy, contact_samples
from yarnscale.yarn.material import ContactRule
from yarnscale.yarn.rod import BEND_TWIST, STRETCH, TWO_PHASE_STRETCH

KINDS = ("value", "gradient", "hessian")
TARGETS = {("bend_twist", "hessian"): 1.0, ("contact_hylc2020_5", "gradient"): 0.15}
SAMPLES = 41


@numba.njit
def _repeat(address: int, pointers: np.ndarray, times: int) -> None:
    for _ in range(times):
        call_address(address, (BLOCK, BLOCK, pointers))


def microseconds(kernel: Kernel, *inputs: np.ndarray) -> float:
    """Median time per element of one block, inputs (size, BLOCK), called again and again from compiled code."""
    arrays = [*inputs, *(np.empty((size, BLOCK)) for size in kernel.sizes[len(inputs) :])]
    pointers = np.array([array.ctypes.data for array in arrays], np.int64)
    _repeat(kernel.address, pointers, 10)
    times, repeats = [], 100
    for _ in range(SAMPLES):
        start = time.perf_counter()
        _repeat(kernel.address, pointers, repeats)
        times.append(time.perf_counter() - start)
    return 1e6 * float(np.median(times)) / repeats / BLOCK


def elements(energy: StencilEnergy) -> tuple[np.ndarray, np.ndarray]:
    """A block of stencils as cells have them: variables (n, BLOCK) and parameters (m, BLOCK)."""
    rng = np.random.default_rng(0)
    if energy.name.startswith("contact"):
        segment, across = np.array([[-0.5, 0, 0], [0.5, 0, 0]]), np.array([[0, -0.5, 0], [0, 0.5, 0]])
        q = np.tile(np.concatenate([segment, across]).ravel(), (BLOCK, 1))
        q[:, [8, 11]] += rng.uniform(1.6, 2.6, (BLOCK, 1))  # about half of the listed pairs touch
        row = [1.0, 0.25] + ([10.0, 4.0] if "est2022" in energy.name else [])
    elif energy is BEND_TWIST:
        q = np.tile([0, 0, 0, 1, 0, 0, 1.9, 0.4, 0, 0, 0], (BLOCK, 1))
        row = [1, 0, 0, 0.9, 0.43, 0, 0, 1, 0, -0.43, 0.9, 0, 0, 0.1, 0.2, 0.1, 1.0, 1.0]
    else:
        q = np.tile([0, 0, 0, 1, 0, 0], (BLOCK, 1))
        row = [1.1, 1.0] + ([20.0, 0.1] if energy is TWO_PHASE_STRETCH else [])
    q = q + 0.05 * rng.normal(size=q.shape)
    return np.ascontiguousarray(q.T), np.ascontiguousarray(np.tile(row, (BLOCK, 1)).T.astype(float))


def jax_functions() -> dict[str, Callable]:
    """The energies of one element written for JAX: (variables, parameters) → scalar."""
    # One thread, as for the kernels; read when jax starts.
    os.environ.setdefault("XLA_FLAGS", "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1")
    import jax
    import jax.numpy as jnp

    jax.config.update("jax_enable_x64", True)
    rule = ContactRule()
    points = jnp.array(rule.quadrature_points)
    weights = jnp.outer(*(2 * [jnp.array(rule.quadrature_weights)]))

    def stretch(q, p):  # type: ignore[no-untyped-def]
        strain = jnp.linalg.norm(q[3:] - q[:3]) / p[0] - 1
        return 0.5 * p[1] * p[0] * strain**2

    def contact(q, p):  # type: ignore[no-untyped-def]
        a0, a1, b0, b1 = q.reshape(4, 3)
        a = a0 + points[:, None] * (a1 - a0)
        b = b0 + points[:, None] * (b1 - b0)
        y = ((a[:, None] - b[None]) ** 2).sum(-1) * p[1]
        return p[0] * (weights * jnp.maximum(0, 1 - y) ** 2 / y).sum()

    def transport(vector, start, end):  # type: ignore[no-untyped-def]
        cosine, axis = start @ end, jnp.cross(start, end)
        return vector * cosine + jnp.cross(axis, vector) + axis * (axis @ vector) / (1 + cosine)

    def turned(vector, axis, angle):  # type: ignore[no-untyped-def]
        return jnp.cos(angle) * vector + jnp.sin(angle) * jnp.cross(axis, vector)

    def bend_twist(q, p):  # type: ignore[no-untyped-def]
        x0, x1, x2 = q[:9].reshape(3, 3)
        before, after = (e / jnp.sqrt(e @ e) for e in (x1 - x0, x2 - x1))
        first, second = transport(p[6:9], p[:3], before), transport(p[9:12], p[3:6], after)
        carried = turned(transport(first, before, after), after, p[12])
        twist = q[10] - q[9] + p[12] + jnp.arctan2(after @ jnp.cross(carried, second), carried @ second)
        binormal = 2 * jnp.cross(before, after) / (1 + before @ after)
        m0, m1 = turned(first, before, q[9]), turned(second, after, q[10])
        one = 0.5 * binormal @ (jnp.cross(before, m0) + jnp.cross(after, m1)) - p[13]
        two = -0.5 * binormal @ (m0 + m1) - p[14]
        return 0.5 * p[16] * (one**2 + two**2) + 0.5 * p[17] * (twist - p[15]) ** 2

    return {"stretch": stretch, "bend_twist": bend_twist, "contact_hylc2020_5": contact}


def jax_microseconds(function: Callable, q: np.ndarray, p: np.ndarray, kind: str, check: np.ndarray) -> float:
    """Median time per element of value, value and gradient, or value, gradient and Hessian, 16 blocks at once."""
    import jax

    def everything(q, p):  # type: ignore[no-untyped-def]
        value, gradient = jax.value_and_grad(function)(q, p)
        return value, gradient, jax.hessian(function)(q, p)

    of_one = {"value": function, "gradient": jax.value_and_grad(function), "hessian": everything}[kind]
    compiled = jax.jit(jax.vmap(of_one))
    rows = [jax.numpy.asarray(np.tile(array.T, (16, 1))) for array in (q, p)]
    result = jax.block_until_ready(compiled(*rows))
    value = np.asarray(result if kind == "value" else result[0])
    np.testing.assert_allclose(value[:BLOCK], check, rtol=1e-9, atol=1e-12)
    times = []
    for _ in range(SAMPLES):
        start = time.perf_counter()
        jax.block_until_ready(compiled(*rows))
        times.append(time.perf_counter() - start)
    return 1e6 * float(np.median(times)) / len(rows[0])


def yarn_table(with_jax: bool) -> None:
    rule = ContactRule()
    contacts = [
        contact_energy(kernel, contact_samples(rule, polyline=polyline))
        for kernel in ("hylc2020", "est2022")
        for polyline in (True, False)
    ]
    beside = jax_functions() if with_jax else {}
    print(f"{'µs per element':28}{'operations':>12}{'kernel':>10}{'target':>10}{'JAX':>10}")
    for energy in (STRETCH, TWO_PHASE_STRETCH, BEND_TWIST, *contacts):
        q, p = elements(energy)
        value = np.empty((1, BLOCK))
        energy.value(BLOCK, BLOCK, q, p, value)
        for kind in KINDS:
            kernel = getattr(energy, kind)
            target = TARGETS.get((energy.name, kind))
            row = f"{energy.name + ', ' + kind:28}{kernel.operations:12}{microseconds(kernel, q, p):10.4f}"
            row += f"{target:10.2f}" if target else " " * 10
            if energy.name in beside:
                row += f"{jax_microseconds(beside[energy.name], q, p, kind, value[0]):10.3f}"
            print(row, flush=True)


def shell_table() -> None:
    """Cloth: kernels of the fundamental forms, and a whole linearisation with both Hessians."""
    from yarnscale.shell.elastic.energy import ShellEnergy
    from yarnscale.shell.elastic.strain import form_kernels
    from yarnscale.shell.materials.orthotropic import OrthotropicMaterial
    from yarnscale.shell.mesh import rectangle

    material = OrthotropicMaterial(
        60.0, 10.0, 50.0, 15.0, area=1.0, log_area=1.0, bend_weft=1e-5, bend_bias=8e-6, bend_warp=2e-5
    )
    mesh = rectangle(0.3, 0.3, 6e-3)
    energy = ShellEnergy(mesh, material)
    rest = np.column_stack([mesh.material, np.zeros(len(mesh.material))])
    x = rest * [1.05, 0.98, 1.0]
    x[:, 2] = 0.01 * np.sin(20 * rest[:, 0]) * np.cos(25 * rest[:, 1])
    triangles = len(mesh.triangles)
    kernels = form_kernels()
    positions = np.ascontiguousarray(x[energy.elements.stencils[0]].reshape(BLOCK, 18).T)
    geometry = np.ascontiguousarray(energy.elements.geometry[0])
    print(f"\n{'shell, µs per triangle':36}{'operations':>12}{'time':>10}")
    stress = np.ones((6, BLOCK))
    for name in ("value", "jacobian", "curvature"):
        kernel = getattr(kernels, name)
        inputs = (positions, geometry, stress) if name == "curvature" else (positions, geometry)
        print(f"{'forms, ' + name:36}{kernel.operations:12}{microseconds(kernel, *inputs):10.4f}")
    steps: dict[str, Callable[[], object]] = {
        "energy": lambda: energy.value(x),
        "linearisation": lambda: energy.linearise(x),
        "positive Hessian (6×6 projection)": lambda: energy.positive_hessian(line),
        "exact Hessian": lambda: energy.exact_hessian(line),
    }
    line = energy.linearise(x)
    for name, run in steps.items():
        run()
        times = []
        for _ in range(SAMPLES):
            start = time.perf_counter()
            run()
            times.append(time.perf_counter() - start)
        print(f"{name + ', assembled':36}{'':12}{1e6 * float(np.median(times)) / triangles:10.4f}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--jax", action="store_true", help="measure JAX beside (extra: benchmark)")
    parser.add_argument("--shell", action="store_true", help="also measure the kernels of cloth")
    options = parser.parse_args()
    yarn_table(options.jax)
    if options.shell:
        shell_table()


if __name__ == "__main__":
    main()
