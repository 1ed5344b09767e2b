"""Identification of a robot's joints: a declared model, where its search starts, and what the fit says.

Public: :func:`declare`, :func:`identify`, :func:`relative_errors`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import product

import numpy as np

from ..errors import UserError, choose
from ..physics import LAWS, FrictionLaw, beforehand
from ..physics.base import at_contact
from ..physics.effect import Effect
from ..physics.effects import EFFECTS
from ..physics.robot import Base, Robot
from ..physics.robot_joint import JOINT_EFFECTS
from .balance import Model, friction_of
from .least_squares import Solution, solve
from .motion import Prepared
from .recording import joint_names
from .whole import Lag

FREE, KNOWN, PRIOR = "free", "known", "prior"
SPREAD = 0.3  # of masses, lengths and inertias of a CAD model, relative: cables, covers and oil are not in it
STRIBECK = (0.02, 0.1, 0.4)  # Stribeck velocities that are tried, of the largest speed
BRISTLE = (1e-4, 1e-3, 1e-2)  # lengths of a bristle that are tried, rad or m: gears wind up by less than half a degree
DITHER = "dither"  # of every joint whose law has a bristle: no recording shows all of its motion
SEEN = (5e-4, 5e-3)  # dithers that are tried, of the largest speed
STATIC = 1.2  # static over Coulomb friction at first
COUPLED = 1e-6  # of its length: an armature's column that others explain up to that is none of its own


LINEAR = ("coulomb", "coulomb_viscous", "none")  # laws whose search needs no start


def joint_effect(name: str) -> Effect:
    """An effect at a joint, by name."""
    return choose(name, {**EFFECTS, **JOINT_EFFECTS}, "effects")()


def declare(
    robot: Robot,
    base: Base,
    laws: FrictionLaw | Sequence[FrictionLaw],
    effects: Mapping[str, Sequence[str]] | Sequence[str] = (),
    inertia: str = FREE,
    fixed: Mapping[str, float] | None = None,
    start: Mapping[str, float] | None = None,
) -> Model:
    """The declared model of a robot.

    Args:
        laws: of all joints, or of each.
        effects: at every joint, or joint -> names.
        inertia: "free" (base parameters estimated), "known" (those of the file) or "prior" (estimated, held to the
            file's by a normal prior of 30 %); motors' inertias are estimated unless the file has them and is "known".
        fixed, start: parameters by full name (``joint_2.mu_c``, ``armature.joint_2``) or for every joint (``v_s``), SI
            units: held, or where the search begins.

    Raises:
        UserError: an unknown effect, joint or parameter.
    """
    choose(inertia, dict.fromkeys((FREE, KNOWN, PRIOR)), "robot.inertia")
    names = joint_names(len(robot.joints))
    each = [laws] * len(names) if isinstance(laws, FrictionLaw) else list(laws)
    table = effects if isinstance(effects, Mapping) else {name: list(effects) for name in names}
    for name in table:
        choose(name, dict.fromkeys(names), "diagnose.declared")
    at_joints = tuple(
        tuple(joint_effect(e) for e in dict.fromkeys([*table.get(name, ()), *([DITHER] if law.memory else [])]))
        for name, law in zip(names, each, strict=True)
    )
    model = Model(robot, base, tuple(each), at_joints)
    values = {f"inertia.{n}": float(b) for n, b in zip(base.names, base.values(robot.inertial), strict=True)}
    values |= {f"armature.{n}": float(i) for n, i in zip(names, robot.armature, strict=True)}
    held, start = dict(fixed or {}), dict(start or {})
    values |= {n: float(x) for n, x in {**start, **held}.items() if n in values}
    free = [] if inertia == KNOWN else [f"inertia.{n}" for n in base.names]
    apart = independent_armatures(robot, base) if inertia != KNOWN else range(len(names))
    free += [f"armature.{names[k]}" for k in apart if not (inertia == KNOWN and robot.armature.any())]
    free = [n for n in free if n not in held]
    plain = set()
    for k in range(len(names)):
        for full, par in model.parameters(k).items():
            plain.add(par.name)
            value = next((x[n] for x in (held, start) for n in (full, par.name) if n in x), None)
            values[full] = float(_usual(par) if value is None else value)
            known = full in held or par.name in held
            if not (known or par.hidden or par.name == "preload" or (par.value is not None and par.neutral is None)):
                free.append(full)
    for key, asked in (("fixed", held), ("start", start)):
        for full in asked:
            choose(full, dict.fromkeys([*values, *plain]), f"friction.{key}")
    priors = {}
    if inertia == PRIOR:
        if robot.massless:
            raise UserError("bodies without a mass cannot be a prior", where="robot.file",
                            received=f"no mass behind {', '.join(robot.massless)}", allowed="masses of all bodies",
                            fix="add their <inertial>, or say robot.inertia=free")  # fmt: skip
        own = zip(base.names, base.values(robot.inertial), _file_errors(robot, base), strict=True)
        priors = {f"inertia.{n}": (float(centre), s) for n, centre, s in own if f"inertia.{n}" in free}
    return replace(model, values=values, free=tuple(free), priors=priors)


def without_motors(model: Model) -> Model:
    """The model of torques that were measured behind the gears: they hold no motor's inertia, the file's neither."""
    armatures = [f"armature.{name}" for name in model.names]
    values = {**model.values, **dict.fromkeys(armatures, 0.0)}
    return replace(model, values=values, free=tuple(n for n in model.free if n not in armatures))


def _usual(par) -> float:
    """A value to begin with, before any recording was seen."""
    if par.value is not None:
        return par.value
    return {"mu_c": 1.0, "mu_s": STATIC, "sigma_0": 1e3, "sigma_1": 1.0, "v_s": 0.05, DITHER: 1e-5}.get(par.name, 1.0)


def _file_errors(robot: Robot, base: Base) -> np.ndarray:
    """Standard deviation of the base parameters where every body's numbers are known up to ``SPREAD``."""
    deviations = []
    for inertia in list(robot.model.inertias)[1:]:
        size = float(np.linalg.norm(inertia.lever)) + float(
            np.sqrt(np.trace(inertia.inertia) / max(inertia.mass, 1e-9))
        )
        deviations += [inertia.mass, *[inertia.mass * size] * 3, *[inertia.mass * size**2] * 6]
    variances = (SPREAD * np.array(deviations)) ** 2 + 1e-12
    return np.sqrt(variances[base.columns] + base.mixing**2 @ variances[base.others])


def independent_armatures(robot: Robot, base: Base) -> list[int]:
    """Joints whose motor's inertia is not among the base parameters already: a first joint's turns with its body."""
    rng = np.random.default_rng(0)
    shape = (20 * (len(base.columns) + len(robot.joints)), len(robot.joints))
    q, (v, a) = rng.uniform(-np.pi, np.pi, shape), rng.uniform(-1, 1, (2, *shape))
    known = base.reduced(robot.regressor(q, v, a)).reshape(-1, len(base.columns))
    found = []
    for k in range(len(robot.joints)):
        armature = np.zeros(shape)
        armature[:, k] = a[:, k]
        column = armature.reshape(-1)
        left = column - known @ np.linalg.lstsq(known, column, rcond=None)[0]
        if left @ left > COUPLED * (column @ column):
            found.append(k)
            known = np.column_stack([known, column])
    return found


def identify(model: Model, trials: Sequence[Prepared]) -> Solution:
    """Fit a declared model: first with Coulomb and viscous friction, which is linear, then with its laws.

    Where a law has a Stribeck velocity or a bristle, each joint begins where those of a few that fit it best.
    """
    trials = list(trials)
    model = _with_lag(model, trials)
    plain = LAWS["coulomb_viscous"]()
    linear = [k for k, law in enumerate(model.laws) if law.name not in LINEAR]
    if linear:
        first = solve(_with_law(model, plain, linear), trials)
        found = first.model.values
        values = dict(model.values) | {n: found[n] for n in model.free if n in found}
        model = replace(model, values=values)
        for k in linear:
            model = _best_start(model, k, trials, first)[0]
    return solve(model.held_near(), trials)


def begun_anew(solution: Solution) -> Solution:
    """A fit whose search begins anew at joints where a start explains more than the fit does, all else as it is: what a
    term explained when it came had drawn the laws of its joints after it."""
    model, trials = solution.model, list(solution.trials)
    for k, law in enumerate(model.laws):
        if law.name not in LINEAR:
            started, better = _best_start(model, k, trials, solution)
            model = started if better else model
    if model is solution.model:
        return solution
    again = solve(model, trials, solution.sigmas)
    return again if again.cost < solution.cost else solution


def _with_lag(model: Model, trials: Sequence[Prepared]) -> Model:
    """The model with the lag of its log, which may be anything within a sample."""
    lag, interval = Lag(), max(trial.interval for trial in trials)
    if any(w.name == lag.name for w in model.whole):
        return model
    return replace(
        model,
        whole=(*model.whole, lag),
        values={**model.values, lag.key: 0.0},
        free=(*model.free, lag.key),
        priors={**model.priors, lag.key: (0.0, interval / 3**0.5)},  # as deviates what is even over a sample either way
    )


def _with_law(model: Model, law: FrictionLaw, joints: Sequence[int]) -> Model:
    """The model with another law at some joints, free in what that law has."""
    laws = [law if k in joints else own for k, own in enumerate(model.laws)]
    effects = tuple(() if k in joints else e for k, e in enumerate(model.effects))
    other = replace(model, laws=tuple(laws), effects=effects)
    values, free = dict(model.values), []
    for k in range(len(model.names)):
        for full, par in other.parameters(k).items():
            values.setdefault(full, 0.0 if par.neutral is not None else par.value if par.value is not None else 1.0)
            if full in model.free or (k in joints and par.value is None):
                free.append(full)
    free = [n for n in model.free if n.startswith(("inertia.", "armature."))] + free
    return replace(other, values=values, free=tuple(free))


def _best_start(model: Model, k: int, trials: Sequence[Prepared], first: Solution) -> tuple[Model, bool]:
    """The model with a joint's Stribeck velocity and bristle where its own residual is least, all else linear; and
    whether that is less than with the values that it has."""
    table = model.parameters(k)
    plain = {par.name: full for full, par in table.items()}
    fastest = max(float(np.abs(trial.v[:, k]).max()) for trial in trials)
    # A wide Stribeck curve may have taken all of the Coulomb friction.
    told = [plain["mu_c"], *(n for n in [plain.get("mu_s")] if n in first.model.free)]
    level = max(1e-3, *(first.model.values[n] for n in told))
    if (static := plain.get("mu_s", "")) and static not in model.free:
        level = min(level, model.values[static])
    speeds = [s * fastest for s in STRIBECK] if "v_s" in plain and plain["v_s"] in model.free else [None]
    lengths = BRISTLE if "sigma_0" in plain and plain["sigma_0"] in model.free else [None]
    dithers = [s * fastest for s in SEEN] if DITHER in plain and plain[DITHER] in model.free else [None]
    friction = friction_of(model.laws[k], model.effects[k], bool(model.robot.turns[k]))
    linear = [n for n in ("mu_c", "sigma_2") if n in plain and plain[n] in model.free]
    parts = []  # what the joint's friction sees, and what it must explain: measured torque less bodies
    for trial in trials:
        load = first.model.loads(trial)
        bodies = load[:, k] + first.model.values[f"armature.{model.names[k]}"] * trial.a[:, k]
        parts.append((trial, model.motion(trial, k, load), trial.tau[:, k] - trial.filtered(bodies)))

    def left(values: Mapping[str, float]) -> float:
        squares = 0.0
        for trial, motion, wanted in parts:
            own = model.own_values(k, values)
            F = trial.filtered(friction.force(motion, own))
            columns = trial.filtered(friction.columns(motion, own, linear)) if linear else np.zeros((len(F), 0))
            columns = np.column_stack([columns, np.ones(len(F))])
            rest = wanted - F - columns @ np.linalg.lstsq(columns, wanted - F, rcond=None)[0]
            squares += float(rest @ rest)
        return squares

    starts = []
    for speed, length, dither in product(speeds, lengths, dithers):
        values = dict(model.values) | {plain["mu_c"]: level}
        if "mu_s" in plain and plain["mu_s"] in model.free:
            values[plain["mu_s"]] = STATIC * level
        if speed is not None:
            values[plain["v_s"]] = speed
        if dither is not None:
            values[plain[DITHER]] = dither
        if length is not None:
            values[plain["sigma_0"]] = level / length
            if "sigma_1" in plain and plain["sigma_1"] in model.free:
                values[plain["sigma_1"]] = 0.1 * level / max(fastest, 1e-9)
        starts.append(values)
    squares = [left(values) for values in starts]
    best = int(np.argmin(squares))
    return replace(model, values=starts[best]), squares[best] < left(model.values)


def narrowed(solution: Solution) -> tuple[Solution, tuple[str, ...]]:
    """The fit with every Stribeck velocity above the speed of its joint held where such velocities begin
    (:mod:`..physics.beforehand`), and their names.

    A Stribeck curve as wide as the motion stands in for any friction that bends over velocity.
    """
    model, trials, wide = solution.model, list(solution.trials), []
    for k, joint in enumerate(model.names):
        speed = float(np.sqrt(np.mean(np.concatenate([trial.v[:, k] for trial in trials]) ** 2)))
        if (name := at_contact(joint, "v_s")) in model.free and model.values[name] > speed:
            wide.append(name)
            held = {**model.values, name: beforehand.STRIBECK * speed}
            model = replace(model, values=held, free=tuple(n for n in model.free if n != name))
            model, _ = _best_start(model, k, trials, solution)
    return (solve(model, trials, solution.sigmas) if wide else solution), tuple(wide)


def relative_errors(model: Model, trials: Sequence[Prepared]) -> dict[str, np.ndarray]:
    """Trial -> norm of the torque error over the norm of the torque of each joint, shape (joints,)."""
    found = {}
    for trial in trials:
        left = model.recorded(trial) - trial.tau
        found[trial.name] = np.linalg.norm(left, axis=0) / np.maximum(np.linalg.norm(trial.tau, axis=0), 1e-300)
    return found
