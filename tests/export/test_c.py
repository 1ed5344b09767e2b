"""C99: it compiles without a warning and gives what the model and the simulator give."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from frictionpinn.evaluate.in_simulation import simulate_model
from frictionpinn.evaluate.yardsticks import simulated_law
from frictionpinn.export.c_code import write_law_c
from frictionpinn.numerics.torch_functions import numpy_function
from frictionpinn.physics import CONTACT, LAWS, SYSTEMS

FLAGS = ["-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic", "-O2"]
PARAMETERS = {"sigma_0": 1e5, "sigma_1": 300.0, "sigma_2": 0.4, "mu_c": 0.3, "mu_s": 0.6, "v_s": 1e-3}
PARAMETERS |= {"alpha": 2.0, "v_t": 1e-4, "tied_inertia": 1.0}
pytestmark = pytest.mark.skipif(shutil.which("cc") is None, reason="needs a C compiler, cc")


def compiled(folder: Path, *options: str) -> None:
    done = subprocess.run(["cc", *FLAGS, *options, "-lm"], cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def library(folder: Path) -> ctypes.CDLL:
    compiled(folder, "-shared", "-fPIC", "-o", "friction.so", "friction.c")
    return ctypes.CDLL(str(folder / "friction.so"))


@pytest.fixture(scope="module")
def laws(tmp_path_factory) -> dict:
    """Every law as a compiled library and its parameters as the C struct."""
    made = {}
    for name, kind in LAWS.items():
        folder = tmp_path_factory.mktemp(name)
        law = kind()
        write_law_c(folder, law, PARAMETERS, SYSTEMS["pob"]())
        values = (ctypes.c_double * len(law.parameters))(*(PARAMETERS[par.name] for par in law.parameters))
        made[name] = law, library(folder), values
    return made


def function(lib: ctypes.CDLL, name: str, count: int):
    call = getattr(lib, f"friction_law_{name}")
    call.restype, call.argtypes = ctypes.c_double, [ctypes.c_void_p, *[ctypes.c_double] * count]
    return call


def test_a_law_of_ones_own_is_written_with_the_letters_that_its_text_has(tmp_path):
    class Own(LAWS["coulomb_viscous"]):
        """F = µ N sign(v) + d v, with Müller’s µ."""

    write_law_c(tmp_path, Own(), PARAMETERS, SYSTEMS["pob"]())
    compiled(tmp_path, "-c", "friction.c")
    assert "F = µ N sign(v) + d v, with Müller’s µ." in (tmp_path / "friction.h").read_text(encoding="utf-8")


SPEED = st.floats(-2, 2) | st.floats(-2e-3, 2e-3)


@pytest.mark.parametrize("name", LAWS)
@settings(max_examples=50, deadline=None)
@given(v=SPEED, N=st.floats(0.1, 50), z=st.floats(-1e-4, 1e-4), zdot=SPEED)
def test_every_law_in_c_equals_its_equations(laws, name, v, N, z, zdot):
    law, lib, values = laws[name]
    symbols = [CONTACT.v, CONTACT.N, CONTACT.z, CONTACT.zdot, *(par.symbol for par in law.parameters)]
    ours = numpy_function(symbols, law.force(CONTACT, law.symbols))(v, N, z, zdot, *values)
    assert function(lib, "force", 4)(values, v, N, z, zdot) == pytest.approx(ours, rel=1e-10, abs=1e-12)
    if law.memory:
        ours = numpy_function(symbols, law.bristle_rate(CONTACT, law.symbols))(v, N, z, zdot, *values)
        assert function(lib, "bristle_rate", 3)(values, v, N, z) == pytest.approx(ours, rel=1e-10, abs=1e-12)


@pytest.mark.parametrize("name", [name for name, law in LAWS.items() if law.memory])
@pytest.mark.parametrize("v", [0.0, 2e-5, -1e-3, 1.5])
def test_the_bristles_update_is_exact_at_constant_velocity_and_stable(laws, name, v):
    _, lib, values = laws[name]
    step = lib.friction_law_step
    step.restype = ctypes.c_double
    step.argtypes = [ctypes.c_void_p, ctypes.POINTER(ctypes.c_double), *[ctypes.c_double] * 3]
    rate = function(lib, "bristle_rate", 3)
    z = ctypes.c_double(3e-5)
    force = step(values, ctypes.byref(z), v, 10.0, 1e-3)
    exact = solve_ivp(lambda _, s: [rate(values, v, 10.0, s[0])], (0, 1e-3), [3e-5], "Radau", rtol=1e-10, atol=1e-14)
    assert z.value == pytest.approx(exact.y[0, -1], rel=1e-6)
    assert force == function(lib, "force", 4)(values, v, 10.0, z.value, rate(values, v, 10.0, z.value))
    for _ in range(100):
        force = step(values, ctypes.byref(z), v, 10.0, 0.1)
    assert abs(force) <= 10.0 * 0.6 + 0.4 * abs(v) + 1e-6


@pytest.mark.parametrize("name", ["pe2", "bb1"])
def test_the_network_in_c_predicts_a_trial_as_the_model_does(exported, name):
    run = exported(name)
    lib, portable = library(run.file("c", "friction.c").parent), run.portable
    fields = [*portable.signals, *(f"{signal}_rate" for signal in portable.signals if portable.estimator)]
    lib.friction_network_step.restype = ctypes.c_double
    state = ctypes.create_string_buffer(16 + 8 * portable.length * len(fields))
    lib.friction_network_reset(state)
    signals = run.trial.online | {f"{signal}_rate": rate for signal, rate in run.trial.rates.items()}
    rows = np.stack([signals[field] for field in fields], axis=1)
    force = [lib.friction_network_step(state, (ctypes.c_double * len(fields))(*row)) for row in rows]
    expected = run.model.predict_trial(run.trial)["force"]
    assert force == pytest.approx(expected, abs=1e-4 * np.abs(expected).max())


def test_a_network_in_c_that_runs_for_months_counts_no_further_than_its_windows_see(exported):
    run = exported("pe2")
    lib, kept = library(run.file("c", "friction.c").parent), run.portable.length - 1
    fields = range(2 * len(run.portable.signals))  # and their rates
    lib.friction_network_step.restype = ctypes.c_double
    rows = np.random.default_rng(0).normal(size=(7 * kept + 3, len(fields)))

    def after(rows: np.ndarray) -> tuple[float, int]:
        state = ctypes.create_string_buffer(16 + 8 * (kept + 1) * len(fields))
        lib.friction_network_reset(state)
        force = [lib.friction_network_step(state, (ctypes.c_double * len(fields))(*row)) for row in rows]
        return force[-1], ctypes.c_long.from_buffer(state).value

    force, count = after(rows)
    assert count < 2 * kept  # a long of 32 bits would be over in 25 days of cycles of 1 ms
    assert force == after(rows[-kept - 1 :])[0]


EVEN, SKEWED = "45*deg*sin(2*pi*t)", "45*deg*sin(5.65*t - 0.45*sin(5.65*t))"  # the second begins with a rising load
CASES = [("pe2", "law", EVEN), ("pe2", "network", EVEN), ("pe2", "network", SKEWED), ("bb1", "network", EVEN)]


@pytest.mark.parametrize(("name", "kind", "theta"), CASES)
def test_the_program_reproduces_our_simulation_within_one_percent_of_the_force(exported, swing, name, kind, theta):
    run, stride = exported(name), 32
    folder = run.file("c", "simulate.c").parent
    compiled(folder, f"-DFRICTION_STRIDE={stride}", "-o", "simulate", "simulate.c", "friction.c")
    path = swing(run.system, theta)
    times = np.arange((len(path.t) - 1) * stride + 1) / (200 * stride)
    given = "\n".join(",".join(repr(float(value)) for value in path(time)) for time in times)
    done = subprocess.run(["./simulate", kind], cwd=folder, input=given, capture_output=True, text=True, check=True)
    force = np.loadtxt(done.stdout.splitlines(), delimiter=",")[::stride, -1]
    if kind == "law":
        own = simulated_law(run.system, "lugre", run.model.physical())(path, {}).F
    else:
        own = simulate_model(run.system, run.model, path, {}, 4).F
    assert run.force_error(force, own) < 0.01
    for wrong in ("0,0,0\n0,0,0,0\n", "0,0,0,0\n0,0,x,0\n", "0,0,0,nan\n"):  # three columns, a word, no number
        done = subprocess.run(
            ["./simulate", kind], cwd=folder, input=wrong, capture_output=True, text=True, check=False
        )
        assert done.returncode == 2 and "of the input does not hold 4 finite numbers" in done.stderr


@pytest.mark.parametrize("name", [name for name, law in LAWS.items() if law.memory])
def test_a_lift_off_or_a_sample_that_is_no_number_does_not_end_a_bristle(laws, name):
    _, lib, values = laws[name]
    step = lib.friction_law_step
    step.restype, step.argtypes = (
        ctypes.c_double,
        [ctypes.c_void_p, ctypes.POINTER(ctypes.c_double), *[ctypes.c_double] * 3],
    )
    z = ctypes.c_double(0.0)
    sliding = [step(values, ctypes.byref(z), 0.05, 15.0, 1e-3) for _ in range(200)][-1]
    kept = z.value
    step(values, ctypes.byref(z), float("nan"), 15.0, 1e-3)
    assert z.value == kept
    assert step(values, ctypes.byref(z), 0.05, 0.0, 1e-3) == 0.0 == z.value
    assert [step(values, ctypes.byref(z), 0.05, 15.0, 1e-3) for _ in range(200)][-1] == pytest.approx(sliding)
