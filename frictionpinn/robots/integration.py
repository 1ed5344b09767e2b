"""Simulation of a robot with friction in its joints, open loop or with a controller.

    tau = Y(q, v, a) pi + I_a a + F(v, load, z),    z' = f(z, v, load) of each joint's bristle.

The unknowns of an implicit stage with q_i = q_known + h gamma v_i, v_i = v_known + h gamma a_i are the accelerations
a_i alone: 1. each bristle's stage equation holds one joint and is solved first (:mod:`.joints`); 2. pinocchio gives
torque and derivatives of the bodies; 3. Newton's step solves

    [dY pi/dw (1 + dF/dload) + I_a + dF/dw] da = tau - Y pi - I_a a - F,
    d/dw = d/da + h gamma d/dv + (h gamma)^2 d/dq;

4. where it would carry the joints past rest, and so past the jump of dry friction, it is shortened to where its power
vanishes. Steps are those of the house's integrator: L-stable, order 3, with an estimate of the error; they end at every
sample, between which a controller's torque is held.

Source: Kvaerno, Singly diagonally implicit Runge-Kutta methods with an explicit first stage, BIT 44 (2004).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from ..data.noise import stream
from ..data.recording import Recording, Trial
from ..errors import UserError
from ..numerics.simulation import SimulationFailed
from ..numerics.tableau import METHOD
from .arm import Arm
from .joints import Joints, joints_of
from .recording import robot_units

Controller = Callable[[float, np.ndarray, np.ndarray], np.ndarray]

ROUNDS = 25  # of Newton in a stage, as in the house's integrator
CLOSE = 1e-2  # of the error that a step may make: how closely a stage is solved
SMALLEST = 1e-7  # of an interval, the least step
NARROWER = 40  # halvings of a Newton step: from any speed to the width of a regularised jump
SHARE = 0.5  # of the power that Newton's step begins with: what may be left the other way at its end


@dataclass(frozen=True)
class Motion:
    """What a robot did.

    Attributes:
        arm: that was simulated.
        t: s, shape (n,).
        q, v, a: positions, velocities, accelerations of the joints, shape (n, joints).
        torque: of the motors, right behind each sample, N m, shape (n, joints).
        friction, load: torque of friction, and what the joints transmit.
        z: bristles, rad, 0 of a joint without memory.
        measured: positions as the encoders show them.
        steps: taken.
    """

    arm: Arm
    t: np.ndarray
    q: np.ndarray
    v: np.ndarray
    a: np.ndarray
    torque: np.ndarray
    friction: np.ndarray
    load: np.ndarray
    z: np.ndarray
    measured: np.ndarray
    steps: int

    @property
    def energy(self) -> np.ndarray:
        """Kinetic and potential energy of bodies and motors, J, shape (n,)."""
        return self.arm.robot.energy(self.q, self.v)

    def recording(self, torque_noise: float = 0.0, seed: int = 0, name: str = "1") -> Recording:
        """What a logger records: ``q_1``, ``tau_1`` and so on, positions as the encoders show them.

        Args:
            torque_noise: standard deviation relative to each joint's rms torque.
            seed: of the noise.
            name: of the trial.
        """
        signals: dict[str, np.ndarray] = {}
        truth: dict[str, np.ndarray] = {}
        units = {n: u for n, u in robot_units(self.arm.robot).items() if n.partition("_")[0] in ("q", "v", "tau")}
        for k in range(self.q.shape[1]):
            tau, place = self.torque[:, k], f"tau_{k + 1}"
            size = torque_noise * float(np.sqrt(np.mean(tau**2)))
            signals[f"q_{k + 1}"] = self.measured[:, k]
            signals[place] = tau + size * stream(seed, name, place).standard_normal(len(tau))
            truth |= {f"q_{k + 1}": self.q[:, k], f"v_{k + 1}": self.v[:, k], place: tau,
                      f"F_{k + 1}": self.friction[:, k]}  # fmt: skip
        return Recording((Trial(name, self.t, signals, truth),), units, f"simulated {self.arm.robot.name}")


def pd(arm: Arm, reference: Callable[[float], tuple[np.ndarray, np.ndarray]], stiffness, damping) -> Controller:
    """tau = K (q_r - q) + D (v_r - v) + gravity(q): a joint controller as arms come with it.

    Args:
        reference: t -> q_r and v_r, shape (joints,).
        stiffness, damping: K and D, N m/rad and N m s/rad, of each joint or of all.
    """
    K, D = np.asarray(stiffness, float), np.asarray(damping, float)

    def torque(t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        wanted, speed = reference(t)
        rest = np.zeros((1, len(q)))
        return K * (wanted - q) + D * (speed - v) + arm.robot.inverse_dynamics(q[None], rest, rest)[0]

    return torque


def simulate(
    arm: Arm,
    t: np.ndarray,
    torque: np.ndarray | Controller,
    q0: Sequence[float],
    v0: Sequence[float] | None = None,
    *,
    encoder_step: float | Sequence[float] = 0.0,
    rtol: float = 1e-5,
    atol: float = 1e-6,
) -> Motion:
    """Simulate a robot.

    Args:
        arm: bodies and friction with their values.
        t: sample times, s, shape (n,), increasing.
        torque: of the motors, N m: samples of shape (n, joints), linear in between; or a controller f(t, q, v) that is
            asked at every sample and whose torque is held until the next.
        q0, v0: at first, rad and rad/s; without v0 at rest. Bristles begin where a joint at rest stays at rest if its
            static friction allows, and in steady sliding in a joint that moves.
        encoder_step: resolution, rad, of all joints or of each: the controller is shown positions rounded to it and
            their differences from sample to sample for velocities; 0: the truth.
        rtol, atol: error of a step, relative, and absolute of velocities.

    Raises:
        UserError: sizes or times that do not fit.
        SimulationFailed: no solution, or steps that would have to be too small.
    """
    t, joints = np.asarray(t, float), len(arm.names)
    if t.ndim != 1 or len(t) < 2 or not (np.diff(t) > 0).all():
        raise UserError("times that do not increase", where="t", received=f"{t.size} samples", allowed="two or more")
    start = [np.zeros(joints) if x is None else np.asarray(x, float) for x in (q0, v0)]
    for name, x in zip(("q0", "v0"), start, strict=True):
        if x.shape != (joints,) or not np.isfinite(x).all():
            raise UserError("not one number for each joint", where=name, received=x.tolist(),
                            allowed=f"{joints} numbers")  # fmt: skip
    given = None if callable(torque) else np.asarray(torque, float)
    if given is not None and (given.shape != (len(t), joints) or not np.isfinite(given).all()):
        raise UserError("torques that do not fit", where="torque", received=given.shape, allowed=f"{(len(t), joints)}")
    encoder = np.broadcast_to(np.asarray(encoder_step, float), (joints,))
    of_position = min(2.5e-3, (t[-1] - t[0]) / (len(t) - 1))  # s: as in the house's integrator
    run = _Run(arm, rtol, atol * np.r_[np.full(joints, of_position), np.ones(joints)])
    return run.over(t, torque if given is None else given, start[0], start[1], encoder)


class _Run:
    """One simulation: the state y = (q, v, memory of the joints), its rates (v, a, w)."""

    def __init__(self, arm: Arm, rtol: float, atol: np.ndarray):
        self.robot = arm.robot.with_inertia(arm.robot.inertial, np.zeros(len(arm.names)))
        self.arm, self.rtol = arm, rtol
        self.joints: Joints = joints_of(arm.mechanisms, [arm.own(k) for k in range(len(arm.names))])
        self.n = len(arm.names)
        self.atol = np.r_[atol, np.full(self.joints.count, atol[0])]
        self.largest = np.zeros(self.joints.count)
        self.taken = 0

    def over(self, t, torque, q0, v0, encoder) -> Motion:
        """Integrate over the samples."""
        n, joints = self.n, self.joints
        rest = np.zeros_like(q0)
        load = self.robot.linearised(q0, v0, rest)[0]
        seen = _rounded(q0, encoder)
        first = _asked(torque, float(t[0]), seen, v0) if callable(torque) else torque[0]
        y = np.r_[q0, v0, joints.start(q0, v0, load, first - load)]
        shown, applied, rates = [seen], [], np.zeros(n + joints.count)
        kept, h = [], (t[1] - t[0]) * 0.1
        for k, now in enumerate(t):
            if callable(torque):
                if k:
                    shown.append(_rounded(y[:n], encoder))
                    v = np.where(encoder > 0, (shown[k] - shown[k - 1]) / (now - t[k - 1]), y[n : 2 * n])
                    first = _asked(torque, float(now), shown[k], v)
                course = (first, np.zeros(n))
            else:
                after = min(k, len(t) - 2)
                course = (torque[k], (torque[after + 1] - torque[after]) / (t[after + 1] - t[after]))
            applied.append(course[0])
            if k == 0 or callable(torque):
                rates, _ = self._solved(y, 0.0, course[0], now, rates)
            kept.append((y, rates))
            if k + 1 < len(t):
                y, rates, h = self._interval(float(now), float(t[k + 1] - now), y, rates, course, h)
        return self._motion(t, kept, np.array(applied), np.array(shown) if callable(torque) else None, encoder)

    def _motion(self, t, kept, torque, shown, encoder) -> Motion:
        n = self.n
        y, a = np.array([item[0] for item in kept]), np.array([item[1][:n] for item in kept])
        q, v = y[:, :n], y[:, n : 2 * n]
        load = self.robot.inverse_dynamics(q, v, a)
        z = np.zeros_like(q)
        for k, place in enumerate(self.joints.bristles):
            if place >= 0:
                z[:, k] = y[:, 2 * n + place]
        friction = torque - load - self.arm.armature * a
        shown = _rounded(q, encoder) if shown is None else shown
        return Motion(self.arm, t, q, v, a, torque, friction, load, z, shown, self.taken)

    def _interval(self, now, interval, y, rates, course, h_next):
        """Steps over one interval: its end, the rates there, the next step size."""
        offset = 0.0
        while offset < interval:
            h = interval - offset
            if h_next < 0.999 * h:
                h /= np.ceil(h / h_next)
            made = self._step(now, offset, h, y, rates, course)
            size = np.inf if made is None else self._error(h, y, *made)
            if not size <= 1.0:
                if h < SMALLEST * interval:
                    raise SimulationFailed(now + offset, "the step became too small", "loosen rtol and atol, or check "
                                           "the parameters and torques there", self.taken)  # fmt: skip
                h_next = 0.25 * h if made is None else _next(h, size)
                continue
            y, rates = made[0], made[1][-1]
            self.largest = np.maximum(self.largest, np.abs(y[2 * self.n :]))
            self.taken += 1
            h_next = _next(h, size)
            offset = interval if offset + h >= interval * (1 - 1e-12) else offset + h
        return y, rates, h_next

    def _step(self, now, offset, h, y, rates, course):
        """One step of size h: the new state, the rates (a, w) and velocities of all stages; None where one fails."""
        n, a, c = self.n, METHOD.a, METHOD.c
        stages, speeds = [rates], [y[n : 2 * n]]
        for i in range(1, len(c)):
            known = y + h * (a[i, :i] @ np.hstack([np.array(speeds), np.array(stages)]))
            s, hg = offset + c[i] * h, h * a[i, i]
            found, _ = self._solved(known, hg, course[0] + s * course[1], now + s, stages[-1])
            if found is None:
                return None
            v = known[n : 2 * n] + hg * found[:n]
            stages.append(found)
            speeds.append(v)
        new = np.r_[known[:n] + hg * v, v, known[2 * n :] + hg * found[n:]]
        return new, stages, speeds

    def _error(self, h, y, new, stages, speeds) -> float:
        """Embedded estimate of the error, in units of what a step may make."""
        estimate = np.abs(h * (METHOD.error @ np.hstack([np.array(speeds), np.array(stages)])))
        size = np.maximum(np.abs(y), np.abs(new))
        size[2 * self.n :] = np.maximum(size[2 * self.n :], self.largest)
        return float(np.max(estimate / (self.atol + self.rtol * size)))

    def _solved(self, known, hg, tau, t, guess):
        """Rates (a, w) of a stage by Newton's method, and the matrix of its last step; None where it fails."""
        n = self.n
        a, w = guess[:n].copy(), guess[n:].copy()
        scale, previous, rate = (hg or 1.0), np.inf, 1.0
        residual, matrix = self._residual(known, hg, tau, t, a, w)
        for iteration in range(ROUNDS):
            if not (np.isfinite(residual).all() and np.isfinite(matrix).all()):
                return None, None
            step = np.linalg.solve(matrix, -residual)
            size = float(np.max(np.abs(step) * scale / self.atol[n : 2 * n]))
            if iteration and previous > 0:
                rate = max(size / previous, 1e-3)
            previous = size
            if size * min(rate, 1.0) < CLOSE or (iteration > 2 and size < 1e-2):
                a = a + step
                if len(w):
                    self._residual(known, hg, tau, t, a, w)  # the memory that belongs to it
                return np.r_[a, w], matrix
            a, residual, matrix = self._along(known, hg, tau, t, a, w, residual, step)
        return None, None

    def _along(self, known, hg, tau, t, a, w, residual, step):
        """Newton's step, shortened where it overshoots: its power step . R changes sign between 0 and 1."""
        first = float(step @ residual)
        low, high, share = 0.0, 1.0, 1.0
        for _ in range(NARROWER):
            tried = self._residual(known, hg, tau, t, a + share * step, w)
            power = float(step @ tried[0])
            if not first < 0 or (np.isfinite(power) and abs(power) <= SHARE * -first) or (share == 1.0 and power <= 0):
                break
            if power < 0:
                low = share
            else:
                high = share
            share = 0.5 * (low + high)
        return a + share * step, *tried

    def _residual(self, known, hg, tau, t, a, w):
        """R of the accelerations a, and its derivative; w becomes the rates of the memory that belongs to them."""
        n = self.n
        v = known[n : 2 * n] + hg * a
        q = known[:n] + hg * v
        load, by_q, by_v, by_a = self.robot.linearised(q, v, a)
        seen = np.stack([q, v, a, load], axis=1)
        F, slopes = self.joints.at(t, seen, known[2 * n :], hg, w)
        bodies = by_a + hg * (by_v + hg * by_q)
        own = self.arm.armature + slopes[:, 2] + hg * (slopes[:, 1] + hg * slopes[:, 0])
        return load + self.arm.armature * a + F - tau, bodies * (1 + slopes[:, 3:]) + np.diag(own)


def _asked(controller: Controller, t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
    """A controller's torque."""
    tau = np.asarray(controller(t, q, v), float)
    if tau.shape != q.shape or not np.isfinite(tau).all():
        raise UserError("a controller's torque that does not fit", where=f"t = {t:.4g} s", received=tau.tolist(),
                        allowed=f"{len(q)} finite numbers")  # fmt: skip
    return tau


def _rounded(q: np.ndarray, step: np.ndarray) -> np.ndarray:
    """Positions as encoders of a resolution show them."""
    return np.where(step > 0, step * np.round(q / np.where(step > 0, step, 1.0)), q)


def _next(h: float, size: float) -> float:
    """Step size from the last one and its error."""
    return h * min(5.0, max(0.2, 0.9 * (size + 1e-10) ** (-1.0 / METHOD.order_error)))
