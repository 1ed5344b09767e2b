"""What a robot's declared model may lack: effects joint by joint, effects on the robot, functions of one variable.

Public: :class:`Term`, :func:`at_joint`, :func:`on_robot`, :func:`remainders`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..diagnose.candidates import Candidate, candidates
from ..physics.base import at_contact
from ..physics.effect import Effect
from ..physics.remainder import BUMPS
from ..physics.robot_joint import RobotJoint
from ..physics.scan import data_scales
from .balance import Model, friction_of
from .identify import joint_effect
from .motion import Prepared
from .whole import BaseTilt, Compliance, Coupling, Delay, GainError, Payload, Whole

# Effects that a joint may lack. Left out are those that other terms of the balance are already (inertia, gains, delays)
# and faults of sensors, which a balance with estimated inertias takes for something else.
AT_JOINTS = (
    "load_friction",
    "load_direction",
    "constant_force",
    "asymmetry",
    "viscous",
    "asymmetric_viscous",
    "drag",
    "shear_thinning",
    "stribeck",
    "stribeck_shape",
    "low_speed",
    "presliding",
    "position_friction",
    "ripple",
    "spring_force",
    "drift",
    "temperature",
)
ON_ROBOT = ("gain_error", "coupling", "delay", "compliance", "payload", "base_tilt")
BATCH = 32  # values of hidden parameters at a time: arrays of some tens of MB
VARIABLES = ("velocity", "position", "load", "time", "acceleration")


@dataclass(frozen=True)
class Term:
    """A term that may be missing.

    Attributes:
        name: ``load_friction@joint_2``, ``ripple@joint_3 (force)``, ``payload``.
        joint: index, or None where it acts on the robot.
        candidate: its strengths and the values of its hidden parameters to try; of a joint.
        effect: of a joint.
        whole: of the robot.
    """

    name: str
    joint: int | None = None
    candidate: Candidate | None = None
    effect: Effect | None = None
    whole: Whole | None = None

    def possible(self, step: Sequence[float] | np.ndarray) -> bool:
        """Whether strengths have a sign that they can have."""
        if self.effect is None or self.candidate is None:
            return self.whole is None or self.whole.possible(step)
        table = {par.name: par for par in self.effect.parameters}
        steps = zip(self.candidate.strengths, step, strict=True)
        return all(table[n].low != table[n].neutral or x >= 0 for n, x in steps if n in table)

    @property
    def kind(self) -> str:
        """The effect's name alone."""
        return self.name.partition("@")[0].partition(" ")[0]

    def added(self, model: Model, hidden: Mapping[str, float], step: Sequence[float] | np.ndarray) -> Model:
        """The model with this term, its strengths at ``step``."""
        if self.whole is not None:
            values = dict(zip(self.whole.parameters, map(float, step), strict=True))
            return replace(
                model, whole=(*model.whole, self.whole), values={**model.values, **values}, free=(*model.free, *values)
            )
        assert self.joint is not None and self.candidate is not None and self.effect is not None
        joint = model.names[self.joint]
        here = {at_contact(joint, n): float(x) for n, x in zip(self.candidate.strengths, step, strict=True)}
        shaped = {at_contact(joint, n): float(x) for n, x in hidden.items()}
        effects = list(model.effects)
        if self.effect.name not in [e.name for e in effects[self.joint]]:
            effects[self.joint] = (*effects[self.joint], self.effect)
        grown = replace(model, effects=tuple(effects))
        usual = {
            n: (par.neutral if par.neutral is not None else par.value) or 0.0
            for n, par in grown.parameters(self.joint).items()
        }
        new = tuple(n for n in (*here, *(at_contact(joint, n) for n in self.candidate.hidden)) if n not in model.free)
        return replace(grown, values={**usual, **model.values, **shaped, **here}, free=(*model.free, *new))

    def names(self, model: Model, hidden: bool = True) -> list[str]:
        """Full names of its strengths and, if wanted, of what shapes it: ``joint_2.load_friction``."""
        if self.whole is not None:
            return list(self.whole.parameters)
        assert self.joint is not None and self.candidate is not None
        own = (*self.candidate.strengths, *(self.candidate.hidden if hidden else ()))
        return [at_contact(model.names[self.joint], name) for name in own]

    @property
    def strengths(self) -> int:
        """How many it has."""
        return len(self.whole.parameters) if self.whole is not None else len(self.candidate.strengths)  # type: ignore[union-attr]

    def columns(
        self, model: Model, trials: Sequence[Prepared], loads: Sequence[np.ndarray]
    ) -> Iterator[tuple[list[dict[str, float]], list[np.ndarray], tuple[int, ...]]]:
        """Values of its hidden parameters, some at a time; the columns of each trial there, and the joints that they
        act on, see :meth:`.score.Scorer.test`.

        Args:
            loads: of each trial, see :meth:`Model.loads`.
        """
        if self.whole is not None:
            names = list(self.whole.parameters)
            made = [
                trial.filtered(
                    np.stack([self.whole.column(model, trial, n, np.ones_like(trial.q)) for n in names], axis=2)
                )
                for trial in trials
            ]
            yield [{}], made, tuple(range(len(model.names)))
            return
        assert self.joint is not None and self.candidate is not None and self.effect is not None
        k, table = self.joint, model.effects[self.joint]
        known = self.effect.name in [e.name for e in table]
        f = friction_of(model.laws[k], table if known else (*table, self.effect), bool(model.robot.turns[k]))
        usual = {p.name: (p.neutral if p.neutral is not None else p.value) or 0.0 for p in f.mechanism.parameters}
        own = {n: model.values[full] for n in f.names if (full := at_contact(model.names[k], n)) in model.values}
        motions = [model.motion(trial, k, load) for trial, load in zip(trials, loads, strict=True)]
        for first in range(0, len(self.candidate.grid), BATCH):
            some = [dict(hidden) for hidden in self.candidate.grid[first : first + BATCH]]
            shaped = {n: np.array([[hidden[n]] for hidden in some]) for n in some[0]}
            values = [(usual | own | shaped)[n] for n in f.names]
            made = [
                trial.filtered(f.columns(motion, values, self.candidate.strengths))
                for trial, motion in zip(trials, motions, strict=True)
            ]
            yield some, made, (k,)


