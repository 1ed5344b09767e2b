"""Networks for the friction of a robot's joints: what they are trained on, and the torques that they then say.

1. Identify with the declared law, an offset, and friction that may grow with the load, in every joint. The normal force
   that a joint's network or law sees is N = 1 + load_friction |load| / mu_c from there, so that mu_c reads as the
   friction torque of the unloaded joint.
2. Train every joint at once, what is no friction eliminated (:class:`frictionpinn.models.joints.JointNetworks`). A
   black box learns what the identified friction leaves of the torques; a parameter estimator has the law's values and
   its bristle along the motion to begin with.
3. The same linear problem, solved once more with the trained friction, gives the bodies that go with it.

The frictionless acceleration that BB2 and PE2 see is that of the motion, as wherever a motion is imposed.

Public: :func:`start`, :func:`joint_trials`, :class:`Trained`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch

from ..data.thresholds import JITTER
from ..errors import UserError
from ..models import JointNetworks, JointTrial
from ..numerics.score import inverse_root
from ..numerics.torch_functions import LawFunctions
from ..physics.base import at_contact, contact_of, plain_name
from .balance import Model
from .identify import identify, joint_effect
from .least_squares import Solution
from .motion import EDGE, Prepared

LOAD, OFFSET = "load_friction", "constant_force"
MOST = 0.99  # of the breakaway force does a bristle carry to begin with: a network's tanh has a slope there
LEAST = 1e-3  # of the normal force is the load at least, as root mean square: every network sees it
Trials = Sequence[Prepared]


def start(model: Model, trials: Trials, loaded: bool = True) -> Solution:
    """Step 1.

    Args:
        model: declared, with an offset in every joint.
        loaded: whether the torques hold the friction of gears.
    """
    effects, new = list(model.effects), []
    for k, joint in enumerate(model.names):
        if loaded and LOAD not in [e.name for e in effects[k]]:
            effects[k] = (*effects[k], joint_effect(LOAD))
            new.append(at_contact(joint, LOAD))
    values = {**model.values, **dict.fromkeys(new, 0.0)}
    return identify(replace(model, effects=tuple(effects), values=values, free=(*model.free, *new)), trials)


@dataclass(frozen=True)
class Unknown:
    """All that is estimated beside friction: its columns, in units of each joint's residual, and what they give.

    Attributes:
        names: of the parameters.
        columns: of each trial, shape (m, joints, names).
        H: their upper triangle, as it were: columns H are orthonormal, priors counted.
    """

    names: tuple[str, ...]
    columns: tuple[np.ndarray, ...]
    H: np.ndarray

    @classmethod
    def of(cls, solution: Solution, trials: Trials) -> Unknown:
        """Along these trials."""
        model = solution.model
        names = tuple(n for n in model.free if contact_of(n) not in model.names or plain_name(n) == OFFSET)
        columns = tuple(model.columns(trial, names) / solution.sigmas[:, None] for trial in trials)
        prior = np.array([model.priors[n][1] ** -2 if n in model.priors else 0.0 for n in names])
        A = sum(np.einsum("mjc,mjd->cd", c, c, optimize=True) for c in columns)
        return cls(names, columns, inverse_root(A + np.diag(prior)))

    def solved(self, left: Sequence[np.ndarray]) -> np.ndarray:
        """Change of the parameters that explains most of what is left in these trials, in units of the residual."""
        b = sum(np.einsum("mjc,mj->c", c, r, optimize=True) for c, r in zip(self.columns, left, strict=True))
        return self.H @ (self.H.T @ b)


def joint_trials(
    solution: Solution, trials: Trials, splits: Mapping[str, Sequence[str]], law: bool
) -> list[JointTrial]:
    """Step 2: what networks see of trials, the unknown columns orthonormal over the trials of a split.

    Args:
        solution: of :func:`start`.
        law: whether they learn the whole friction by a law (PE), and not what the identified one leaves (BB).

    Raises:
        UserError: trials at different rates: the windows and the low-pass of networks count samples.
    """
    step = trials[0].t[1] - trials[0].t[0]
    for trial in trials:
        if abs((trial.t[1] - trial.t[0]) / step - 1) > JITTER:
            raise UserError("trials at different rates", where=f"trial '{trial.name}'",
                            received=f"{1 / (trial.t[1] - trial.t[0]):.4g} Hz", allowed=f"{1 / step:.4g} Hz, as others",
                            fix="train on those of one rate: data.held_out leaves others out")  # fmt: skip
    by_name, columns = {trial.name: trial for trial in trials}, dict[str, np.ndarray]()
    for split in ("train", "validation"):
        if splits[split]:
            unknown = Unknown.of(solution, [by_name[name] for name in splits[split]])
            columns |= {name: c @ unknown.H for name, c in zip(splits[split], unknown.columns, strict=True)}
    return [_joint_trial(solution, trial, law, columns.get(trial.name)) for trial in trials]


def _joint_trial(solution: Solution, trial: Prepared, law: bool, columns: np.ndarray | None = None) -> JointTrial:
    model = solution.model
    load, friction = model.loads(trial), model.torques(trial)[1]
    compared = np.zeros(len(trial.t))
    compared[trial.keep] = 1.0
    left = np.zeros_like(friction)
    left[trial.keep] = trial.tau - model.recorded(trial) + (trial.filtered(friction) if law else 0.0)
    unknown = np.zeros((*left.shape, 0 if columns is None else columns.shape[2]))
    if columns is not None:
        unknown[trial.keep] = columns
    seen, rates, leads = dict[str, np.ndarray](), dict[str, np.ndarray](), dict[str, np.ndarray]()
    for k, joint in enumerate(model.names):
        normal = _normal(solution, joint, load[:, k])
        own = {"v_slip": trial.v[:, k], "normal_force": normal, "a_slip": trial.a[:, k],
               "a_frictionless": trial.a[:, k], "friction_force": friction[:, k]}  # fmt: skip
        changes = {"v_slip": trial.a[:, k], "normal_force": np.gradient(normal, trial.t),
                   "a_frictionless": np.gradient(trial.a[:, k], trial.t)}  # fmt: skip
        seen |= {at_contact(joint, name): x for name, x in own.items()}
        rates |= {at_contact(joint, name): x for name, x in changes.items()}
        if law:
            leads[joint] = _lead(model, k, model.motion(trial, k, load), normal)
    return JointTrial(trial.name, trial.t, seen, seen, rates, contacts=model.names, compared=compared, left=left,
                      unknown=unknown, leads=leads)  # fmt: skip


def _lead(model: Model, k: int, motion: Mapping[str, np.ndarray], normal: np.ndarray) -> np.ndarray:
    """u of the identified bristle along the motion, sigma_0 z = tanh(u) g(0, N), shape (n,)."""
    z, own = model.friction(k).bristle(motion, model.own_values(k)), law_values(model, k)
    values = [torch.tensor(x, dtype=torch.float64) for x in (0.0, normal, *own.values())]
    capacity = LawFunctions(model.laws[k]).capacity(*values)
    return np.arctanh(np.clip(own["sigma_0"] * z / capacity.numpy(), -MOST, MOST))


def law_values(model: Model, k: int) -> dict[str, float]:
    """Identified values of a joint's law, SI units."""
    return {p.name: model.values[at_contact(model.names[k], p.name)] for p in model.laws[k].parameters}


