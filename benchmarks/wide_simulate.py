"""Equations of motion and friction of benchmarks/wide.py, written out again: nothing of the package simulates here.

A trial is integrated by LSODA with the slip position s, the slip velocity v and the bristle's force f as states:

    (M + inertia) v' = push - F,    F = f + sigma_1 z' + sigma_2 v + what the effects add,    f' = sigma_0 z',
    z' = v - |v| f / g,    g = N' (mu_c + (mu_s - mu_c) exp(-(v/v_s)^2)),    N' the load after the effects.

M, push and N follow from Lagrange's equations of each system, where a path may be imposed on another coordinate. A law
without memory has f = g tanh(v / TURN) instead, which creeps below TURN where it rests; an asymmetry turns as it does,
so that a contact breaks away to either side in the same proportion in which it slides. (The limit of stiff bristles is
another law: they hold a body whose push falls more slowly than its load, although the force exceeds g.)
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass

import numpy as np
from numba import njit
from scipy.integrate import ODEintWarning, odeint

KINDS = ("pob", "sdob", "drive", "pendulum")
LAW = ("sigma_0", "sigma_1", "sigma_2", "mu_c", "mu_s", "v_s", "turn")
EFFECTS = (
    "constant_force", "spring_stiffness", "spring_rest", "drag", "asymmetry", "asymmetric_viscous",
    "position_gradient", "drift", "inertia", "vibration_sin", "vibration_cos", "vibration_frequency", "load_exponent",
    "load_reference", "begun", "position_middle",
)  # fmt: skip
SIGN = 1e-4  # slip per second over which a direction turns, in the effect asymmetry beside a bristle
TURN = 1e-7  # slip per second over which the friction of a law without memory turns: far below what anyone measures
RADIUS = 0.15  # m, of the contact in a hinge: turns newtons per metre into newton metres per radian
PARAMETERS = {
    "pob": ("m_b", "m_L", "d", "g"),
    "sdob": ("m_1", "m_2", "k", "c", "rest", "g"),
    "drive": ("M", "preload"),
    "pendulum": ("m", "l", "J", "g", "preload"),
}


@dataclass(frozen=True)
class Excitation:
    """offset + sum a exp(-r t) sin(p + w t + c t^2 + k sin(w t)): multisines, chirps, skewed sines and free decays.

    Attributes:
        tones: rows a, p, w, c, k, r, shape (n, 6).
        offset: constant.
    """

    tones: np.ndarray
    offset: float = 0.0

    def __call__(self, t: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Value, rate and second derivative at times t, three arrays of the shape of t."""
        out = np.array([_excited(float(x), self.tones, self.offset) for x in np.ravel(t)])
        return out[:, 0], out[:, 1], out[:, 2]

    def scaled(self, amplitude: float) -> Excitation:
        """The same with all amplitudes times a number."""
        tones = self.tones.copy()
        tones[:, 0] *= amplitude
        return Excitation(tones, self.offset)

    def expression(self, late: float = 0.0) -> str:
        """The same, ``late`` by so many seconds, as text for the package's simulator."""
        now = f"(t - {late:.15g})" if late else "t"
        parts = [f"{self.offset:.15g}"]
        for a, p, w, c, k, r in self.tones:
            inner = f"{p:.15g} + {w:.15g}*{now}" + (f" + {c:.15g}*{now}**2" if c else "")
            inner += f" + {k:.15g}*sin({w:.15g}*{now})" if k else ""
            parts.append((f"exp(-{r:.15g}*{now})*" if r else "") + f"{a:.15g}*sin({inner})")
        return " + ".join(parts)


@njit(cache=True)
def _excited(t, tones, offset):
    """Value and two time derivatives."""
    x, v, a = offset, 0.0, 0.0
    for i in range(tones.shape[0]):
        size, p, w, c, k, r = tones[i]
        size *= np.exp(-r * t)
        angle = p + w * t + c * t * t + k * np.sin(w * t)
        rate = w + 2 * c * t + k * w * np.cos(w * t)
        bend = 2 * c - k * w * w * np.sin(w * t)
        sine, cosine = np.sin(angle), np.cos(angle)
        x += size * sine
        v += size * (rate * cosine - r * sine)
        a += size * (bend * cosine - rate * rate * sine - 2 * r * rate * cosine + r * r * sine)
    return x, v, a


@njit(cache=True)
def _balance(kind, s, e, e_dot, e_ddot, p):
    """Inertia along the slip, force that pushes, normal force; e is the imposed path, or what the motor gives."""
    if kind == 0:  # pob: e is the link's angle
        arm = p[1] * p[2]
        push = -arm * (e_ddot * np.cos(e) - e_dot**2 * np.sin(e))
        return p[0] + p[1], push, (p[0] + p[1]) * p[3] - arm * (e_ddot * np.sin(e) + e_dot**2 * np.cos(e))
    if kind == 2:
        return p[0], e, p[1]
    return p[2] + p[0] * p[1] ** 2, e + p[0] * p[3] * p[1] * np.sin(s), p[4]


@njit(cache=True)
def _contact(kind, s, t, paths, p):
    """As :func:`_balance`, from the excitations at a time."""
    x, v, a = paths
    if kind == 1:  # sdob: the upper mass at its height presses, a force pushes
        return p[0] + p[1], a, p[0] * p[5] + p[2] * (p[4] - x) - p[3] * v
    return _balance(kind, s, x, v, a, p)


