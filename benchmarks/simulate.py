"""Accuracy and speed of the simulator on six pendulum-on-a-box trials, against scipy's solvers.

Reference: Radau, rtol 1e-10, atol 1e-12. Peer: LSODA on the same equations, lambdified to scalar functions of
numpy and of math, fed the analytic swing, at the loosest rtol whose velocity is within 2e-5 m/s of the reference.
Run as ``python benchmarks/simulate.py``; the table also goes to ``benchmarks/results/simulate.txt``.
"""

from __future__ import annotations

import platform
import time
from pathlib import Path

import numba
import numpy as np
import scipy
import sympy as sp
from scipy.integrate import solve_ivp

from frictionpinn.numerics.paths import InputPath
from frictionpinn.numerics.simulate import Simulator
from frictionpinn.physics import CONTACT, LAWS, SYSTEMS
from frictionpinn.physics.mechanism import Mechanism
from frictionpinn.physics.system import TIME

TRUTH = {"sigma_0": 1e5, "sigma_1": 316.23, "sigma_2": 0.4, "mu_c": 0.3, "mu_s": 0.6, "v_s": 1e-3, "alpha": 2.0}
RATE, TARGET, REPEATS = 400, 2e-5, 15
LOOSE = {"rtol": 1e-4, "atol": 1e-5}
W = 2 * sp.pi * sp.Rational(9, 10)
SWINGS = [(sp.rad(a) * sp.sin(2 * sp.pi * TIME), 2.0) for a in (35, 42.5, 50, 57.5, 65)]
SWINGS.append((sp.rad(45) * sp.sin(W * TIME + 0.45 * sp.sin(W * TIME)), 4.5))
TIMES = [np.arange(round(duration * RATE) + 1) / RATE for _, duration in SWINGS]


def explicit_rate(mechanism: Mechanism, swing: sp.Expr, module: str):
    """(t, y) -> y' with y = (x, v, z): the equations solved for a and z', as scalar functions of numpy or math."""
    (x, v, a), z, zdot = mechanism.free[0].symbols, CONTACT.z, CONTACT.zdot
    rows = sp.Matrix(mechanism.residuals)
    solution = rows.jacobian([a, zdot]).LUsolve(-rows.subs({a: 0, zdot: 0}))
    values = {par.symbol: TRUTH.get(par.name, mechanism.system.values.get(par.name)) for par in mechanism.parameters}
    motion = {symbol: sp.diff(swing, TIME, order) for order, symbol in enumerate(mechanism.driven[0].symbols)}
    motion = {symbol: expr.evalf() for symbol, expr in motion.items()}
    expressions = list(solution.subs(values).subs(motion))
    function = sp.lambdify([TIME, x, v, z], expressions, module, cse=True)

    def rate(t, y):
        x, v, z = y.tolist()
        return (v, *function(t, x, v, z))

    return rate


def run_scipy(rates, method: str, rtol: float, atol: float, **options) -> list[np.ndarray]:
    """States (n, 3) of the six trials."""
    start = np.zeros(3)
    return [
        solve_ivp(rate, (t[0], t[-1]), start, method, t, rtol=rtol, atol=atol, **options).y.T
        for rate, t in zip(rates, TIMES, strict=True)
    ]


def error(states: list[np.ndarray], reference: list[np.ndarray], column: int) -> float:
    """Largest absolute difference of one state over all trials."""
    return max(float(np.abs(s[:, column] - r[:, column]).max()) for s, r in zip(states, reference, strict=True))


def timed(function) -> float:
    """CPU time of one call, ms."""
    start = time.process_time()
    function()
    return 1e3 * (time.process_time() - start)


def loosest_lsoda(rates, reference) -> tuple[float, float]:
    """(rtol, error) of LSODA with the loosest rtol of three a decade that meets the target; atol is rtol / 100."""
    for exponent in np.arange(-3, -12, -1 / 3):
        rtol = float(10.0**exponent)
        found = error(run_scipy(rates, "LSODA", rtol, rtol / 100), reference, 1)
        if found < TARGET:
            return rtol, found
    raise SystemExit("LSODA did not reach the target")


