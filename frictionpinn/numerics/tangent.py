"""Sensitivities of one motion to the strengths of an effect, at many of its shapes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property

import numpy as np

from .codegen import pointer
from .differentiate import Wanted, named, start_sensitivity, wanted_outputs
from .directions import Directions
from .paths import InputPath
from .simulate import Simulator, Values
from .simulation import Simulation
from .tableau import METHOD


class Tangent:
    """The linear equations along a strict simulation, solved once, for whatever drives them.

    In a stage of the integrator R_s S + R_w W = -R_c for a quantity c, where neither R_s nor R_w depend on what c is:
    they are evaluated and factored once. At its neutral strengths an effect leaves the motion as it is, whatever its
    shape; so each shape costs but its own R_c, and linear algebra.

    Args:
        simulator: that the run is of.
        run: a strict simulation.
        inputs: its input path.
        p: its parameters, see :meth:`Simulator.parameters`.
        steady: whether the initial bristle states were "steady", or the names of those that were.
    """

    def __init__(
        self,
        simulator: Simulator,
        run: Simulation,
        inputs: InputPath,
        p: Values,
        *,
        steady: bool | Sequence[str] = True,
    ):
        self.simulator, self.run, self.inputs, self.steady = simulator, run, inputs, simulator.settled(steady)
        self.p = simulator.parameters(p)
        self.path = simulator.acting(inputs, self.p)

    @staticmethod
    def answers(simulator: Simulator, strengths: Sequence[str]) -> bool:
        """Whether it tells the sensitivities to these: they act in the equations, not in a sensor or by a delay."""
        return bool(simulator.kernels.sizes[1]) and not simulator.outside & set(strengths)

    @cached_property
    def _linear(self) -> tuple[np.ndarray, ...]:
        from . import tangent_recursions  # compiles on a new installation: not before it is needed

        run, m = self.run, len(self.simulator.mechanism.free)
        kernel, coefficients = pointer(self.simulator.kernels.plain.newton), self.path.coefficients
        steps = run.steps.interval, run.steps.size, run.steps.unknowns
        return tangent_recursions.linearise(
            kernel, METHOD.a, METHOD.c, coefficients, self.p, m, run.states[0], run.unknowns[0], *steps
        )

    def respond(
        self, strengths: Sequence[str], shapes: Sequence[Mapping[str, float]], contact: bool = True
    ) -> dict[str, np.ndarray]:
        """Sensitivities to the strengths at each of the shapes.

        Args:
            strengths: parameters at their neutral values, see :meth:`answers`.
            shapes: values of hidden parameters of their effect, which has no state of its own.
            contact: see :meth:`Simulator.simulate`.

        Returns:
            signal -> derivatives, shape (n, shapes * strengths), the strengths of a shape side by side.
        """
        from . import sensitivity, tangent_recursions

        simulator, run, k = self.simulator, self.run, len(strengths)
        kernels, m, n = simulator.kernels, len(simulator.mechanism.free), len(self.path.t)
        at = {name: i for i, name in enumerate(simulator.parameter_names)}
        values = np.repeat(self.p[None], len(shapes), axis=0)
        for row, shape in zip(values, shapes, strict=True):
            row[[at[name] for name in shape]] = list(shape.values())
        kernel = pointer(kernels.strengths(tuple(strengths)))
        columns = np.array([at[name] for name in strengths], dtype=np.int64)
        start = self._start(tuple(strengths), columns, values)
        S, W, U, factors, pivots, rows = self._linear
        ds, dw = tangent_recursions.respond(
            kernel, METHOD.a, n, m, S, W, U, factors, pivots, rows, values, k, start,
            run.steps.interval, run.steps.size, kernels.outputs,
        )  # fmt: skip
        which, outputs = wanted_outputs(kernels, contact), np.zeros((0, n, start.shape[1]))
        if len(which):
            none = Directions.of({}, self.inputs)
            nowhere, put = np.full(start.shape[1], -1, dtype=np.int64), np.arange(start.shape[1])
            outputs = sensitivity.output_sensitivities(
                pointer(kernels.sensitivity.output_derivatives), run.states, run.unknowns, self.path.samples, self.p,
                ds, dw, nowhere, put, none.samples, none.support, which, kernels.outputs,
            )  # fmt: skip
            outputs += tangent_recursions.direct(
                kernel, run.states, run.unknowns, self.path.samples, values, k, which, kernels.outputs
            )
        return simulator.shown(run, self.inputs, self.p, named(kernels, ds, dw, which, outputs), ())

    def _start(self, strengths: tuple[str, ...], columns: np.ndarray, values: np.ndarray) -> np.ndarray:
        """Derivative of the initial state, shape (n_s, shapes * strengths): 0 but where a state starts at rest."""
        kernels, run, k = self.simulator.kernels, self.run, len(strengths)
        start = np.zeros((kernels.sizes[0], k * len(values)))
        if self.steady.any() or kernels.settles(strengths):
            none = Directions.of({}, self.inputs)
            wanted = Wanted(strengths, columns, np.full(k, -1, dtype=np.int64), none)
            u = self.path.coefficients[0, :, 0]
            for j, p in enumerate(values):
                start[:, j * k : (j + 1) * k] = start_sensitivity(kernels, u, p, run.states[0], wanted, self.steady)
        return start
