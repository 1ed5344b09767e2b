"""An online estimator of the friction force: one sample at a time, causal, with the bristle carried along."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from types import ModuleType
from typing import Any

import numpy as np

from ..data.recording import Recording, Trial
from ..errors import UserError, nearest
from ..numerics.bristle import resting_states, steady_bristles
from ..numerics.codegen import Kernels, pointer
from ..numerics.session import ALONE, Session
from ..numerics.tableau import METHOD
from ..numerics.whiteness import NORMAL_95
from ..physics.base import at_contact
from ..physics.mechanism import Mechanism
from .check import check_adapt, check_sensors, finite, parameter_vector
from .consistency import Consistency
from .layout import STATE, Layout, moved_by
from .reading import Reading
from .tuning import Tuning, tune

LONGEST = 20.0  # typical sample intervals: after a longer gap the estimator starts anew
SHARES = (0.02, 0.05, 0.1, 0.2, 0.5, 1.0)  # of the typical acceleration: what the model may leave out of a sample's
MOST = 2400  # samples of all training trials together on which the share is chosen
INEXACT = 1e-3  # of the force: the least standard deviation told, for what integrator and law leave out
RTOL = 1e-4  # of the integrator
RESTARTED = "restarted"  # after a gap; of every sample where the times are in another unit than they were tuned in
STATUS = {0: "ok", 1: "no solution", 2: "contact lost", 3: "no solution"}  # by the integrator's codes


def _recursions() -> ModuleType:
    """Import on first use: a new installation compiles the recursions then, in about half a minute."""
    from . import recursions

    return recursions


class OnlineEstimator:
    """Friction force of every contact from the newest sample and all before it, by a Kalman filter on the equation of
    motion.

    The filter's state is the mechanism's own (positions, velocities, bristle), every driven coordinate and input as a
    Wiener process, and parameters that adapt. A step integrates the compiled equations for every sigma point with the
    simulator's L-stable method, so a bristle that settles within microseconds or a sample of 10 ms do not matter; each
    sample corrects the state by what its sensors and their noise levels tell. While the contact sticks the force
    follows from the inertial load, while it slides from the law: the model carries what no single sample shows.

    Args:
        mechanism: system and friction law; effects may act on the mechanism, not on its sensors.
        parameters: values by name, SI units: identified, of a trained estimator, or known.
        tuning: see :func:`frictionpinn.online.tune`.
        adapt: parameter -> relative change per square root of a second of sliding; such a
            parameter is estimated along with the state.
        share: what the model may leave out of a sample's acceleration, relative to the typical one.
        covariance: of the logarithms of the parameters that adapt, at the start, in the order of ``adapt``; None: they
            are known exactly there. With a rate of 0 a parameter stays what it is, and its uncertainty, of an
            identification, counts in the interval.

    Raises:
        UserError: an unknown parameter or one without value, mu_s below mu_c, an effect on sensors.
    """

    def __init__(
        self,
        mechanism: Mechanism,
        parameters: Mapping[str, float],
        tuning: Tuning,
        adapt: Mapping[str, float] | None = None,
        share: float = SHARES[0],
        covariance: np.ndarray | None = None,
    ):
        check_sensors(mechanism)
        self.mechanism, self.tuning, self.adapt, self.share = mechanism, tuning, dict(adapt or {}), float(share)
        self.kernels = Kernels(mechanism)
        self.names = tuple(par.name for par in mechanism.parameters)
        self._p = parameter_vector(mechanism, self.names, parameters)
        check_adapt(self.adapt, self.names, self._p, covariance)
        self.covariance = np.zeros((len(self.adapt),) * 2) if covariance is None else np.asarray(covariance, float)
        self._consistency = Consistency()
        self._build()
        self.reset()

    @classmethod
    def fit(
        cls,
        mechanism: Mechanism,
        parameters: Mapping[str, float],
        recording: Recording,
        adapt: Mapping[str, float] | None = None,
        sigmas: Mapping[str, float] | None = None,
        tuning: Tuning | None = None,
        covariance: np.ndarray | None = None,
    ) -> OnlineEstimator:
        """Return an estimator tuned on training trials; ``share`` maximises the likelihood of its innovations there.

        Args:
            mechanism: see the class, also for ``parameters``, ``adapt`` and ``covariance``.
            parameters: by name, SI units.
            recording: training trials; the parameters are not changed by them.
            adapt: name -> relative change per square root of a second of sliding.
            sigmas: noise levels that are known, SI units.
            tuning: of the same sensors and trials, made before; None to make it here.
            covariance: of the parameters.
        """
        tuning = tuning or tune(mechanism, recording, sigmas)
        most = MOST // len(recording.trials)
        parts = [trial.part(slice(most)) for trial in recording.trials]
        told = {share: cls(mechanism, parameters, tuning, share=share).log_likelihood(parts) for share in SHARES}
        return cls(mechanism, parameters, tuning, adapt, max(told, key=told.__getitem__), covariance)

    def _compiled(self) -> tuple[Any, Any]:
        """The first entries of the equations: addresses, which hold in this process alone."""
        return pointer(self.kernels.plain.newton), pointer(self.kernels.plain.outputs)

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_equations": self._equations[2:]}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__ |= state
        self._equations = _recursions().Equations(*self._compiled(), *state["_equations"])

    def __repr__(self) -> str:
        values = dict(zip(self.names, self._p, strict=True))
        told = ", ".join(f"{name} {values[name]:.4g}" for name in self.adapt)
        return f"OnlineEstimator({self.mechanism.name}; signals {', '.join(self.signals)}; adapts {told or 'nothing'})"

    # building --------------------------------------------------------------------------------------------------
    def _build(self) -> None:
        m, here = len(self.mechanism.free), Layout.of(self.mechanism, self.kernels, self.tuning, self.adapt, self.share)
        self._layout, self._walks = here, np.array([rate**2 for rate in self.adapt.values()])
        self._equations = _recursions().Equations(
            *self._compiled(), METHOD.a, METHOD.c, METHOD.error, METHOD.order_error, here.chains, here.adapted, self._p,
            (m, *self.kernels.sizes[:3]), ALONE.lines(self.mechanism.clocks), here.atol, self.kernels.places, RTOL, 1.0,
            len(self.contacts), here.slips,
        )  # fmt: skip

    @property
    def signals(self) -> tuple[str, ...]:
        """Names of the measured signals that the estimator takes."""
        return self._layout.signals

    @property
    def contacts(self) -> tuple[str, ...]:
        """Names of the contacts; one without a name where the system has no other."""
        return self.kernels.contacts

    def reset(self) -> None:
        """Forget all samples; parameters that adapt return to their first values."""
        self._time: float | None = None
        self._consistency.clear()
        self._place(ALONE)
        here = self._layout
        self._X, self._P = np.zeros(here.size), np.zeros((here.size, here.size))
        self._X[here.kept :] = np.log(self._p[here.adapted])
        self._P[here.kept :, here.kept :] = self.covariance

    def _place(self, session: Session) -> None:
        self._equations = self._equations._replace(clocks=session.lines(self.mechanism.clocks))

    def _start(self, y: np.ndarray) -> np.ndarray:
        """State before the first sample: what it shows, and a wide guess at what it does not.

        Returns:
            the sample without what the state took from it, which must not correct it again.
        """
        m, n_s, here = len(self.mechanism.free), self.kernels.sizes[0], self._layout
        X, P, kept = self._X, self._P, here.kept
        X[:kept], P[:kept], P[:, :kept] = 0.0, 0.0, 0.0
        for (offset, *_), spread in zip(here.chains, here.spreads, strict=True):
            part = np.arange(offset, offset + len(spread))
            P[part, part] = spread**2
        for j, c in enumerate(self.mechanism.free):
            P[j, j], P[m + j, m + j] = (np.square(self.tuning.scales[c.name][:2]) * 9.0).tolist()
        for k, (kind, index) in enumerate(here.rows):  # position and velocity as measured, with the sensor's variance
            if kind == STATE and np.isfinite(y[k]):
                X[index], P[index, index] = y[k], here.variances[k]
        if n_s > 2 * m:
            self._start_bristle()
        taken = [kind == STATE and X[index] == value for (kind, index), value in zip(here.rows, y, strict=True)]
        return np.where(taken, np.nan, y)

    def _start_bristle(self) -> None:
        """At rest unless the first velocities say otherwise; the bristle anywhere that the contact can hold it."""
        X, P, m, n_s = self._X, self._P, len(self.mechanism.free), self.kernels.sizes[0]
        core, eq, now = _recursions(), self._equations, self._time or 0.0
        p, u = core.parameters(eq, X), core.inputs(eq, X, now)[0, :, 0].copy()
        state = resting_states(self.kernels, X[:n_s].copy(), u, p)
        sliding = state.copy()
        deviation = np.sqrt(P[np.arange(m, 2 * m), np.arange(m, 2 * m)])
        sliding[m : 2 * m] = np.where(np.abs(X[m : 2 * m]) > deviation, X[m : 2 * m], deviation)
        moves = bool((np.abs(X[m : 2 * m]) > 3 * deviation).any())
        if self.mechanism.memory:
            held, fast = steady_bristles(self.kernels, sliding, u, p), np.abs(X[m : 2 * m]) > 3 * deviation
            for i, k in enumerate(self.kernels.bristles):
                place, known = n_s - len(held) + i, bool(np.isfinite(held[i]))
                slips = bool((fast & moved_by(self.mechanism, self.kernels, self.contacts[k])).any())
                state[place] = held[i] if slips and known else 0.0
                P[place, place] = held[i] ** 2 if known else 0.0
        if not moves:
            state[m : 2 * m] = 0.0
        X[:n_s] = state

    # use -------------------------------------------------------------------------------------------------------
    def update(self, t: float, signals: Mapping[str, float]) -> Reading:
        """Take in one sample and return the friction force at that instant.

        Args:
            t: time, s, after that of the previous sample; intervals need not be equal. Effects that depend on the
                session take it as the session's.
            signals: any of ``self.signals``, SI units; what is missing or NaN is taken as not measured.

        Raises:
            UserError: a time that does not increase, a signal that the estimator does not know, a value that is no
                number. The estimator stays as it was.
        """
        core, here, y = _recursions(), self._layout, self._sample(signals)
        if not finite(t):
            raise UserError("not a finite time", where="t", received=repr(t), allowed="a number of seconds")
        if self._time is not None and not t > self._time:
            raise UserError("time does not increase", where="t", received=t, allowed=f"above {self._time} s")
        last, status = self._time, 0
        if last is None or t - last > LONGEST * self.tuning.interval:
            self._time = float(t)
            self._consistency.clear()
            y = self._start(y)
        else:
            status = core.predict(
                self._equations, self._X, self._P, here.kicks, self._walks, here.densities, last, t - last,
            )  # fmt: skip
        self._time = float(t)
        _, forces, variances, square, freedom = core.correct(
            self._equations, self._X, self._P, y, here.variances, here.rows, float(t)
        )
        reach = NORMAL_95 * np.sqrt(variances + (INEXACT * forces) ** 2)
        told = STATUS[status] if last is None or t - last <= LONGEST * self.tuning.interval else RESTARTED
        if not self._consistency.add(self._time, square, freedom) and told == "ok":
            told = "inconsistent"
        force, low, high = (
            float(values[0]) if len(values) == 1 else values for values in (forces, forces - reach, forces + reach)
        )
        return Reading(self._time, force, low, high, told, self.contacts)

    def _sample(self, signals: Mapping[str, float]) -> np.ndarray:
        y = np.full(len(self.signals), np.nan)
        if not isinstance(signals, Mapping):
            raise UserError("no table of signals", where="update", received=repr(signals),
                            allowed="numbers by name, {'v': 0.1}")  # fmt: skip
        for name, value in signals.items():
            if name not in self.signals:
                raise UserError(
                    "signal that the estimator was not tuned for",
                    where=name,
                    allowed=", ".join(self.signals),
                    fix=nearest(name, self.signals),
                )
            try:
                y[self.signals.index(name)] = np.nan if value is None else float(value)
            except (TypeError, ValueError):
                raise UserError("not a number", where=name, received=repr(value), allowed="a number, or nan") from None
        return y

    def filter(self, trial: Trial) -> dict[str, np.ndarray]:
        """Run over a trial from a fresh start, causally; an input that it has not is 0 throughout.

        Returns:
            force, low, high and std of the friction force, shape (n,); ``consistent``, whether the samples were as
            expected, shape (n,); each parameter that adapts, shape (n,), and ``log_likelihood`` of the innovations,
            shape (). With several contacts ``hinge.force`` and so on.

        Raises:
            UserError: no trial.
        """
        if not isinstance(trial, Trial):
            raise UserError("no trial", where="trial", received=type(trial).__name__,
                            allowed="one trial of a recording", fix="take recording.trials[0]")  # fmt: skip
        self.reset()
        self._place(trial.session)
        system, here, Y = self.mechanism.system, self._layout, np.full((len(trial.t), len(self.signals)), np.nan)
        inputs = [] if system.massless else [item.name for item in system.inputs]
        for k, name in enumerate(self.signals):
            if name in trial.signals:
                Y[:, k] = trial.signals[name]
            elif name in inputs:  # none was applied
                Y[:, k] = 0.0
        self._time = float(trial.t[0])
        Y[0] = self._start(Y[0])
        loglik, forces, variances, squares, freedoms, states = _recursions().run(
            self._equations, self._X, self._P, here.kicks, self._walks, here.densities,
            np.ascontiguousarray(trial.t, dtype=float), Y, here.variances, here.rows,
        )  # fmt: skip
        self._time = float(trial.t[-1])
        stds = np.sqrt(variances + (INEXACT * forces) ** 2)
        samples = zip(trial.t.tolist(), squares.tolist(), freedoms.tolist(), strict=True)
        consistent = np.array([self._consistency.add(*sample) for sample in samples])
        found = {"consistent": consistent}
        for contact, force, std in zip(self.contacts, forces.T.copy(), stds.T.copy(), strict=True):
            told = {"force": force, "low": force - NORMAL_95 * std, "high": force + NORMAL_95 * std, "std": std}
            found |= {at_contact(contact, name): values for name, values in told.items()}
        found |= dict(zip(self.adapt, np.exp(states[:, here.kept :]).T, strict=True))
        return found | {"log_likelihood": np.array(loglik)}

    def log_likelihood(self, trials: Iterable[Trial]) -> float:
        """Log-likelihood of the innovations over trials; -inf where the filter leaves the numbers."""
        total = float(sum(self.filter(trial)["log_likelihood"] for trial in trials))
        return total if np.isfinite(total) else -np.inf

    @property
    def parameters(self) -> dict[str, float]:
        """Current values of all parameters, SI units."""
        return dict(zip(self.names, _recursions().parameters(self._equations, self._X).tolist(), strict=True))

    @property
    def deviations(self) -> dict[str, float]:
        """Relative standard deviation of every parameter that adapts."""
        deviations = np.sqrt(self._P.diagonal()[self._layout.kept :])
        return dict(zip(self.adapt, deviations.tolist(), strict=True))