def _normal(solution: Solution, joint: str, load: np.ndarray) -> np.ndarray:
    """1 + load_friction |load| / mu_c of a joint, shape (n,)."""
    values = solution.model.values
    mu_c = max(values[at_contact(joint, "mu_c")], 1e-12)
    size = max(float(np.sqrt(np.mean(load**2))), 1e-12)
    return 1.0 + max(values.get(at_contact(joint, LOAD), 0.0) / mu_c, LEAST / size) * np.abs(load)


def kernel_of(trial: Prepared) -> np.ndarray:
    """The low-pass of a trial as the samples of its response to one, to both sides of it; shape (2 half + 1,)."""
    half = round(EDGE / trial.cutoff_hz / (trial.t[1] - trial.t[0]))
    one = np.zeros(6 * half + 1)
    one[3 * half] = 1.0
    return trial.filtered_at(trial.cutoff_hz, one)[2 * half : 4 * half + 1]


def weights(solution: Solution, trials: Trials) -> np.ndarray:
    """Scale of each joint's torque in the loss, N m, shape (joints,): its residual, so that joints count as they do in
    the identification, times one number by which the mean square of friction is 1, as in every normalised loss."""
    friction = np.concatenate([trial.filtered(solution.model.torques(trial)[1]) for trial in trials])
    return solution.sigmas * float(np.sqrt(np.mean((friction / solution.sigmas) ** 2)))


@dataclass(frozen=True)
class Trained:
    """Step 3: the robot with trained friction.

    Attributes:
        solution: of :func:`start`.
        model: networks of all joints.
        change: of what is estimated beside friction, against that solution; of offsets against none with a law.
    """

    solution: Solution
    model: JointNetworks
    change: Mapping[str, float]

    @classmethod
    def of(cls, solution: Solution, model: JointNetworks) -> Trained:
        """Bodies that go with the networks' friction, on the trials of the solution."""
        trials = solution.trials
        unknown, plain = Unknown.of(solution, trials), cls(solution, model, {})
        left = [(trial.tau - plain.torque(trial)) / solution.sigmas for trial in trials]
        return replace(plain, change=dict(zip(unknown.names, map(float, unknown.solved(left)), strict=True)))

    def friction(self, trial: Prepared) -> np.ndarray:
        """Friction along a motion, offsets aside where a law is trained, N m, shape (n, joints)."""
        seen = self.model.predict_trial(_joint_trial(self.solution, trial, self.model.sees_rates))
        told = np.stack([seen[at_contact(joint, "force")] for joint in self.model.contacts], axis=1)
        return told if self.model.sees_rates else told + self.solution.model.torques(trial)[1]

    def torque(self, trial: Prepared) -> np.ndarray:
        """What the torques' channels should show, filtered, N m, shape (m, joints)."""
        model = self.solution.model
        shown = model.recorded(trial) + trial.filtered(self.friction(trial) - model.torques(trial)[1])
        return shown + model.columns(trial, tuple(self.change)) @ np.array([*self.change.values()])

    def errors(self, trials: Trials) -> dict[str, np.ndarray]:
        """Trial -> norm of the torque error over that of the torque of each joint, shape (joints,)."""
        found = {}
        for trial in trials:
            off = np.linalg.norm(self.torque(trial) - trial.tau, axis=0)
            found[trial.name] = off / np.maximum(np.linalg.norm(trial.tau, axis=0), 1e-300)
        return found
