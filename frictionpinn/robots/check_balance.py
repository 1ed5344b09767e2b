"""Whether a robot's torques go with its motion: signs, units, swapped columns, gravity, friction that brakes, delays.

The masses of a robot file are good to some ten per cent, so each joint's filtered torque is a regression on what the
file says,

    tau_i = g_i (gravity_i) + m_i (inertia and rates_i) + I_i a_i + mu_i sign v_i + sigma_i v_i + offset_i,

with g_i and m_i near 1. What is wrong shows in these numbers, and in whether another reading explains the torques.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..data.findings import Finding, listed, named_factor
from ..data.thresholds import ANOTHER, EXPLAINED, HALF, LATE, SURE
from ..physics.robot import Robot
from .motion import Prepared

LIMIT = 3.0  # times what the file's masses ask for: nothing that is carried and no gain is as far off
CAD = 1.5  # times: masses in robot files are off by less where links carry nothing
LEVEL = 0.01  # of the torque: friction below is none that a gear has
APART = 5.0  # compared samples, at 2.5 a period of the low-pass, over which residuals stay alike


@dataclass(frozen=True)
class Fitted:
    """A joint's regression: coefficients of gravity, inertia, armature, Coulomb, viscous, offset; standard errors; the
    share of the torque's variance that it explains, and its residual, filtered."""

    c: np.ndarray
    errors: np.ndarray
    share: float
    residual: np.ndarray

    def sure(self, k: int, value: float) -> bool:
        """Whether a coefficient is another than ``value``."""
        return bool(abs(self.c[k] - value) > SURE * self.errors[k])


def regress(columns: np.ndarray, tau: np.ndarray, apart: float) -> Fitted:
    """Least squares; ``apart``: samples that are correlated, by which errors are widened."""
    scale = np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    W = columns / scale
    keep = scale > 1e-9 * scale.max()
    c = np.zeros(columns.shape[1])
    solved, *_ = np.linalg.lstsq(W[:, keep], tau, rcond=1e-10)
    c[keep] = solved / scale[keep]
    residual = tau - columns @ c
    variance = float(residual @ residual) / max(len(tau) - len(c), 1) * apart
    errors = np.full(len(c), np.inf)
    errors[keep] = np.sqrt(variance * np.maximum(np.diag(np.linalg.pinv(W[:, keep].T @ W[:, keep], rcond=1e-12)), 0))
    errors[keep] /= scale[keep]
    return Fitted(c, errors, 1 - float(residual.var()) / max(float(tau.var()), 1e-300), residual)


def torque_columns(robot: Robot, trials: Sequence[Prepared]) -> list[np.ndarray]:
    """Columns of each joint's regression, filtered, shape (m, 6)."""
    parts = []
    for trial in trials:
        gravity = robot.gravity_regressor(trial.q, robot.model.gravity.linear) @ robot.inertial
        whole = trial.full @ robot.inertial
        one = np.ones_like(whole)
        made = [gravity, whole - gravity, trial.a, np.sign(trial.v), trial.v, one]
        parts.append(trial.filtered(np.stack(made, axis=2)))
    together = np.concatenate(parts)
    return [together[:, k] for k in range(together.shape[1])]


