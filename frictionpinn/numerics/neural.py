"""Integration of a system whose friction is a torch module."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np
import torch
from torchdiffeq import odeint

from ..errors import UserError
from ..physics import LAWS, System
from ..physics.mechanism import Mechanism
from .explicit import explicit_motion
from .paths import InputPath
from .simulation import ContactLost, Simulation, SimulationFailed, Steps

Friction = Callable[[torch.Tensor, torch.Tensor, torch.Tensor], torch.Tensor]
Inputs = InputPath | Mapping[str, np.ndarray]

_MAX_EVALUATIONS = 200_000
ADAPTIVE = ("dopri5", "dopri8", "bosh3", "fehlberg2", "adaptive_heun")


class _Rate(torch.nn.Module):
    """State rate of several trials at once: y (2 n_free, trials) -> y'."""

    def __init__(self, system: System, friction: Friction, paths: Sequence[InputPath]):
        super().__init__()
        self.system, self.friction = system, friction
        self.contact_of, self.accelerations_of = explicit_motion(system).torch
        self.values = [system.values[par.name] for par in system.parameters]
        self.t = paths[0].t
        self.coefficients = torch.from_numpy(np.stack([path.coefficients for path in paths], axis=-1))
        self.evaluations = 0
        self.lost: float | None = None

    def inputs(self, time: float) -> torch.Tensor:
        """u at one time, shape (n_u, trials)."""
        time = min(time, self.t[-1])  # the first trial step may reach past the end
        k = int(np.clip(np.searchsorted(self.t, time, side="right") - 1, 0, len(self.t) - 2))
        powers = torch.as_tensor((time - self.t[k]) ** np.arange(self.coefficients.shape[2]))
        return torch.einsum("udb,d->ub", self.coefficients[k], powers)

    def contact(self, y: torch.Tensor, u: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor, list]:
        """Slip velocity, normal force, friction force and accelerations, broadcast to the shape of a row of y or u."""
        known = [*y, *u, *self.values]
        like = torch.zeros(torch.broadcast_shapes(y.shape[1:], u.shape[1:]), dtype=torch.float64)
        v_slip, normal, frictionless = (like + value for value in self.contact_of(*known))
        force = self.friction(v_slip, normal, frictionless).to(torch.float64)
        return v_slip, normal, force, [like + a for a in self.accelerations_of(force, *known)]

    def forward(self, time: torch.Tensor, y: torch.Tensor) -> torch.Tensor:
        now = float(time)
        self.evaluations += 1
        _, normal, _, accelerations = self.contact(y, self.inputs(now))
        if self.lost is None and bool((normal <= 0).any()):
            self.lost = now
        rate = torch.cat([y[len(y) // 2 :], torch.stack(accelerations)])
        if not torch.isfinite(rate).all():
            raise SimulationFailed(now, "the state rate is not finite", "check the network's output there")
        if self.evaluations > _MAX_EVALUATIONS:
            raise SimulationFailed(
                now, f"more than {_MAX_EVALUATIONS} evaluations", "loosen rtol and atol, or smooth it"
            )
        return rate


def integrate_with_network(
    system: System,
    friction: Friction,
    t: np.ndarray,
    inputs: Inputs | Sequence[Inputs],
    y0: Mapping[str, float] | Sequence[Mapping[str, float]] | None = None,
    *,
    method: str = "dopri5",
    rtol: float = 1e-6,
    atol: float = 1e-8,
) -> Simulation | list[Simulation]:
    """Simulate a system with a memoryless friction model, several trials of equal times in one batch.

    The explicit equations of motion, solved for the accelerations with the friction force F as a symbol, are
    integrated by torchdiffeq in float64.

    Args:
        system: its normal force must not depend on the accelerations sought.
        friction: (slip velocity, normal force, frictionless slip acceleration) -> friction force, float64 tensors of
            shape (trials,), in the system's units.
        t: sample times, s, shape (n,), shared by the trials.
        inputs: path or samples of the driven coordinates and inputs, or a list with one per trial.
        y0: initial position and velocity by signal name, or a list with one per trial; at rest at 0 where not given.
        method, rtol, atol: as in ``torchdiffeq.odeint``; an explicit method.

    Returns:
        a :class:`Simulation`, or a list where ``inputs`` is a list; z and z' are zero.

    Raises:
        ContactLost: the normal force reaches zero.
        SimulationFailed: a value that is not finite, or too many steps.
        UserError: missing inputs, or a system of another kind.
    """
    mechanism = Mechanism(system, LAWS["coulomb"]())
    several = not isinstance(inputs, InputPath | Mapping)
    trials: list[Inputs] = list(inputs) if several else [inputs]  # type: ignore[arg-type, list-item]
    starts = list(y0) if isinstance(y0, Sequence) else [y0 or {}] * len(trials)
    paths = [item if isinstance(item, InputPath) else InputPath.from_signals(mechanism, t, item) for item in trials]
    names = [c.signals[0] for c in mechanism.free] + [c.signals[1] for c in mechanism.free]
    for name in {name for start in starts for name in start} - set(names):
        raise UserError("unknown state", where=f"y0.{name}", allowed=", ".join(names) or "none")
    start = torch.tensor([[float(item.get(name, 0.0)) for item in starts] for name in names], dtype=torch.float64)
    rate = _Rate(system, friction, paths)
    with torch.no_grad():
        times = torch.from_numpy(paths[0].t)
        states = _solve(rate, start, times, method, rtol, atol) if names else torch.zeros(len(times), 0, len(paths))
        results = [_result(rate, mechanism, path, states[:, :, j].T.double()) for j, path in enumerate(paths)]
    return results if several else results[0]


def _solve(rate: _Rate, start: torch.Tensor, t: torch.Tensor, method: str, rtol: float, atol: float) -> torch.Tensor:
    options = {"step_t": t[-1:]} if method in ADAPTIVE else None  # the inputs end there
    try:
        return odeint(rate, start, t, method=method, rtol=rtol, atol=atol, options=options)
    except (SimulationFailed, AssertionError) as error:  # torchdiffeq asserts that its step does not underflow
        if rate.lost is not None:
            raise ContactLost(rate.lost) from None
        if isinstance(error, SimulationFailed):
            raise
        raise SimulationFailed(float(t[0]), str(error), "loosen rtol and atol") from None


def _result(rate: _Rate, mechanism: Mechanism, path: InputPath, y: torch.Tensor) -> Simulation:
    """Everything at the samples of one trial, y (2 n_free, n)."""
    m, n = len(mechanism.free), len(path.t)
    v_slip, normal, force, accelerations = rate.contact(y, torch.from_numpy(path.samples.T.copy()))
    if not bool((normal > 0).all()):
        raise ContactLost(path.t[int(torch.argmin((normal > 0).int()))])
    if not bool(torch.isfinite(force).all()):
        raise SimulationFailed(path.t[0], "the friction force is not finite", "check the network's output")
    q, v = y[:m].numpy().T, y[m:].numpy().T
    a = torch.stack(accelerations).numpy().T if m else np.zeros((n, 0))
    signals = dict(path.signals)
    for j, c in enumerate(mechanism.free):
        signals.update(zip(c.signals, (q[:, j], v[:, j], a[:, j]), strict=True))
    zero, no_steps = np.zeros(n), Steps(np.empty(0, np.int64), np.empty((0, 2)), np.empty((0, 0, 0)))
    values = (v_slip.numpy(), normal.numpy(), force.numpy())
    return Simulation(path.t, q, v, a, zero, zero, *values, signals, no_steps)
