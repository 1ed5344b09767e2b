"""Compensation by what other parts of the package estimate: the online estimator's friction force, a network's."""

from __future__ import annotations

import importlib.util
from collections.abc import Sequence
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from ..errors import UserError
from ..export.portable import PortableModel
from ..online import OnlineEstimator
from ..online.check import check_above, check_least
from .compensator import STILL, Command, actuator
from .recursions import let_through


class EstimatorFeedback:
    """The friction force that an online estimator finds along the measured motion, with its bristle and parameters.

    The torque follows the estimate with the time constant ``smoothing`` and at the rate
    w = v_r^2 / (v_r^2 + still^2) of :class:`.compensator.Compensator`: where the reference rests it is held, and does
    no work over a closed path. It knows friction only once it acts, and a cycle takes a millisecond or more in Python;
    a :class:`.compensator.Compensator` foresees it and takes microseconds.

    Args:
        estimator: of one axis, tuned on readings at the controller's rate (:func:`.record.recorded`).
        interval: cycle, s.
        delay: from a command to its effect, s.
        limit: largest torque, in the unit of force.
        resolution: step of the encoder, in the unit of position.
        smoothing: s, above 0.

    Raises:
        UserError: an interval, limit, resolution or smoothing that is not above 0, a delay below 0.
    """

    def __init__(
        self,
        estimator: OnlineEstimator,
        *,
        interval: float = 1e-3,
        delay: float = 0.0,
        limit: float = 1e9,
        resolution: float = 1e-6,
        smoothing: float = 5e-3,
    ):
        given = {"interval": interval, "limit": limit, "resolution": resolution, "smoothing": smoothing}
        for name, value in given.items():
            check_above(name, value, 0.0)
        check_least("delay", delay)
        self.estimator, self._h, self._limit = estimator, interval, limit
        self._still, self._share, self._lag = STILL * resolution, 1 - np.exp(-interval / smoothing), delay / interval
        self._position = estimator.mechanism.free[0].signals[0]
        self._force = actuator(estimator.mechanism)
        self.reset()

    def reset(self) -> None:
        """Forget all cycles."""
        self.estimator.reset()
        self._cycle, self._torque, self._past = 0, 0.0, np.zeros(int(self._lag) + 2)

    def update(self, reference: Sequence[float], position: float, torque: float) -> Command:
        """One cycle, see :meth:`.compensator.Compensator.update`; the interval is the estimator's about the torque."""
        self._past = np.concatenate([[torque], self._past[:-1]])
        whole = int(self._lag)
        acted = self._past[whole] + (self._lag - whole) * (self._past[whole + 1] - self._past[whole])
        reading = self.estimator.update(self._cycle * self._h, {self._position: position, self._force: acted})
        self._cycle += 1
        if np.isfinite(reading.force):
            rate = let_through(float(reference[1]), self._still) * self._share
            wanted = self._torque + rate * (reading.force - self._torque)
            self._torque = float(np.clip(wanted, -self._limit, self._limit))
        reach = (reading.high - reading.low) / 2
        return Command(self._torque, self._torque - reach, self._torque + reach)


class NetworkFeedforward:
    """The friction force of a trained network along the reference.

    A network should see the motion alone (bb1, pe1, or others with ``model.inputs=[v_slip,normal_force]``). The
    frictionless acceleration a + F / m of bb2 and pe2 is measured in a recording; ahead of the motion it is known only
    with the force that the network gave in the cycle before, so what it learned from it comes back to it.

    Args:
        portable: a trained model of one axis whose slip is its coordinate.
        inertia: kg or kg m^2, with which a network that sees the frictionless acceleration is shown it.
        normal: normal force, in the system's unit.
        interval: cycle, s; a whole number of cycles is the interval of the training data.
        limit: largest torque, in the unit of force.

    Raises:
        UserError: an inertia, normal force, interval or limit that is not above 0; an interval that is no whole part of
            that of the training data.
    """

    def __init__(
        self, portable: PortableModel, *, inertia: float, normal: float, interval: float = 1e-3, limit: float = 1e9
    ):
        from ..export.mujoco_model import describe, law_module

        for name, value in {"inertia": inertia, "normal": normal, "interval": interval, "limit": limit}.items():
            check_above(name, value, 0.0)
        self._module: Any = _model_code()
        if portable.law is not None:
            law = ModuleType("friction_law")
            exec(law_module(portable.law), law.__dict__)  # generated from the equations, as in an export
            self._module.__dict__["friction_law"] = law
        self._inertia, self._normal, self._limit, self._interval = inertia, normal, limit, interval
        self._description = describe(portable)
        self.reset()

    def reset(self) -> None:
        """Forget all cycles."""
        try:
            self._network: Any = self._module.Network(self._description, self._interval)
        except ValueError as error:
            raise UserError("a network of another rate", where="interval", received=self._interval,
                            allowed=str(error)) from error  # fmt: skip
        self._force = 0.0

    def update(self, reference: Sequence[float], position: float, torque: float) -> Command:
        """One cycle, see :meth:`.compensator.Compensator.update`; a network tells no interval: low and high are NaN."""
        free = reference[2] + self._force / self._inertia
        now = {"v_slip": reference[1], "a_slip": reference[2], "normal_force": self._normal, "a_frictionless": free}
        self._force = float(np.clip(self._network.force(now), -self._limit, self._limit))
        self._network.keep(now)
        return Command(self._force, np.nan, np.nan)


def _model_code() -> ModuleType:
    """The exported network's code, a module of its own for every compensator."""
    path = Path(__file__).parents[1] / "export" / "templates" / "friction_model.py"
    spec = importlib.util.spec_from_file_location("frictionpinn_exported_network", path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module