def at_joint(
    model: Model, k: int, trials: Sequence[Prepared], loads: Sequence[np.ndarray], names: Sequence[str]
) -> list[Term]:
    """Terms that a joint may lack.

    Args:
        names: of effects that are tried.
    """
    system, law, joint = RobotJoint(bool(model.robot.turns[k])), model.laws[k], model.names[k]
    scales = data_scales(
        [t.t for t in trials],
        [t.q[:, k] for t in trials],
        [t.v[:, k] for t in trials],
        [np.abs(load[:, k]) for load in loads],
    )
    made, present = [], {e.name for e in model.effects[k]}
    for name in names:
        effect = joint_effect(name)
        if not effect.applies(system, law) or (name == "temperature" and trials[0].covariate is None):
            continue
        for c in candidates([effect], system, law, {"": scales}):
            if name in present and any(at_contact(joint, n) in model.free for n in c.strengths):
                continue
            group = "" if c.group == name else f" ({c.group})"
            made.append(Term(f"{name}@{joint}{group}", k, c, effect))
    return made


def on_robot(model: Model, names: Sequence[str], suspected: tuple[str, ...] | None) -> list[Term]:
    """Terms that the robot as a whole may lack.

    Args:
        names: of effects that are tried.
        suspected: trials that may carry a payload; None: all, which only shows where inertias are known.
    """
    joints, turns, made = model.names, [bool(x) for x in model.robot.turns], []
    for k, joint in enumerate(joints):
        if "gain_error" in names:
            made.append(Term(f"gain_error@{joint}", whole=GainError(joint)))
        if "delay" in names:
            made.append(Term(f"delay@{joint}", whole=Delay(joint)))
        if "compliance" in names:
            made.append(Term(f"compliance@{joint}", whole=Compliance(joint, turns[k])))
        if "coupling" in names:
            made += [
                Term(f"coupling@{joint} ({joints[n]})", whole=Coupling(joint, joints[n], turns))
                for n in model.robot.neighbours[k]
            ]
    if "payload" in names:
        made.append(Term("payload", whole=Payload(suspected)))
    if "base_tilt" in names:
        made.append(Term("base_tilt", whole=BaseTilt(model.robot, model.base)))
    present = {p for w in model.whole for p in w.parameters}
    return [t for t in made if t.whole is not None and not present & set(t.whole.parameters)]


def remainders(
    model: Model, k: int, trials: Sequence[Prepared], loads: Sequence[np.ndarray]
) -> Iterator[tuple[str, str, list[np.ndarray], list[np.ndarray], Callable[[np.ndarray], np.ndarray]]]:
    """Any smooth function of one variable at a joint, as bumps: variable, kind ("force", or "friction", which has the
    sign of the friction), columns of each trial, the variable's samples, and the bumps at any of its values."""
    friction = [
        model.friction(k).force(model.motion(trial, k, load) | {"a": trial.a[:, k]}, model.own_values(k))
        for trial, load in zip(trials, loads, strict=True)
    ]
    for variable in VARIABLES:
        samples = [_samples(variable, trial, load, k) for trial, load in zip(trials, loads, strict=True)]
        low, high = np.quantile(np.concatenate(samples), [0.002, 0.998])
        step = max(high - low, 1e-9) / (BUMPS - 1)

        def shape(x: np.ndarray, low: float = low, step: float = step) -> np.ndarray:
            return np.exp(-((((x - low) / step)[:, None] - np.arange(BUMPS)) ** 2))

        bumps = [shape(x) for x in samples]
        for kind in ("force", "friction"):
            weights = [
                np.ones(len(x)) if kind == "force" else np.sign(f) for x, f in zip(samples, friction, strict=True)
            ]
            made = [trial.filtered(b * w[:, None]) for trial, b, w in zip(trials, bumps, weights, strict=True)]
            yield variable, kind, made, samples, shape


def _samples(variable: str, trial: Prepared, load: np.ndarray, k: int) -> np.ndarray:
    if variable == "time":
        return trial.session
    return {"velocity": trial.v, "position": trial.q, "load": load, "acceleration": trial.a}[variable][:, k]
