"""A network inside the equation of motion, corrected by what is measured: an observer that knows no law.

The motion is integrated with the network's force, the driven coordinates and inputs as filtered causally, and every
sample moves position and velocity towards the measured ones by constant gains. The gain is the one of a short list
whose innovations are smallest on a training trial.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..data.contact import ContactTrial
from ..models import FrictionModel, StateEnsemble, StateModel
from ..numerics.paths import InputPath
from ..numerics.simulation import ContactLost, SimulationFailed
from ..physics import LAWS, System
from ..physics.mechanism import Mechanism
from .in_simulation import _Candidates, _March

GAINS = (0.02, 0.05, 0.1, 0.2, 0.4)  # of the velocity; of the position half as much
TUNED_ON = 400  # samples of the first training trial


class _Corrected(_March):
    """One step per sample; each is followed by the correction."""

    def __init__(self, system: System, model: FrictionModel, trial: ContactTrial, gain: float):
        mechanism = Mechanism(system, LAWS["coulomb"]())
        path = InputPath.from_signals(mechanism, trial.t, trial.filtered)
        names = [c.signals[k] for k in (0, 1) for c in mechanism.free]
        super().__init__(system, model, path, {name: float(trial.filtered[name][0]) for name in names}, 1)
        missing = np.full(len(trial.t), np.nan)
        self.seen = np.array([trial.measured.get(name, missing) for name in names]).T.reshape(len(trial.t), -1)
        self.gains = np.repeat([gain / 2, gain], self.m)
        self.slip_slope = [float(system.jacobian[c.name]) for c in mechanism.free]
        self.innovations = np.zeros_like(self.seen)

    def _keep(self, k: int, force: float, found: _Candidates) -> None:
        super()._keep(k, force, found)
        self.innovations[k] = np.nan_to_num(self.seen[k] - self.y[k])
        change = self.gains * self.innovations[k]
        self.y[max(k - 1, 0) : k + 1] += change  # the step before too: BDF2 would take a jump for a rate
        self.past["v_slip"][k] += float(np.dot(self.slip_slope, change[self.m :]))


def applies(system: System, model: FrictionModel) -> bool:
    """Whether such an observer is of use: the contact moves, and the network looks at no window of the past; one with
    a state is such an observer by itself.

    A network with windows, closed through the equation of motion, enters limit cycles at rest that no correction by
    measured velocity removes (mean square error of a PE2 on Traj. 2 above 1.6 N^2 at every gain).
    """
    free = () if system.massless else system.free
    constant = all(system.jacobian[c.name].is_number for c in free)
    return bool(free) and constant and model.features.length == 1 and not isinstance(model, StateModel | StateEnsemble)


class NetworkObserver:
    """Friction force along a trial, causally.

    Args:
        system: gives the equations.
        model: see :func:`applies`.
        train: training trials; the gain is chosen on the first.
    """

    def __init__(self, system: System, model: FrictionModel, train: Sequence[ContactTrial]):
        self.system, self.model = system, model
        misses = {gain: self._miss(train[0], gain) for gain in GAINS}
        self.gain = min(misses, key=misses.__getitem__)

    def _miss(self, trial: ContactTrial, gain: float) -> float:
        """Mean square of the velocities' innovations, and the positions', over the variance of what was measured."""
        march = _Corrected(self.system, self.model, _first(trial, TUNED_ON), gain)
        try:
            march.run()
        except (ContactLost, SimulationFailed):
            return np.inf
        scale = np.std(march.seen, axis=0)
        return float(np.nanmean((march.innovations / np.where(scale > 0, scale, 1.0)) ** 2))

    def __call__(self, trial: ContactTrial) -> np.ndarray:
        """Friction force, shape (n,); NaN throughout where no force satisfies the equation of motion at some time."""
        try:
            return _Corrected(self.system, self.model, trial, self.gain).run().F
        except (ContactLost, SimulationFailed):
            return np.full(len(trial.t), np.nan)


def _first(trial: ContactTrial, count: int) -> ContactTrial:
    """The first samples of a trial."""

    def cut(table: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        return {name: values[:count] for name, values in table.items()}

    return ContactTrial(
        trial.name, trial.t[:count], cut(trial.offline), cut(trial.online), cut(trial.rates), cut(trial.truth),
        cut(trial.measured), cut(trial.smoothed), cut(trial.filtered),
    )  # fmt: skip
