"""What every test of contact's derivatives checks."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from yarnscale.shell.contact.cloth_contact import ClothContact

Derivatives = Callable[[ClothContact, np.ndarray], tuple[np.ndarray, np.ndarray, np.ndarray]]


@pytest.fixture
def derivatives() -> Derivatives:
    """Gradient (n, 3), model of the Hessian and the Hessian by differences, each (3n, 3n), at positions (n, 3).

    Checked: the gradient against differences of the energy, the model's keys, and that it is positive semi-definite.
    """

    def checked(contact: ClothContact, positions: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        value, gradient = contact.gradient(positions)
        assert value == pytest.approx(contact.value(positions), rel=1e-12)
        step, size = 1e-9, positions.size
        numeric, rows = np.zeros(size), np.zeros((size, size))
        for i in range(size):
            change = np.zeros(size)
            change[i] = step
            change = change.reshape(positions.shape)
            up, down = contact.gradient(positions + change), contact.gradient(positions - change)
            numeric[i] = (up[0] - down[0]) / (2 * step)
            rows[i] = (up[1] - down[1]).ravel() / (2 * step)
        np.testing.assert_allclose(gradient.ravel(), numeric, atol=2e-5 * np.abs(gradient).max())
        keys, blocks = contact.hessian(positions)
        assert (np.diff(keys) > 0).all()
        column, row = np.divmod(keys, size // 3)
        assert (row >= column).all()
        whole = np.zeros((size // 3, 3, size // 3, 3))
        whole[row, :, column] = blocks.reshape(-1, 3, 3)
        whole[column, :, row] = blocks.reshape(-1, 3, 3).transpose(0, 2, 1)
        model = whole.reshape(size, size)
        assert np.linalg.eigvalsh(model)[0] > -1e-9 * np.abs(model).max()
        return gradient, model, rows

    return checked