def balance_findings(robot: Robot, trials: Sequence[Prepared], motor: bool) -> list[Finding]:
    """Torques against the motion, joint by joint."""
    if len(robot.massless) == len(robot.joints):
        return [Finding("the robot file has no masses: torques could not be held against the motion")]
    columns, tau = torque_columns(robot, trials), np.concatenate([t.tau for t in trials])
    own = [regress(C, tau[:, k], APART) for k, C in enumerate(columns)]
    names = [f"tau_{k + 1}" for k in range(len(own))]
    if swapped := _swapped(robot, trials, columns, tau, own):
        return [swapped]
    findings: list[Finding] = []
    turned = [k for k, f in enumerate(own) if _sign(f, columns[k]) < 0]
    gravity = [k for k, f in enumerate(own) if _part(f, columns[k], 0) > 0.1 and f.sure(0, 0.0)]
    upside = [k for k in gravity if own[k].c[0] < -1 / CAD and k not in turned]
    if len(turned) == len(own) or (turned and not upside):
        which = "every torque" if len(turned) == len(own) else listed([names[k] for k in turned])
        findings.append(
            Finding(
                f"{which} acts against gravity and motion: the sign is turned",
                "turn it: robot.gear or robot.gains negative, or the column",
                grave=True,
            )
        )
    elif upside and len(upside) == len(gravity):
        findings.append(
            Finding(
                "gravity pulls the other way than the robot file says",
                "say how the base hangs: robot.gravity=[0,0,9.81]",
                grave=True,
            )
        )
    if findings:
        return findings
    if robot.massless:
        findings.append(
            Finding(
                f"the robot file gives no mass to what {listed(robot.massless)} move{'s' * (len(robot.massless) == 1)}",
                "add its <inertial>; robot.inertia=free estimates it",
            )
        )
    if leaning := _leaning(robot, trials, columns, tau, own):
        return [leaning]
    for k, f in enumerate(own):
        if f.share < HALF:
            findings.append(
                Finding(
                    f"{names[k]} does not go with the motion: bodies, friction and an offset explain "
                    f"{100 * max(f.share, 0):.0f} % of it",
                    "check its column, units and joint",
                    grave=f.share < 0.2,
                )
            )
            continue
        told = [c for c in (0, 1) if _part(f, columns[k], c) > 0.1 and f.sure(c, 1.0)]
        place = min(told, key=lambda c: float(f.errors[c]), default=0)  # gravity's or inertia's, what is known better
        factor = float(f.c[place])
        if told and not 1 / CAD < factor < CAD:
            off = f"a factor of {named_factor(factor)}"
            what = f"{names[k]} is {factor:.3g} times what the robot file's masses ask for, {off}"
            advice = "check its unit, gain and gear ratio, or a payload; robot.inertia=free fits other masses"
            most = _part(f, columns[k], place) > HALF  # of what carries little a file may know little
            findings.append(Finding(what, advice, grave=most and not 1 / LIMIT < factor < LIMIT))
        friction = float(np.sqrt(np.mean((columns[k][:, 3:5] @ f.c[3:5]) ** 2)))
        brakes = float(np.mean((columns[k][:, 3:5] @ f.c[3:5]) * columns[k][:, 4]))
        if (
            brakes < 0
            and max(abs(f.c[3] / f.errors[3]), abs(f.c[4] / f.errors[4])) > SURE
            and friction > LEVEL * tau[:, k].std()
        ):
            findings.append(
                Finding(
                    f"friction in joint_{k + 1} would drive the motion",
                    f"check sign and clock of {names[k]}",
                    grave=True,
                )
            )
        elif motor and friction < LEVEL * tau[:, k].std():
            findings.append(
                Finding(
                    f"{names[k]} holds no friction ({100 * friction / tau[:, k].std():.1f} % of it)",
                    "if it was measured behind the gear say robot.torque=link",
                )
            )
    if not motor:
        shares = [
            float(np.sqrt(np.mean((C[:, 3:5] @ f.c[3:5]) ** 2)) / tau[:, k].std())
            for k, (C, f) in enumerate(zip(columns, own, strict=True))
        ]
        if float(np.median(shares)) > 0.1:
            findings.append(
                Finding(
                    f"torques hold {100 * float(np.median(shares)):.0f} % friction",
                    "they seem to be the motors': robot.torque=motor",
                )
            )
    return findings + _late(trials, columns, tau, own)


def _part(f: Fitted, C: np.ndarray, place: int) -> float:
    """Size of a column's part in the torque."""
    return float(abs(f.c[place]) * np.std(C[:, place]) / max(float(np.std(C @ f.c)), 1e-300))


def _sign(f: Fitted, C: np.ndarray) -> int:
    """-1 where bodies and friction all say that the torque is turned, 1 where one of them says that it is not."""
    told = [
        np.sign(f.c[k]) for k in (0, 1, 3, 4) if f.sure(k, 0.0) and np.std(C[:, k] * f.c[k]) > 0.05 * np.std(C @ f.c)
    ]
    return -1 if told and all(s < 0 for s in told) else 1


def _swapped(
    robot: Robot, trials: Sequence[Prepared], columns: Sequence[np.ndarray], tau: np.ndarray, own: Sequence[Fitted]
) -> Finding | None:
    """Two columns of torque, or of position, that were given to each other's joints."""
    n = len(own)
    before = float(np.mean([f.share for f in own]))
    best: tuple[float, str] = (before, "")
    for i in range(n):
        for j in range(i + 1, n):
            pair = [regress(columns[i], tau[:, j], 1.0), regress(columns[j], tau[:, i], 1.0)]
            if not all(_plausible(f) for f in pair):
                continue
            share = before + (sum(f.share for f in pair) - own[i].share - own[j].share) / n
            if share > best[0] and min(own[i].share, own[j].share) < EXPLAINED < min(f.share for f in pair):
                best = share, f"tau_{i + 1} and tau_{j + 1}"
            if min(f.share for f in own) > EXPLAINED and all(_plausible(f) for f in own):
                continue
            order = list(range(n))
            order[i], order[j] = j, i
            moved = [
                replace(
                    t,
                    q=t.q[:, order],
                    v=t.v[:, order],
                    a=t.a[:, order],
                    full=robot.regressor(t.q[:, order], t.v[:, order], t.a[:, order]),
                )
                for t in trials
            ]
            fits = [regress(C, tau[:, k], 1.0) for k, C in enumerate(torque_columns(robot, moved))]
            share = float(np.mean([f.share for f in fits]))
            if share > best[0] + 0.05 and all(_plausible(f) for f in fits):
                best = share, f"q_{i + 1} and q_{j + 1}"
    if not best[1]:
        return None
    return Finding(
        f"{best[1]} are swapped: so the bodies explain {100 * best[0]:.0f} % of the torques, as given "
        f"{100 * before:.0f} %",
        "swap their columns, or name robot.joints in their order",
        grave=True,
    )


