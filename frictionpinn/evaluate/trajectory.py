"""Errors on one trajectory: online from noisy causal signals, and in simulation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from ..data.contact import ContactTrial
from ..data.recording import Trial
from ..numerics.paths import InputPath
from ..numerics.simulation import ContactLost, Simulation, SimulationFailed
from ..physics import LAWS, System
from ..physics.base import contact_of, plain_name
from ..physics.mechanism import Mechanism
from ..progress import Steps
from .style import squared
from .yardsticks import Candidate


@dataclass(frozen=True)
class Trajectory:
    """A trial with the friction force to compare with, and what sensors made of it.

    Attributes:
        clean: signals without noise (of a measurement: smoothed); ``truth`` holds friction_force, normal_force and
            v_slip (of a measurement: those that the equation of motion implies).
        seen: seed of the noise -> contact of the noisy trial, filtered causally.
        reference: what the force is compared with, in words.
        whole: of one of several contacts (:meth:`at`): the trajectory with all of them.
    """

    system: System
    clean: Trial
    seen: dict[int, ContactTrial] = field(default_factory=dict)
    reference: str = "truth"
    whole: Trajectory | None = None

    def at(self, contact: str) -> Trajectory:
        """The trajectory as one contact sees it, with its name after the trajectory's."""
        if not contact:
            return self
        truth = {plain_name(name): x for name, x in self.clean.truth.items() if contact_of(name) == contact}
        clean = replace(self.clean, name=f"{self.name}, {contact}", truth=truth)
        seen = {seed: trial.at(contact) for seed, trial in self.seen.items()}
        return replace(self, system=self.system.at(contact), clean=clean, seen=seen, whole=self)

    @property
    def name(self) -> str:
        return self.clean.name

    @property
    def force(self) -> np.ndarray:
        """Friction force to compare with, shape (n,)."""
        return self.clean.truth["friction_force"]

    @cached_property
    def mechanism(self) -> Mechanism:
        """The system alone matters: which coordinates are free and which are driven."""
        return Mechanism(self.system.whole, LAWS["coulomb"]())

    @cached_property
    def path(self) -> InputPath:
        """Driven coordinates and inputs, without noise."""
        if self.whole is not None:
            return self.whole.path
        return InputPath.from_signals(self.mechanism, self.clean.t, self.clean.signals)

    @property
    def start(self) -> dict[str, float]:
        """Initial positions and velocities of the free coordinates."""
        names = [name for c in self.mechanism.free for name in c.signals[:2]]
        return {name: float(self.clean.signals[name][0]) for name in names}

    def describe(self) -> dict[str, Any]:
        """Duration, rate, how far the contact slides in the end and how long it rests."""
        t, slip = self.clean.t, self.clean.truth["v_slip"]
        typical = float(np.sqrt(np.mean(slip**2)))
        return {
            "duration": {"value": float(t[-1] - t[0]), "unit": "s"},
            "samples": len(t),
            "displacement": {"value": float(np.trapezoid(slip, t)), "unit": self.system.slip_unit},
            "at_rest": {"value": float(np.mean(np.abs(slip) < 0.01 * typical)), "unit": "1"},
        }


def online_error(candidate: Candidate, trajectory: Trajectory) -> dict[str, Any]:
    """Mean square error of the force for every seed of the noise, and its median."""
    assert candidate.online is not None
    by_seed = {
        str(seed): float(np.mean((candidate.online(trial) - trajectory.force) ** 2))
        for seed, trial in trajectory.seen.items()
    }
    if not np.isfinite(list(by_seed.values())).all():
        return {"failed": "no force satisfies the equation of motion"}
    unit = squared(trajectory.system.force_unit)
    told: dict[str, Any] = {
        "force_mse": {"value": float(np.median(list(by_seed.values()))), "unit": unit, "by_seed": by_seed}
    }
    if candidate.interval is not None:
        inside = [_covered(candidate.interval(trial), trajectory.force) for trial in trajectory.seen.values()]
        told["within_interval"] = {"value": float(np.median(inside)), "unit": "1", "expected": 0.95}
    return told


def _covered(interval: tuple[np.ndarray, np.ndarray], force: np.ndarray) -> float:
    """Share of samples whose force lies in the interval."""
    return float(np.mean((interval[0] <= force) & (force <= interval[1])))


def simulate(candidate: Candidate, trajectory: Trajectory) -> Simulation | str:
    """The candidate's simulation, or in words why it ended early."""
    assert candidate.simulate is not None
    try:
        return candidate.simulate(trajectory.path, trajectory.start)
    except (ContactLost, SimulationFailed) as error:
        return error.what


def simulation_error(simulation: Simulation | str, trajectory: Trajectory) -> dict[str, Any]:
    """Mean square error of the force, root mean square errors of positions and velocities; or the failure."""
    if isinstance(simulation, str):
        return {"failed": simulation}
    system, clean = trajectory.system, trajectory.clean
    error = float(np.mean((simulation.F - trajectory.force) ** 2))
    result: dict[str, Any] = {"force_mse": {"value": error, "unit": squared(system.force_unit)}}
    for coordinate in trajectory.mechanism.free:
        for kind, name in zip(("position_rms", "velocity_rms"), coordinate.signals[:2], strict=True):
            rms = float(np.sqrt(np.mean((simulation.signals[name] - clean.signals[name]) ** 2)))
            result.setdefault(kind, {})[name] = {"value": rms, "unit": system.signal_units[name]}
    return result


def compare(
    candidates: Mapping[str, Candidate], trajectories: Sequence[Trajectory]
) -> tuple[dict[str, Any], dict[str, dict[str, Simulation | str]]]:
    """Errors of every candidate on every trajectory, and the simulations, by trajectory and candidate."""
    errors: dict[str, Any] = {}
    runs: dict[str, dict[str, Simulation | str]] = {}
    steps = Steps(len(trajectories) * len(candidates), "methods compared")
    for trajectory in trajectories:
        table = errors[trajectory.name] = {}
        runs[trajectory.name] = {}
        for key, candidate in candidates.items():
            table[key] = {"label": candidate.label}
            if candidate.online is not None:
                table[key]["online"] = online_error(candidate, trajectory)
            if candidate.simulate is not None:
                runs[trajectory.name][key] = simulate(candidate, trajectory)
                table[key]["in_simulation"] = simulation_error(runs[trajectory.name][key], trajectory)
            steps.step()
    return errors, runs