@njit(cache=True)
def _paths(kind, t, first, offset, second):
    """What :func:`_contact` takes of the excitations: of sdob the height, its rate and the pushing force."""
    x, v, a = _excited(t, first, offset)
    if kind == 1:
        a = _excited(t, second, 0.0)[0]
    return x, v, a


@njit(cache=True)
def _friction(s, v, f, t, N, law, q):
    """Friction force with the effects but without their inertia, and z'."""
    turn = law[6] if law[6] > 0.0 else SIGN
    load = N * (1 + q[4] * np.tanh(v / turn)) * (1 + q[6] * (s - q[15])) * (1 + q[7] * (q[14] + t))
    if q[12] != 0.0:
        load *= (max(N, 1e-9) / q[13]) ** q[12]
    g = max(load, 1e-9) * (law[3] + (law[4] - law[3]) * np.exp(-((v / law[5]) ** 2)))
    rate = v - abs(v) * f / g
    if law[6] > 0.0:
        f, rate = g * np.tanh(v / law[6]), 0.0
    force = f + law[1] * rate + law[2] * v + q[0] + q[1] * (s - q[2]) + q[3] * v * abs(v) + q[5] * abs(v)
    phase = 2 * np.pi * q[11] * t
    return force + q[9] * np.sin(phase) + q[10] * np.cos(phase), rate


@njit(cache=True)
def _rates(y, t, kind, p, first, offset, second, law, q):
    M, push, N = _contact(kind, y[0], t, _paths(kind, t, first, offset, second), p)
    F, rate = _friction(y[0], y[1], y[2], t, N, law, q)
    return np.array([y[1], (push - F) / (M + q[8]), law[0] * rate])


@njit(cache=True)
def _outputs(states, t, kind, p, first, offset, second, law, q):
    """Slip acceleration, friction force, normal force, z and z' at every sample, shape (n, 5)."""
    out = np.empty((len(t), 5))
    for i in range(len(t)):
        s, v, f = states[i]
        M, push, N = _contact(kind, s, t[i], _paths(kind, t[i], first, offset, second), p)
        F, rate = _friction(s, v, f, t[i], N, law, q)
        a = (push - F) / (M + q[8])
        out[i] = a, F + q[8] * a, N, f / law[0] if law[0] > 0.0 else 0.0, rate
    return out


@dataclass(frozen=True)
class Model:
    """A system with its friction and effects, as numbers.

    Attributes:
        kind: name of the system.
        system: its true parameters by name, payloads included.
        law: of LuGre by name; laws without memory through :func:`without_memory`.
        effects: by name, those left out are neutral; "begun": s from the start of the session, through which
            drift runs on, to that of the trial.
    """

    kind: str
    system: dict[str, float]
    law: dict[str, float]
    effects: dict[str, float]

    def run(self, excitations: tuple[Excitation, ...], start: np.ndarray, t: np.ndarray) -> dict[str, np.ndarray]:
        """Motion at the increasing times t from the state ``start`` (s, v, f) at t[0]; name -> array of shape (n,).

        Raises:
            ArithmeticError: the integration failed.
        """
        numbers = self._numbers(excitations)
        limits = {"atol": [1e-11, 1e-10, 1e-9], "mxstep": 100_000, "hmax": 5e-3}
        for rtol in (1e-9, 1e-8, 1e-7):  # jumps of a law without memory may ask too much of the smallest
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", ODEintWarning)
                states, info = odeint(_rates, start, t, numbers, full_output=True, rtol=rtol, **limits)
            if info["message"] == "Integration successful." and np.isfinite(states).all():
                break
        else:
            raise ArithmeticError(info["message"])
        out = _outputs(np.ascontiguousarray(states), t, *numbers)
        names = ("a", "friction_force", "normal_force", "z", "z_rate")
        return {"s": states[:, 0], "v": states[:, 1]} | {name: out[:, j] for j, name in enumerate(names)}

    def _numbers(self, excitations: tuple[Excitation, ...]) -> tuple:
        first, second = excitations[0], excitations[-1]
        neutral = {"load_reference": 1.0, "vibration_frequency": 1.0}
        return (
            KINDS.index(self.kind),
            np.array([self.system[name] for name in PARAMETERS[self.kind]]),
            np.ascontiguousarray(first.tones, dtype=float), float(first.offset),
            np.ascontiguousarray(second.tones, dtype=float),
            np.array([self.law.get(name, 0.0) for name in LAW]),
            np.array([float(self.effects.get(name, neutral.get(name, 0.0))) for name in EFFECTS]),
        )  # fmt: skip

    def balance(self, s: np.ndarray, a: np.ndarray, *paths: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Friction force that the motion asks for, and normal force; ``paths`` as the system's inputs are measured."""
        p = np.array([self.system[name] for name in PARAMETERS[self.kind]])
        kind = KINDS.index(self.kind)
        rows = [_contact(kind, float(x), 0.0, tuple(map(float, row)), p) for x, *row in zip(s, *paths, strict=True)]
        M, push, N = np.array(rows).T
        return push - M * a, N

    @property
    def inertia(self) -> float:
        """What the contact accelerates."""
        return float(_contact(KINDS.index(self.kind), 0.0, 0.0, (0.0, 0.0, 0.0),
                              np.array([self.system[name] for name in PARAMETERS[self.kind]]))[0])  # fmt: skip


def without_memory(law: dict[str, float]) -> dict[str, float]:
    """Parameters of LuGre's equations that stand for a law without memory."""
    return {"mu_s": law["mu_c"], "v_s": 1.0, "sigma_0": 0.0, "sigma_1": 0.0, "turn": TURN} | law