def _plausible(f: Fitted) -> bool:
    """Whether masses are as in the file up to a factor, and friction brakes, as far as the regression is sure."""
    bodies = all(not f.sure(k, 0.0) or (1 / (2 * ANOTHER) < f.c[k] < 2 * ANOTHER) for k in (0, 1))
    return bodies and (f.c[3] > 0 or not f.sure(3, 0.0))


def _leaning(
    robot: Robot, trials: Sequence[Prepared], columns: Sequence[np.ndarray], tau: np.ndarray, own: Sequence[Fitted]
) -> Finding | None:
    """Another direction of gravity that explains the torques of all joints together."""
    size = float(np.linalg.norm(robot.model.gravity.linear))
    if not size or (min(f.share for f in own) > EXPLAINED and all(_plausible(f) for f in own)):
        return None
    parts = [
        np.concatenate([t.filtered(robot.gravity_regressor(t.q, size * e) @ robot.inertial) for t in trials])
        for e in np.eye(3)
    ]
    n, m = len(own), len(tau)
    W, level = np.zeros((n * m, 3 + 4 * n)), np.maximum(tau.std(axis=0), 1e-9)
    for k in range(n):
        rows = slice(k * m, (k + 1) * m)
        W[rows, :3] = np.stack([p[:, k] for p in parts], axis=1) / level[k]
        W[rows, 3 + 4 * k : 7 + 4 * k] = columns[k][:, 2:] / level[k]
    wanted = np.concatenate([(tau[:, k] - columns[k][:, 1]) / level[k] for k in range(n)])
    c = np.linalg.lstsq(W, wanted, rcond=1e-10)[0]
    share = 1 - float(np.var(wanted - W @ c))
    before = float(np.mean([f.share for f in own]))
    direction = c[:3] / max(float(np.linalg.norm(c[:3])), 1e-9)
    lean = np.degrees(np.arccos(np.clip(direction @ robot.model.gravity.linear / size, -1, 1)))
    if share < max(EXPLAINED, before) or lean < 15 or not 1 / CAD < np.linalg.norm(c[:3]) < CAD:
        return None
    told = ", ".join(f"{size * x:.2f}" for x in direction)
    return Finding(
        f"gravity pulls along [{told}] in the frame of the base, {lean:.0f} degrees from what is declared",
        f"say robot.gravity=[{told.replace(' ', '')}]",
        grave=True,
    )


def _late(
    trials: Sequence[Prepared], columns: Sequence[np.ndarray], tau: np.ndarray, own: Sequence[Fitted]
) -> list[Finding]:
    """Torques that come late or early: by what the rate of the bodies' torque would take off.

    That of friction is set aside: friction that builds up over a displacement comes late, too.
    """
    edges = np.cumsum([len(t.tau) for t in trials])[:-1]
    late = []
    for k, f in enumerate(own):
        parts = [columns[k][:, :3] @ f.c[:3], columns[k][:, 3:] @ f.c[3:]]
        rates = [
            np.concatenate(
                [np.gradient(x, trial.compared) for x, trial in zip(np.split(part, edges), trials, strict=True)]
            )
            for part in parts
        ]
        found = regress(np.stack([*rates, np.ones(len(tau))], axis=1), f.residual, APART)
        if found.sure(0, 0.0) and abs(found.c[0]) > LATE * float(np.std(parts[0]) / max(np.std(rates[0]), 1e-300)):
            late.append((k, -float(found.c[0])))
    if not late:
        return []
    told = listed([f"tau_{k + 1} {1e3 * delay:+.1f} ms" for k, delay in late])
    return [
        Finding(f"torques come late (+) or early (-) against the motion: {told}", "check filters, clocks and columns")
    ]
