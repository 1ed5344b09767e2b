"""Effects on a robot as a whole: its motors, its compliance, what it carries, how its base stands.

Each is a term with strengths that a neutral value of 0 switches off, like the effects of a contact, but in terms of the
rigid bodies' regressor, which no symbolic expression holds.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from .balance import Model
    from .motion import Prepared

G = 9.81
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

    Units: dimensionless. Neutral: 0. Occurs: in wrists and tendon drives whose coupling matrix was left out, with
    crosstalk of torque sensors. Experiment: move one of the two joints alone.
    """

    at_the_channel = True

    def __init__(self, joint: str, other: str):
        super().__init__()
        self.name, self.joint, self.other = f"coupling@{joint}", joint_of(joint), joint_of(other)
        self.key = f"{joint}.coupling_{other}"
        self.parameters = {self.key: "1"}

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

    Units: s. Neutral: 0. Occurs: with filtered currents, clocks that differ. Experiment: fast reversals.
    """

    at_the_channel = True

    def __init__(self, joint: str):
        super().__init__()
        self.name, self.joint, self.key = f"delay@{joint}", joint_of(joint), f"{joint}.delay"
        self.parameters = {self.key: "s"}

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

    Units: rad/(N m). Neutral: 0. Occurs: in strain wave gears and belts. Experiment: fast motion of a stretched arm.
    """

    def __init__(self, joint: str):
        super().__init__()
        self.name, self.joint, self.key = f"compliance@{joint}", joint_of(joint), f"{joint}.compliance"
        self.parameters = {self.key: "rad/(N*m)"}

    def possible(self, step):
        return step[0] > 0

    def _direction(self, model: Model, trial: Prepared) -> np.ndarray:
        """d load / d compliance: the inverse dynamics along the twist, shape (n, joints)."""
        load = (trial.Y @ model.beta)[:, self.joint]
        smooth = _smooth(trial, load)
        twist = [np.zeros_like(trial.q) for _ in range(3)]
        for k, x in enumerate(twist):
            x[:, self.joint] = -smooth[k]
        size = 1e-6 / max(float(np.abs(smooth[2]).max()), 1e-12)
        sides = [
            model.base.reduced(
                model.robot.regressor(
                    *(x + sign * size * d for x, d in zip((trial.q, trial.v, trial.a), twist, strict=True))
                )
            )
            for sign in (1, -1)
        ]
        return ((sides[0] - sides[1]) @ model.beta) / (2 * size)

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
        return self.trials is None or trial.name.partition("[")[0] in self.trials or trial.name in self.trials

    def load(self, model, trial):
        values = np.array([model.values.get(name, 0.0) for name in self.parameters])
        if not values.any() or not self.carried(trial):
            return np.zeros_like(trial.q)
        return model.robot.payload_regressor(trial.full) @ values

    def column(self, model, trial, name, along):
        if not self.carried(trial):
            return np.zeros_like(trial.q)
        return along * model.robot.payload_regressor(trial.full)[:, :, list(self.parameters).index(name)]


class BaseTilt(Whole):
    """The base does not stand level: gravity leans by small angles towards its x and y.

    Units: rad. Neutral: 0. Occurs: with tables, rails and vehicles that are not level. Experiment: a spirit level.
    """

    def __init__(self) -> None:
        super().__init__()
        self.name = "base_tilt"
        self.parameters = {"base.tilt_x": "rad", "base.tilt_y": "rad"}

    def _direction(self, model: Model, trial: Prepared, axis: int) -> np.ndarray:
        lean = np.zeros(3)
        lean[axis] = float(np.linalg.norm(model.robot.model.gravity.linear)) or G
        return model.base.reduced(model.robot.gravity_regressor(trial.q, lean)) @ model.beta

    def load(self, model, trial):
        total = np.zeros_like(trial.q)
        for axis, name in enumerate(self.parameters):
            if value := model.values.get(name, 0.0):
                total = total + value * self._direction(model, trial, axis)
        return total

    def column(self, model, trial, name, along):
        return along * self._direction(model, trial, list(self.parameters).index(name))


def _smooth(trial: Prepared, values: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A torque, its rate and its second rate, shape (n,), by a quintic spline."""
    from scipy.interpolate import make_interp_spline

    spline = make_interp_spline(trial.t, values, k=5)
    return spline(trial.t), spline(trial.t, 1), spline(trial.t, 2)
