"""Effects on a robot as a whole: its motors, its compliance, what it carries, how its base stands.

Each is a term with strengths that a neutral value of 0 switches off, like the effects of a contact, but in terms of the
rigid bodies' regressor, which no symbolic expression holds.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from scipy.interpolate import make_interp_spline
from scipy.linalg import qr

from ..physics.robot import TOLD, Base, Robot
from .motion import PER_PERIOD, Prepared

if TYPE_CHECKING:
    from .balance import Model

G = 9.81
WIDER = 2.0  # cutoffs that a wider low-pass passes: of what is above, the narrow one leaves less than 0.4 %
LAG = "lag"  # of a log, in every model


def joint_of(name: str) -> int:
    """Index of joint_2."""
    return int(name.rpartition("_")[2]) - 1


class Whole:
    """Base class: hooks give back what they got, or nothing.

    Attributes:
        name: of the effect, with its joint where it has one: ``compliance@joint_2``.
        parameters: full names of its strengths -> unit.
    """

    name: str = ""
    at_the_channel = False  # acts where torques are recorded: its own columns are of what is recorded already
    like_a_bristle = False  # shifts forces along the motion as a law's bristle does, which may have been bent to it

    def __init__(self) -> None:
        self.parameters: dict[str, str] = {}

    @classmethod
    def said(cls) -> str:
        """Its first paragraph."""
        return " ".join((cls.__doc__ or "").split("\n\n")[0].split())

    def possible(self, step: Sequence[float] | np.ndarray) -> bool:
        """Whether strengths have a sign that they can have."""
        return True

    def load(self, model: Model, trial: Prepared) -> np.ndarray:
        """Torque that the joints transmit beside that of the bodies as declared, shape (n, joints)."""
        return np.zeros_like(trial.q)

    def shown(self, model: Model, trial: Prepared, torque: np.ndarray) -> np.ndarray:
        """What is recorded of torques, shape (n, joints)."""
        return torque

    def shown_change(self, model: Model, trial: Prepared, change: np.ndarray) -> np.ndarray:
        """The same of changes of torques, shape (n, joints, c)."""
        return change

    def column(self, model: Model, trial: Prepared, name: str, along: np.ndarray) -> np.ndarray:
        """Derivative of the torques in a strength, shape (n, joints); ``along`` is d torque / d load."""
        raise NotImplementedError


class GainError(Whole):
    """The torque constant of one motor is not the declared one: the channel shows 1 + gain_error times the torque.

    Units: dimensionless. Neutral: 0. Occurs: with motor constants from a data sheet, saturation, another gear ratio.
    Experiment: the same motion with a known payload.
    """

    at_the_channel = True

    def __init__(self, joint: str):
        super().__init__()
        self.name, self.joint, self.key = f"gain_error@{joint}", joint_of(joint), f"{joint}.gain_error"
        self.parameters = {self.key: "1"}

    def _factors(self, model: Model, count: int) -> np.ndarray:
        factors = np.ones(count)
        factors[self.joint] += model.values.get(self.key, 0.0)
        return factors

    def shown(self, model, trial, torque):
        return torque * self._factors(model, torque.shape[1])

    def shown_change(self, model, trial, change):
        return change * self._factors(model, change.shape[1])[:, None]

    def column(self, model, trial, name, along):
        result = np.zeros_like(trial.q)
        result[:, self.joint] = model.torques(trial)[0][:, self.joint]
        return result


class Coupling(Whole):
    """A motor acts on a neighbouring joint, too: the channel shows the joint's torque and a share of its neighbour's.

    Units: dimensionless, between joints that turn and slide 1/m or m. Neutral: 0. Occurs: in wrists and tendon drives
    whose coupling matrix was left out, with crosstalk of torque sensors. Experiment: move one of the two joints alone.
    """

    at_the_channel = True

    def __init__(self, joint: str, other: str, turns: Sequence[bool] | np.ndarray):
        super().__init__()
        self.name, self.joint, self.other = f"coupling@{joint}", joint_of(joint), joint_of(other)
        self.key = f"{joint}.coupling_{other}"
        apart = int(turns[self.joint]) - int(turns[self.other])
        self.parameters = {self.key: {0: "1", 1: "m", -1: "1/m"}[apart]}

    def shown(self, model, trial, torque):
        shown = torque.copy()
        shown[:, self.joint] += model.values.get(self.key, 0.0) * torque[:, self.other]
        return shown

    def shown_change(self, model, trial, change):
        return self.shown(model, trial, change)

    def column(self, model, trial, name, along):
        result = np.zeros_like(trial.q)
        result[:, self.joint] = model.torques(trial)[0][:, self.other]
        return result


class Delay(Whole):
    """One joint's torque is recorded later than its motion: the channel shows the torque of ``delay`` before.

    Never earlier: no channel shows a torque before it acts, and rows that are less than a sample apart have a lag.

    Units: s. Neutral: 0. Occurs: with filtered currents, clocks that differ. Experiment: fast reversals.
    """

    at_the_channel = True
    like_a_bristle = True

    def __init__(self, joint: str):
        super().__init__()
        self.name, self.joint, self.key = f"delay@{joint}", joint_of(joint), f"{joint}.delay"
        self.parameters = {self.key: "s"}

    def possible(self, step):
        return step[0] > 0

    def shown(self, model, trial, torque):
        late = model.values.get(self.key, 0.0)
        if not late:
            return torque
        shown = torque.copy()
        t = trial.t
        shown[:, self.joint] = np.interp(t - late, t, torque[:, self.joint])
        return shown

    def column(self, model, trial, name, along):
        result = np.zeros_like(trial.q)
        torque = model.torques(trial)[0][:, self.joint]
        result[:, self.joint] = -np.gradient(torque, trial.t)
        return result


class Lag(Whole):
    """Torques and positions of a row of a log are not of one instant: the channels show the torques of ``lag`` before.

    Less than a sample either way: a command is held until the next, a driver averages. Estimated with every model, its
    prior as wide as the sampling interval.

    Units: s. Neutral: 0. Occurs: in every log. Experiment: a faster log.
    """

    at_the_channel = True
    key = "robot.lag"

    def __init__(self) -> None:
        super().__init__()
        self.name, self.parameters = LAG, {self.key: "s"}

    def shown(self, model, trial, torque):
        return self.shown_change(model, trial, torque)

    def shown_change(self, model, trial, change):
        late = model.values.get(self.key, 0.0)
        return change - late * np.gradient(change, trial.t, axis=0) if late and len(change) == len(trial.t) else change

    def column(self, model, trial, name, along):
        return -np.gradient(model.torques(trial)[0], trial.t, axis=0)


class Compliance(Whole):
    """The gear twists under load, and the encoder is on the motor's side: the link stands compliance x load behind.

    Units: rad/(N m), of a joint that slides m/N. Neutral: 0. Occurs: in strain wave gears and belts.
    Experiment: fast motion of a stretched arm.
    """

    like_a_bristle = True

    def __init__(self, joint: str, turns: bool):
        super().__init__()
        self.name, self.joint, self.key = f"compliance@{joint}", joint_of(joint), f"{joint}.compliance"
        self.parameters = {self.key: "rad/(N*m)" if turns else "m/N"}

    def possible(self, step):
        return step[0] > 0

    def _direction(self, model: Model, trial: Prepared) -> np.ndarray:
        """d load / d compliance: the inverse dynamics along the twist, shape (n, joints).

        At the samples that its low-pass asks for, and by a spline between them: robots are slow to compute. The second
        rate of a load holds nothing but noise far above that low-pass, so all pass one of ``WIDER`` its cutoff before.
        """
        motion = [trial.filtered_at(WIDER * trial.cutoff_hz, x) for x in (trial.q, trial.v, trial.a)]
        load = trial.filtered_at(WIDER * trial.cutoff_hz, (trial.Y @ model.beta)[:, self.joint])
        smooth = _smooth(trial, load)
        step = max(int(1 / (PER_PERIOD * trial.cutoff_hz * (trial.t[1] - trial.t[0]))), 1)
        at = np.union1d(np.arange(0, len(trial.t), step), [len(trial.t) - 1])
        motion = [x[at] for x in motion]
        twist = [np.zeros_like(motion[0]) for _ in range(3)]
        for k, x in enumerate(twist):
            x[:, self.joint] = -smooth[k][at]
        size = 1e-6 / max(float(np.abs(smooth[2]).max()), 1e-12)
        sides = [
            model.base.reduced(
                model.robot.regressor(*(x + sign * size * d for x, d in zip(motion, twist, strict=True)))
            )
            for sign in (1, -1)
        ]
        return make_interp_spline(trial.t[at], ((sides[0] - sides[1]) @ model.beta) / (2 * size))(trial.t)

    def load(self, model, trial):
        strength = model.values.get(self.key, 0.0)
        return strength * self._direction(model, trial) if strength else np.zeros_like(trial.q)

    def column(self, model, trial, name, along):
        return along * self._direction(model, trial)


class Payload(Whole):
    """The last body carries a mass that was not declared, in the trials that are suspected of it.

    Units: kg, and kg m of the first moments in the frame of the last joint. Neutral: 0. Occurs: with a tool, a gripper,
    a workpiece. Experiment: the same motion without it.
    """

    def __init__(self, trials: tuple[str, ...] | None = None):
        super().__init__()
        self.name, self.trials = "payload", trials
        self.parameters = {"payload.mass": "kg", "payload.mx": "kg*m", "payload.my": "kg*m", "payload.mz": "kg*m"}

    def possible(self, step):
        return step[0] > 0

    def carried(self, trial: Prepared) -> bool:
        """Whether the trial may carry it."""
        return self.trials is None or any(carries(name, trial.name) for name in self.trials)

    def load(self, model, trial):
        values = np.array([model.values.get(name, 0.0) for name in self.parameters])
        if not values.any() or not self.carried(trial):
            return np.zeros_like(trial.q)
        return model.robot.payload_regressor(trial.full) @ values

    def column(self, model, trial, name, along):
        if not self.carried(trial):
            return np.zeros_like(trial.q)
        return along * model.robot.payload_regressor(trial.full)[:, :, list(self.parameters).index(name)]


def carries(suspected: str, trial: str) -> bool:
    """Whether a trial is a suspected one, ``loaded[1]``, or a part of it, ``loaded``."""
    return suspected in (trial, trial.partition("[")[0])


class BaseTilt(Whole):
    """The base does not stand level: gravity leans by small angles towards its x and y.

    What an upright robot's base parameters leave out, as the first moments of a body that turns about the vertical,
    acts on one that leans: ``base.tilt_NAME`` is such a parameter times the angle.

    Units: rad, and rad kg m. Neutral: 0. Occurs: with tables, rails and vehicles that are not level. Experiment: a
    spirit level.
    """

    def __init__(self, robot: Robot, base: Base) -> None:
        super().__init__()
        self.name = "base_tilt"
        self.parameters = {"base.tilt_x": "rad", "base.tilt_y": "rad"}
        self.hidden = _brought_to_light(robot, base)
        self.parameters |= {f"base.tilt_{robot.inertial_names[column]}": "rad*kg*m" for column in self.hidden}

    def _direction(self, model: Model, trial: Prepared, place: int) -> np.ndarray:
        """Torque by the parameter of this place, shape (n, joints)."""
        leaning = _leaning(model.robot, trial.q, place if place < 2 else 0)
        if place < 2:
            return model.base.reduced(leaning) @ model.beta
        return _beside(model.base, leaning)[:, :, list(model.base.others).index(self.hidden[place - 2])]

    def load(self, model, trial):
        total = np.zeros_like(trial.q)
        for place, name in enumerate(self.parameters):
            if value := model.values.get(name, 0.0):
                total = total + value * self._direction(model, trial, place)
        return total

    def column(self, model, trial, name, along):
        return along * self._direction(model, trial, list(self.parameters).index(name))


def _leaning(robot: Robot, q: np.ndarray, axis: int) -> np.ndarray:
    """Torque by the inertial parameters and by an angle of gravity towards x or y, shape (n, joints, 10 bodies)."""
    lean = np.zeros(3)
    lean[axis] = float(np.linalg.norm(robot.model.gravity.linear)) or G
    return robot.gravity_regressor(q, lean)


def _beside(base: Base, regressor: np.ndarray) -> np.ndarray:
    """Columns of the parameters that are in no base, the base parameters held, shape (n, joints, others)."""
    return regressor[..., base.others] - regressor[..., base.columns] @ base.mixing


def _brought_to_light(robot: Robot, base: Base) -> tuple[int, ...]:
    """Inertial parameters in no base that act where gravity leans, one for each function of the positions."""
    q = np.random.default_rng(0).uniform(-np.pi, np.pi, (10 * len(base.others), len(robot.joints)))
    columns = _beside(base, _leaning(robot, q, 0)).reshape(-1, len(base.others))
    R, order = qr(columns, mode="r", pivoting=True)
    sizes = np.abs(np.diag(R))
    rank = int(np.count_nonzero(sizes > TOLD * np.abs(columns).max() * len(columns) ** 0.5)) if columns.any() else 0
    return tuple(int(base.others[k]) for k in order[:rank])


def _smooth(trial: Prepared, values: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A torque, its rate and its second rate, shape (n,), by a quintic spline."""
    spline = make_interp_spline(trial.t, values, k=5)
    return spline(trial.t), spline(trial.t, 1), spline(trial.t, 2)