def main() -> None:
    mechanism = Mechanism(SYSTEMS["pob"](), LAWS["lugre"]())
    start = time.perf_counter()
    simulator = Simulator(mechanism)
    rates = [explicit_rate(mechanism, swing, "math") for swing, _ in SWINGS]
    numpy_rates = [explicit_rate(mechanism, swing, "numpy") for swing, _ in SWINGS]
    paths = [InputPath.from_expressions(mechanism, t, {"theta": s}) for (s, _), t in zip(SWINGS, TIMES, strict=True)]
    states = (*(f"{name}(0)" for name in simulator.state_names),)
    names = [*simulator.parameter_names, *states]
    simulator.simulate(TIMES[0], paths[0], TRUTH, sensitivities=names)
    ready = time.perf_counter() - start

    def ours(sensitivities=(), **tolerances):
        return [simulator.simulate(path.t, path, TRUTH, sensitivities=sensitivities, **tolerances) for path in paths]

    def found(results):
        return [np.column_stack([result.q, result.v, result.z]) for result in results]

    reference = run_scipy(rates, "Radau", 1e-10, 1e-12, max_step=1 / RATE)
    results, loose = ours(), ours(**LOOSE)
    rtol, lsoda_error = loosest_lsoda(rates, reference)
    runs = {
        "frictionpinn, default": ours,
        "frictionpinn, as accurate as LSODA": lambda: ours(**LOOSE),
        f"frictionpinn, {len(names)} sensitivities": lambda: ours(names),
        "LSODA, scalar numpy functions": lambda: run_scipy(numpy_rates, "LSODA", rtol, rtol / 100),
        "LSODA, scalar math functions": lambda: run_scipy(rates, "LSODA", rtol, rtol / 100),
    }
    times = np.array([[timed(run) for run in runs.values()] for _ in range(REPEATS)])
    errors = [error(found(results), reference, 1), error(found(loose), reference, 1)]
    errors += [error(found(ours(names)), reference, 1), lsoda_error, lsoda_error]
    samples = sum(map(len, TIMES))
    lines = [
        f"Simulator on six pendulum-on-a-box trials with LuGre friction: {samples} samples, {samples / RATE:.1f} s",
        f"Python {platform.python_version()}, numba {numba.__version__}, scipy {scipy.__version__}, one thread",
        f"CPU times, median of {REPEATS} rounds; ratios are medians within a round; errors against Radau, rtol 1e-10",
        f"LSODA: rtol {rtol:.1e}, atol rtol / 100, the loosest within {TARGET:.0e} m/s; as accurate: {LOOSE}",
        "",
        f"{'':36s}{'ms':>8s}{'times default':>16s}{'times as accurate':>20s}{'error in v, m/s':>18s}",
    ]
    for name, column, worst in zip(runs, times.T, errors, strict=True):
        ratios = np.median(column / times[:, 0]), np.median(column / times[:, 1])
        lines.append(f"{name:36s}{np.median(column):8.1f}{ratios[0]:16.1f}{ratios[1]:20.1f}{worst:18.1e}")
    lines += [
        "",
        f"default: error in x {error(found(results), reference, 0):.1e} m, "
        f"in z {error(found(results), reference, 2):.1e} m; {sum(len(result.steps) for result in results)} steps, "
        f"{1e3 * np.median(times[:, 0]) / samples:.2f} us a sample",
        f"equations, compiled code and a first trial ready after {ready:.1f} s",
    ]
    text = "\n".join(lines)
    print(text)
    folder = Path(__file__).parent / "results"
    folder.mkdir(exist_ok=True)
    (folder / "simulate.txt").write_text(text + "\n")


if __name__ == "__main__":
    main()
