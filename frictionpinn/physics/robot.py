"""Robots from URDF or MJCF: inverse dynamics, torque regressor, base parameters.

Rigid-body dynamics of an arm do not go through symbolic energies: a 6-joint Coriolis matrix is megabytes of code.
pinocchio (extra ``[robot]``) does them. In the robot's equations each joint is a contact:

    tau = Y(q, v, a) pi + I_a a + F(v, load, z),    load = |Y(q, v, a) pi|,

tau the torques of the motors at the joints, pi ten inertial parameters of each body, Y the torque regressor, I_a the
motors' inertia seen at the joint (armature) and F the joints' friction, which a robot file's own damping and friction
are no part of.

Public: :class:`Robot` (``read``, ``inverse_dynamics``, ``linearised``, ``energy``, ``regressor``,
``gravity_regressor``, ``payload_regressor``, ``with_inertia``, ``inertial``, ``armature``, ``limits``), :class:`Base`
(``of``, ``reduced``, ``values``) and ``INERTIAL``. Arrays are in SI units, samples first: q, v, a and tau have the
shape (n, joints), a regressor (n, joints, columns).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from scipy.linalg import qr, solve_triangular

from ..errors import UserError, nearest

# Of each body, in pinocchio's order: mass, first moments, second moments about the joint's frame.
INERTIAL = ("m", "mx", "my", "mz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")
INERTIAL_UNITS = ("kg", *["kg*m"] * 3, *["kg*m^2"] * 6)
OVER = 0.01  # of a joint's range: a lock beyond its limits by as much is a rounded number
RANDOM = 40  # motions by which a base is found, for each body: columns are ten, and joints several
TOLD = 1e-8  # of the largest diagonal of the QR: columns below depend on others, far above rounding


def _pinocchio() -> Any:
    try:
        import pinocchio
    except ImportError as error:
        raise UserError("pinocchio is not installed", where="system", received="robot",
                        fix='pip install -c constraints.txt -e ".[robot]"') from error  # fmt: skip
    return pinocchio


@dataclass(frozen=True)
class Robot:
    """A tree of bodies on joints of one degree of freedom each.

    Attributes:
        name: of the model.
        joints: names, in the order of all arrays.
        model: pinocchio's, with those joints alone.
    """

    name: str
    joints: tuple[str, ...]
    model: Any

    @classmethod
    def read(
        cls,
        file: str | Path,
        joints: Sequence[str] | None = None,
        locked: Mapping[str, float] | None = None,
        gravity: Sequence[float] | None = None,
    ) -> Robot:
        """Read a URDF (``.urdf``) or MJCF (``.xml``, ``.mjcf``); its armatures are read, its friction is not.

        Args:
            file: its path; no meshes are needed.
            joints: those that were recorded, in the order of the columns; None: every joint that moves, as in the file.
            locked: joint -> position, rad or m, where it stays; joints that are not among ``joints`` stay at 0.
            gravity: m/s^2 in the frame of the base; None: as in the file, of a URDF (0, 0, -9.81).

        Raises:
            UserError: no such file or joint, one that cannot be read, a joint with several degrees of freedom that is
                not locked.
        """
        pin, path = _pinocchio(), Path(file).expanduser()
        if not path.is_file():
            raise UserError("unknown file", where="robot.file", received=str(file), allowed="a URDF or MJCF",
                            fix="check the path")  # fmt: skip
        try:
            build = pin.buildModelFromUrdf if path.suffix == ".urdf" else pin.buildModelFromMJCF
            model = build(str(path))
        except Exception as error:  # pinocchio raises what its parsers raise
            why = " ".join(str(error).split())[:160]
            raise UserError("robot file that cannot be read", where="robot.file", received=str(path),
                            allowed="a URDF (.urdf) or MJCF (.xml)", fix=why) from error  # fmt: skip
        known = list(model.names)[1:]
        locked = dict(locked or {})
        for name in (*locked, *(joints or ())):
            if name not in known:
                where = "robot.locked" if name in locked else "robot.joints"
                raise UserError("unknown joint", where=where, received=repr(name), allowed=", ".join(known),
                                fix=nearest(name, known) or "use a joint of the file that is not fixed")  # fmt: skip
        if twice := sorted({n for n in joints or () if list(joints or ()).count(n) > 1}):
            raise UserError("joint named twice", where="robot.joints", received=", ".join(twice),
                            fix="name each once, in the order of the columns")  # fmt: skip
        if both := set(locked) & set(joints or ()):
            raise UserError("joint both recorded and locked", where="robot.locked", received=", ".join(sorted(both)),
                            fix="name it once")  # fmt: skip
        wanted = [n for n in (joints or known) if n not in locked]
        reference = pin.neutral(model)
        for name, position in locked.items():
            if isinstance(position, bool) or not isinstance(position, int | float) or not np.isfinite(position):
                raise UserError("not a number", where=f"robot.locked.{name}", received=repr(position),
                                allowed="where the joint stays, rad or m")  # fmt: skip
            own = model.joints[model.getJointId(name)]
            if own.nv != 1:
                raise UserError("joint that a number does not place", where=f"robot.locked.{name}", received=position,
                                allowed="joints of one degree of freedom")  # fmt: skip
            if own.nq == 1:
                low, high = model.lowerPositionLimit[own.idx_q], model.upperPositionLimit[own.idx_q]
                beyond = OVER * (high - low)
                if low < high and not low - beyond <= position <= high + beyond:
                    unit = "m" if _slides(own) else "rad"
                    raise UserError("joint locked beyond its limits", where=f"robot.locked.{name}",
                                    received=f"{position:g} {unit}", allowed=f"{low:g} to {high:g} {unit}",
                                    fix="give it in SI units, or mend the limits of the robot file")  # fmt: skip
            reference[own.idx_q : own.idx_q + own.nq] = _place(own.nq, float(position))
        model = pin.buildReducedModel(model, [model.getJointId(n) for n in known if n not in wanted], reference)
        several = [n for n in list(model.names)[1:] if model.joints[model.getJointId(n)].nv != 1]
        if several or not wanted:
            raise UserError("joint of several degrees of freedom" if several else "no joint moves",
                            where="robot.joints", received=", ".join(several) or "an empty list",
                            allowed="joints that turn about or slide along one axis",
                            fix="name the recorded ones in robot.joints")  # fmt: skip
        if gravity is not None:
            model.gravity.linear = _direction(gravity)
        return cls(model.name or path.stem, tuple(wanted), model)

    @cached_property
    def _order(self) -> np.ndarray:
        """Place of each joint among the model's velocities, shape (joints,)."""
        return np.array([self.model.joints[self.model.getJointId(n)].idx_v for n in self.joints])

    @cached_property
    def _data(self) -> Any:
        return self.model.createData()

    def _configured(self, q: np.ndarray) -> np.ndarray:
        """The model's configurations, shape (n, nq): of a joint without limits cosine and sine of its angle."""
        made = np.zeros((len(q), self.model.nq))
        for k, (first, size) in enumerate(self._places):
            made[:, first : first + size] = _place(size, q[:, k])
        return made

    @cached_property
    def _places(self) -> list[tuple[int, int]]:
        """First index and number of each joint's configuration."""
        own = [self.model.joints[self.model.getJointId(name)] for name in self.joints]
        return [(joint.idx_q, joint.nq) for joint in own]

    def _motion(self, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> list[np.ndarray]:
        placed = self._placed
        return [self._configured(q), np.ascontiguousarray(v[:, placed]), np.ascontiguousarray(a[:, placed])]

    @cached_property
    def _placed(self) -> np.ndarray:
        """Joint of each of the model's velocities, shape (joints,)."""
        return np.argsort(self._order)

    # dynamics --------------------------------------------------------------------------------------------------
    def inverse_dynamics(self, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
        """Torques without friction, armatures included, N m or N, shape (n, joints)."""
        rnea, model, data = _pinocchio().rnea, self.model, self._data
        motion = self._motion(q, v, a)
        return np.array([rnea(model, data, *row) for row in zip(*motion, strict=True)])[:, self._order]

    def linearised(self, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> tuple[np.ndarray, ...]:
        """Inverse dynamics of one motion, all of shape (joints,), and its derivatives in q, v and a, (joints, joints).

        Source: Carpentier and Mansard, Analytical derivatives of rigid body dynamics algorithms, RSS (2018).
        """
        order, data = self._order, self._data
        motion = (x[0] for x in self._motion(q[None], v[None], a[None]))
        slopes = _pinocchio().computeRNEADerivatives(self.model, data, *motion)
        return data.tau[order], *(slope[order[:, None], order] for slope in slopes)

    def energy(self, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Kinetic (armatures included) and potential energy together, J, shape (n,)."""
        compute, model, data = _pinocchio().computeMechanicalEnergy, self.model, self._data
        placed, speeds, _ = self._motion(q, v, v)
        return np.array([compute(model, data, *row) for row in zip(placed, speeds, strict=True)])

    def with_inertia(self, inertial: np.ndarray, armature: np.ndarray) -> Robot:
        """The robot with other bodies, pi of shape (10 bodies,), and other armatures, shape (joints,)."""
        pin, model = _pinocchio(), self.model.copy()
        for k, own in enumerate(np.reshape(inertial, (-1, 10)), 1):
            model.inertias[k] = pin.Inertia.FromDynamicParameters(np.array(own))
        values = np.zeros(model.nv)
        values[self._order] = armature
        model.armature = values
        return replace(self, model=model)

    def regressor(self, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
        """Y with Y pi = inverse dynamics without armatures, shape (n, joints, 10 bodies), bodies as in ``inertial``."""
        compute, model, data = _pinocchio().computeJointTorqueRegressor, self.model, self._data
        result = np.empty((len(q), len(self.joints), 10 * (model.njoints - 1)))
        for k, row in enumerate(zip(*self._motion(q, v, a), strict=True)):
            result[k] = compute(model, data, *row)[self._order]
        return result

    def gravity_regressor(self, q: np.ndarray, direction: Sequence[float] | np.ndarray) -> np.ndarray:
        """Y at rest where gravity is ``direction``, m/s^2 in the frame of the base; it is linear in it."""
        before = self.model.gravity.linear.copy()
        try:
            self.model.gravity.linear = np.asarray(direction, float)
            return self.regressor(q, np.zeros_like(q), np.zeros_like(q))
        finally:
            self.model.gravity.linear = before

    def payload_regressor(self, regressor: np.ndarray) -> np.ndarray:
        """Columns of mass and first moments that are carried by the last body, in the frame of its joint, shape
        (n, joints, 4): a payload is a body fixed to it. The last of the chain, whatever the order of ``joints``."""
        last = 10 * (self.model.njoints - 2)
        return regressor[:, :, last : last + 4]

    @cached_property
    def neighbours(self) -> tuple[tuple[int, ...], ...]:
        """Of each joint those next to it in the chain: the one that carries it, and those that it carries."""
        ids = [self.model.getJointId(name) for name in self.joints]
        parents = [self.model.parents[own] for own in ids]
        return tuple(
            tuple(n for n, other in enumerate(ids) if other == parents[k] or parents[n] == own)
            for k, own in enumerate(ids)
        )

    # what the file says ----------------------------------------------------------------------------------------
    @cached_property
    def inertial(self) -> np.ndarray:
        """pi of the file, shape (10 bodies,), SI units."""
        return np.concatenate([inertia.toDynamicParameters() for inertia in list(self.model.inertias)[1:]])

    @cached_property
    def massless(self) -> tuple[str, ...]:
        """Joints that move no mass of their own by the file, in its order."""
        return tuple(name for name, m in zip(list(self.model.names)[1:], self.inertial[::10], strict=True) if not m > 0)

    @cached_property
    def inertial_names(self) -> tuple[str, ...]:
        """Names of the inertial parameters, ``joint_2.mx``: of the body that the joint moves."""
        return tuple(f"{name}.{par}" for name in list(self.model.names)[1:] for par in INERTIAL)

    @cached_property
    def armature(self) -> np.ndarray:
        """Inertia of the motors seen at the joints, of the file, kg m^2, shape (joints,)."""
        return np.asarray(self.model.armature)[self._order]

    @cached_property
    def limits(self) -> dict[str, np.ndarray]:
        """``effort`` and ``velocity`` limits of the file, shape (joints,), inf where it has none."""
        kept = {"effort": self.model.upperEffortLimit if hasattr(self.model, "upperEffortLimit")
                else self.model.effortLimit, "velocity": self.model.upperVelocityLimit
                if hasattr(self.model, "upperVelocityLimit") else self.model.velocityLimit}  # fmt: skip
        return {key: np.where(np.asarray(value)[self._order] > 0, np.asarray(value)[self._order], np.inf)
                for key, value in kept.items()}  # fmt: skip

    @cached_property
    def turns(self) -> np.ndarray:
        """Whether a joint turns (rad, N m); others slide (m, N), shape (joints,)."""
        return np.array([not _slides(self.model.joints[self.model.getJointId(n)]) for n in self.joints])


def _slides(joint: Any) -> bool:
    return "JointModelP" in joint.shortname()


def _direction(gravity: Sequence[float]) -> np.ndarray:
    """Gravity, shape (3,)."""
    try:
        direction = np.asarray(gravity, float)
    except (TypeError, ValueError):
        direction = np.empty(0)
    if direction.shape != (3,) or not np.isfinite(direction).all():
        raise UserError("not a direction", where="robot.gravity", received=repr(gravity),
                        allowed="three numbers, m/s^2 in the frame of the base, [0, 0, -9.81]")  # fmt: skip
    return direction


def _place(nq: int, position: Any) -> np.ndarray:
    """A joint's configuration, shape (..., nq), from its position."""
    position = np.asarray(position, float)
    return position[..., None] if nq == 1 else np.stack([np.cos(position), np.sin(position)], axis=-1)


@dataclass(frozen=True)
class Base:
    """Base parameters: the combinations beta of the inertial parameters pi that any motion of the robot can tell.

    beta = pi[columns] + mixing @ pi[others], so that Y pi = Y[..., columns] beta.

    Attributes:
        columns, others: of pi.
        mixing: shape (base, others).
        names: of the columns.

    Source: Gautier, Numerical calculation of the base inertial parameters of robots, J. Robotic Systems 8 (1991).
    """

    columns: np.ndarray
    others: np.ndarray
    mixing: np.ndarray
    names: tuple[str, ...]

    @classmethod
    def of(cls, robot: Robot, seed: int = 0) -> Base:
        """By QR with pivoting of the regressor at random motions of about a turn, 1 rad/s and 1 rad/s^2.

        Columns of the file's larger parameters do not come first: the base is the model's, whatever its values are.
        """
        rng = np.random.default_rng(seed)
        shape = (RANDOM * (robot.model.njoints - 1), len(robot.joints))
        W = robot.regressor(rng.uniform(-np.pi, np.pi, shape), *rng.uniform(-1, 1, (2, *shape)))
        W = W.reshape(-1, W.shape[2])
        R, order = qr(W, mode="r", pivoting=True)
        sizes = np.abs(np.diag(R))
        rank = int(np.count_nonzero(sizes > TOLD * sizes[0]))
        mixing = solve_triangular(R[:rank, :rank], R[:rank, rank:])
        names = tuple(robot.inertial_names[k] for k in order[:rank])
        return cls(order[:rank], order[rank:], mixing, names)

    def reduced(self, regressor: np.ndarray) -> np.ndarray:
        """The columns of the base parameters, shape (n, joints, base)."""
        return np.ascontiguousarray(regressor[..., self.columns])

    def values(self, inertial: np.ndarray) -> np.ndarray:
        """beta of pi, shape (base,)."""
        return inertial[self.columns] + self.mixing @ inertial[self.others]
