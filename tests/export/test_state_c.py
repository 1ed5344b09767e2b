"""A network with memory in C gives what it gives here."""

from __future__ import annotations

import ctypes
import shutil
import subprocess

import numpy as np
import pytest

from frictionpinn.export.state_c import write_state_c
from frictionpinn.models.elements import StateFriction
from frictionpinn.physics import SYSTEMS

pytestmark = pytest.mark.skipif(shutil.which("cc") is None, reason="needs a C compiler, cc")


class Trained:
    """A map with random numbers, as a trained model hands it out."""

    hparams = {"name": "bb2"}  # noqa: RUF012

    def friction(self) -> StateFriction:
        rng = np.random.default_rng(0)
        tables = 1e-3 * np.exp(rng.standard_normal((3, 17, 3)))
        rows = np.array([[500.0, 300.0], [50.0, 4.0], [0.0, 0.002], [1.0, 2.3]])
        return StateFriction(tables, np.array([0.01, -4.0, 0.5, 8.0, 2.0]), rows)


def test_force_and_rates_are_those_of_the_model(tmp_path):
    assert write_state_c(tmp_path, Trained(), SYSTEMS["pob"]()) == ["friction.h", "friction.c"]  # type: ignore[arg-type]
    flags = ["-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic", "-O2", "-shared", "-fPIC", "-o", "friction.so"]
    done = subprocess.run(
        ["cc", *flags, "friction.c", "-lm"], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    library, model = ctypes.CDLL(str(tmp_path / "friction.so")), Trained().friction()
    pair = ctypes.c_double * 2
    for call, kinds in ((library.friction_rates, [ctypes.c_double] * 2 + [pair, pair]),
                        (library.friction_step, [pair] + [ctypes.c_double] * 3)):  # fmt: skip
        call.restype, call.argtypes = ctypes.c_double, kinds
    rng, z, own = np.random.default_rng(1), np.zeros(2), pair(0.0, 0.0)
    for _ in range(300):
        v, N, rate = float(rng.normal(0, 0.3)), float(rng.uniform(6, 14)), pair()
        expected = model.rates(v, N, np.array(list(own)))
        assert library.friction_rates(v, N, own, rate) == pytest.approx(expected[0], rel=1e-9, abs=1e-12)
        np.testing.assert_allclose(list(rate), expected[1:], rtol=1e-9, atol=1e-12)
        force = library.friction_step(own, v, N, 1e-3)
        z = np.array(list(own))
        assert force == pytest.approx(model.rates(v, N, z)[0], rel=1e-9, abs=1e-12)
    assert np.abs(z).max() > 0
