"""Every mechanism with parameters and a path of its driven coordinates, for the tests of the simulator."""

from functools import cache

import numpy as np
import sympy as sp
from scipy.integrate import solve_ivp
from short_paths import LAW_VALUES, PATHS, TRUTH, T

from frictionpinn.numerics.directions import Directions
from frictionpinn.numerics.paths import DEGREE, InputPath
from frictionpinn.numerics.simulate import Simulator
from frictionpinn.physics import LAWS, SYSTEMS
from frictionpinn.physics.contacts import by_parameter
from frictionpinn.physics.mechanism import Mechanism
from frictionpinn.physics.system import TIME


@cache
def simulator(system, law, driven=None, effects=()):
    return Simulator(Mechanism(SYSTEMS[system](driven=driven), LAWS[law](), effects))


def values(law, **changed):
    return {par.name: LAW_VALUES[par.name] for par in LAWS[law].parameters} | changed


def all_values(sim, **changed):
    """Values of the law's parameters at every contact, those of the system's own file where it has some."""
    law = sim.mechanism.law
    own = by_parameter(TRUTH.get(sim.mechanism.system.name, {}), law)
    return {par.name: own.get(par.name, LAW_VALUES[par.name.rpartition(".")[2]]) for par in law.parameters} | changed


def path(sim, t=T, expressions=None):
    return InputPath.from_expressions(sim.mechanism, t, expressions or PATHS[sim.mechanism.system.name])


def radau(mechanism, p, expressions, t, y0):
    """Reference state, shape (n_s, n): the implicit equations solved for w in every call of Radau."""
    free, bristles = mechanism.free, mechanism.bristles
    unknown = [c.symbols[2] for c in free] + [contact.zdot for contact in bristles]
    state = [c.symbols[0] for c in free] + [c.symbols[1] for c in free] + [contact.z for contact in bristles]
    given = {}
    for coordinate in mechanism.driven:
        for order, symbol in enumerate(coordinate.symbols):
            given[symbol] = sp.diff(expressions[coordinate.signals[0]], TIME, order)
    given |= {item.symbol: expressions.get(item.name, 0) for item in mechanism.system.inputs}
    given |= {par.symbol: p.get(par.name, mechanism.system.values.get(par.name)) for par in mechanism.parameters}
    given = {symbol: sp.sympify(value) for symbol, value in given.items()}
    rows = sp.Matrix(mechanism.residuals).subs(given)
    function = sp.lambdify([TIME, state, unknown], [list(rows), rows.jacobian(unknown).tolist()], "math", cse=True)

    def rate(t, y):
        w = np.zeros(len(unknown))
        for _ in range(4):
            residual, jacobian = function(t, y, w)
            w = w - np.linalg.solve(np.array(jacobian, float), np.array(residual, float))
        return w

    m = len(free)
    solution = solve_ivp(
        lambda t, y: [*y[m : 2 * m], *rate(t, y)], (t[0], t[-1]), y0, "Radau", t, rtol=1e-9, atol=1e-11, max_step=2e-3
    )
    return solution.y


def coefficient_paths(names, t, splines):
    """Each coefficient of some splines (name, inputs and basis of each) as a path of its own, by its name."""
    paths = {}
    for name, columns, basis in splines:
        for j in range(basis.size):
            coefficients = np.zeros((len(t) - 1, len(names), DEGREE + 1))
            coefficients[:, columns] = basis.path(np.eye(basis.size)[j])
            paths[f"{name}[{j}]"] = InputPath(names, t, coefficients)
    return paths


def check_answers(sim, inputs, p, splines, tolerance):
    """A motion answers to the coefficients of splines together as it does to the path of each."""
    t = inputs.t
    together, each = (Directions.of_splines(t, len(inputs.names), splines), coefficient_paths(inputs.names, t, splines))
    told, expected = (
        sim.simulate(t, inputs, p, sensitivities=["mu_c"], directions=own).sensitivities for own in (together, each)
    )
    for signal, own in expected.items():
        assert np.abs(told[signal] - own).max() <= tolerance * np.abs(own).max(), signal
