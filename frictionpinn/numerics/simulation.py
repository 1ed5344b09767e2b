"""The result of a simulation, and the two ways in which one ends early."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from ..errors import UserError
from ..physics.base import contact_of, place_of, plain_name


class ContactLost(UserError):
    """The normal force reached zero: the model of a contact that holds ends there.

    ``time`` is in s; ``steps`` tells how many the integrator took.
    """

    def __init__(self, time: float, steps: int = 0):
        self.time, self.steps = float(time), steps
        super().__init__(
            f"contact lost at t = {time:.4f} s",
            allowed="a normal force above 0 throughout",
            fix="reduce the motion that unloads the contact",
        )


class SimulationFailed(UserError):
    """The equations could not be solved at some time, ``time`` in s, after ``steps`` of the integrator."""

    def __init__(self, time: float, why: str, fix: str, steps: int = 0):
        self.time, self.steps = float(time), steps
        super().__init__(f"simulation failed at t = {time:.4f} s: {why}", fix=fix)


@dataclass(frozen=True)
class Steps:
    """The steps that a simulation took: to take them again with other parameters, or to differentiate them.

    Attributes:
        interval: index of the sample interval of each step, shape (steps,).
        size: offset in the interval and step size, s, shape (steps, 2).
        unknowns: accelerations of the free coordinates and z' of every stage, shape (steps, stages, n_w).
    """

    interval: np.ndarray
    size: np.ndarray
    unknowns: np.ndarray

    def __len__(self) -> int:
        return len(self.interval)


@dataclass(frozen=True)
class Simulation:
    """What a mechanism did.

    Attributes:
        t: sample times, s, shape (n,).
        q, v, a: position, velocity and acceleration of the free coordinates, shape (n, n_free), SI units.
        z, zdot: bristle state and its rate, shape (n,), in the system's unit of slip; zero for a law without memory.
        v_slip, N, F: slip velocity, normal force and friction force, shape (n,). With several contacts these and the
            bristle states have the shape (n, contacts), and :meth:`at` gives those of one.
        signals: name -> samples, shape (n,): free and driven coordinates and inputs, named as in a recording; as the
            sensors show them where an effect changes a sensor. The input of a massless system is the required force.
        steps: the integrator's steps.
        states, unknowns: what it solved for, at the samples: (q, v, states of effects, z) and their rates.
        sensitivity_names: what the sensitivities are taken with respect to, in order.
        sensitivities: name -> derivatives, shape (n, n_sens), of every signal of a free coordinate and of ``z``,
            ``zdot``, ``v_slip``, ``N`` and ``F`` (``hinge.F`` with several contacts), of a massless system's input
            too; empty where none were asked for.
        contacts: names of the contacts; one without a name where there is no other.
        required: force that an imposed motion requires, before its sensor, shape (n,); None where none is imposed.
    """

    t: np.ndarray
    q: np.ndarray
    v: np.ndarray
    a: np.ndarray
    z: np.ndarray
    zdot: np.ndarray
    v_slip: np.ndarray
    N: np.ndarray
    F: np.ndarray
    signals: dict[str, np.ndarray]
    steps: Steps
    states: np.ndarray = field(repr=False, default_factory=lambda: np.zeros((0, 0)))
    unknowns: np.ndarray = field(repr=False, default_factory=lambda: np.zeros((0, 0)))
    sensitivity_names: tuple[str, ...] = ()
    sensitivities: dict[str, np.ndarray] = field(default_factory=dict)
    contacts: tuple[str, ...] = ("",)
    required: np.ndarray | None = field(repr=False, default=None)

    def at(self, contact: str) -> Simulation:
        """What happened at one contact: slip velocity, forces and bristle state of shape (n,).

        Raises:
            UserError: there is no such contact.
        """
        k = place_of(contact, self.contacts)
        if len(self.contacts) == 1:
            return self
        own = {plain_name(name): x for name, x in self.sensitivities.items() if contact_of(name) == contact}
        values = {name: getattr(self, name)[:, k] for name in ("z", "zdot", "v_slip", "N", "F")}
        return replace(self, **values, sensitivities=self.sensitivities | own, contacts=(contact,))
