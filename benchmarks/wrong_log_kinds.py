"""Kinds of wrong log, made from simulated and measured ones; what each must end in stands beside it."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd
from omegaconf import OmegaConf

from frictionpinn.data.noise import GaussianNoise
from frictionpinn.data.sets import load_emps
from frictionpinn.data.simulated import simulate_recording
from frictionpinn.physics import SYSTEMS

ROOT = Path(__file__).resolve().parents[1]
RATE, NOISE = 200.0, 0.02
TRUTH = {"pob": {"mu_c": 0.3, "sigma_2": 0.4}, "sdob": {"mu_c": 0.3, "sigma_2": 0.4},
         "drive": {"mu_c": 3.0, "sigma_2": 2.0}, "joint": {"mu_c": 2.0, "sigma_2": 1.0},
         "pendulum": {"mu_c": 0.4, "sigma_2": 0.05}, "damper": {"mu_c": 100.0, "sigma_2": 50.0}}  # fmt: skip
ARM = {"W_cos": 3.0, "W_sin": 1.0}
UR10E = "ur10e/ur-20_01_22-joint_2.csv.gz"
UR_COLUMNS = {"t": 0, "theta": 2, "omega": 8, "tau": 14}
UR_GAIN = 13.26  # N m / A
RIGHT = "right"  # no finding must name a fault: the answer is the right one
Change = Callable[[pd.DataFrame], pd.DataFrame]


def measured_folder() -> Path | None:
    """Where measured recordings lie, if they do."""
    folder = Path(os.environ.get("FRICTIONPINN_DATA") or ROOT.parent / "shared" / "measured")
    return folder if (folder / UR10E).is_file() else None


@cache
def _log(base: str) -> pd.DataFrame:
    if base == "emps":
        (trial,) = load_emps().select(["fit"]).trials
        return pd.DataFrame({"t": trial.t, **{n: trial.signals[n] for n in ("x", "v", "a", "force")}})
    if base == "ur10e":
        rows = np.genfromtxt(measured_folder() / UR10E, delimiter=",")[600:3600]
        table = pd.DataFrame({name: rows[:, k] for name, k in UR_COLUMNS.items()})
        return table.assign(tau=UR_GAIN * table.tau)
    conf = OmegaConf.to_container(OmegaConf.load(ROOT / "conf" / "system" / f"{base}.yaml"))
    system = SYSTEMS[base](**{**conf["parameters"], **(ARM if base == "joint" else {})})
    trials = conf["simulate"]["trials"][1:4]
    if base == "pendulum":
        trials = [{"duration": 4.0, "tau": "2.5*sin(3*t)", "initial": {"theta": 2.0 + k}} for k in range(3)]
    recording = simulate_recording(system, "coulomb_viscous", TRUTH[base], trials, RATE)
    noisy = GaussianNoise(NOISE)(recording, 3)
    parts = [pd.DataFrame({"trial": t.name, "t": t.t, **t.signals}) for t in noisy.trials]
    return pd.concat(parts, ignore_index=True)


def log(base: str) -> pd.DataFrame:
    """The log before anything is made wrong of it: 2 % noise at 200 Hz where it is simulated."""
    return _log(base).copy()


OPTIONS: dict[str, list[str]] = {
    "joint": [f"system.parameters.{n}={v}" for n, v in ARM.items()],
    "emps": ["system=drive", "system.parameters.M=95.1"],
    "ur10e": [
        "system=joint",
        "system.parameters.J=17.5",
        "system.parameters.W_cos=-140",
        "system.parameters.W_sin=1.9",
    ],
}


@dataclass(frozen=True)
class Kind:
    """One kind of wrong log.

    Attributes:
        base: log of which it is made.
        change: what is done to its columns.
        expect: pattern that names the fault in a finding, a note or an error; ``RIGHT``: the answer must be right.
        options: of the command line.
        header: whether the file has one.
        split: trials as files of their own, with this rate in Hz each where it is given.
    """

    base: str
    change: Change
    expect: str
    options: tuple[str, ...] = ()
    header: bool = True
    files: Callable[[pd.DataFrame], dict[str, pd.DataFrame]] | None = field(default=None)


def scaled(**factors: float) -> Change:
    return lambda d: d.assign(**{name: d[name] * factor for name, factor in factors.items()})


def exchanged(one: str, other: str) -> Change:
    return lambda d: d.assign(**{one: d[other], other: d[one]})


def clipped(name: str, share: float) -> Change:
    def change(d: pd.DataFrame) -> pd.DataFrame:
        middle, half = (d[name].max() + d[name].min()) / 2, share * (d[name].max() - d[name].min()) / 2
        return d.assign(**{name: d[name].clip(middle - half, middle + half)})

    return change


def _by_trial(d: pd.DataFrame, function: Callable[[pd.DataFrame], pd.DataFrame]) -> pd.DataFrame:
    if "trial" not in d:
        return function(d)
    return pd.concat([function(part.copy()) for _, part in d.groupby("trial", sort=False)], ignore_index=True)


def late(name: str, seconds: float) -> Change:
    def own(d: pd.DataFrame) -> pd.DataFrame:
        return d.assign(**{name: np.interp(d.t - seconds, d.t, d[name])})

    return lambda d: _by_trial(d, own)


def kept(*names: str) -> Change:
    return lambda d: d[[name for name in ("trial", "t", *names) if name in d]]


def rows(choose: Callable[[np.random.Generator, int], np.ndarray]) -> Change:
    """Rows by their numbers, of each trial."""
    return lambda d: _by_trial(d, lambda part: part.iloc[choose(np.random.default_rng(7), len(part))])


def jittered(d: pd.DataFrame) -> pd.DataFrame:
    """Steps of 0.5 to 1.5 of the usual one, as an arm's log has them: the signals at these times."""

    def own(part: pd.DataFrame) -> pd.DataFrame:
        step = float(part.t.diff().median())
        t = part.t.to_numpy() + np.random.default_rng(7).uniform(-0.25, 0.25, len(part)) * step
        t[[0, -1]] = part.t.iloc[[0, -1]]
        return part.assign(t=t, **{n: np.interp(t, part.t, part[n]) for n in part.columns if n not in ("t", "trial")})

    return _by_trial(d, own)


def _swap_rows(rng: np.random.Generator, n: int) -> np.ndarray:
    order = np.arange(n)
    for k in rng.choice(n - 2, n // 50, replace=False):
        order[[k, k + 1]] = order[[k + 1, k]]
    return order


def _repeated(rng: np.random.Generator, n: int) -> np.ndarray:
    return np.sort(np.concatenate([np.arange(n), rng.choice(n, n // 40, replace=False)]))


def _dropped(rng: np.random.Generator, n: int) -> np.ndarray:
    return np.flatnonzero(rng.uniform(size=n) > 0.1)


def _gap(rng: np.random.Generator, n: int) -> np.ndarray:
    return np.concatenate([np.arange(int(0.4 * n)), np.arange(int(0.6 * n), n)])


def wrapped(full: float, low: float, factor: float = 1.0) -> Change:
    return lambda d: d.assign(theta=(d.theta * factor - low) % full + low)


def noise_alone(*names: str) -> Change:
    def change(d: pd.DataFrame) -> pd.DataFrame:
        rng = np.random.default_rng(5)
        return d.assign(**{n: 0.02 * d[n].std() * rng.standard_normal(len(d)) for n in names})

    return change


def at_rates(d: pd.DataFrame) -> dict[str, pd.DataFrame]:
    parts = [part.drop(columns="trial") for _, part in d.groupby("trial", sort=False)]
    return {f"lap_{k + 1}.csv": part.iloc[:: k + 1] for k, part in enumerate(parts)}


def then(*changes: Change) -> Change:
    def change(d: pd.DataFrame) -> pd.DataFrame:
        for one in changes:
            d = one(d)
        return d

    return change


def same(d: pd.DataFrame) -> pd.DataFrame:
    return d


DEG, GRAVITY = 180 / np.pi, 9.80665
TURNED = r"sign of .* turned"
# Of an encoder's log: what is done to it, and what names it.
ALONE: dict[str, list[tuple[str, Change, str]]] = {
    "pob": [("x in mm", scaled(x=1e3), r"x in mm|1000"), ("sign of x", scaled(x=-1), TURNED)],
    "sdob": [("x and y in mm", scaled(x=1e3, y=1e3), r"in mm"), ("sign of the force", scaled(force=-1), TURNED)],
    "drive": [("x in mm", scaled(x=1e3), r"x in mm"), ("sign of the force", scaled(force=-1), TURNED)],
    "joint": [("theta in degrees", scaled(theta=DEG), r"in degrees"), ("sign of tau", scaled(tau=-1), TURNED)],
    "pendulum": [("theta in degrees", scaled(theta=DEG), r"in degrees"), ("sign of tau", scaled(tau=-1), TURNED)],
    "emps": [("x in mm", scaled(x=1e3), r"x in mm"), ("sign of the force", scaled(force=-1), TURNED)],
    "ur10e": [("theta in degrees", scaled(theta=DEG), r"in degrees"), ("sign of tau", scaled(tau=-1), TURNED)],
}


def alone(base: str, change: Change) -> Change:
    """The change of a log of positions and inputs alone."""
    names = {"pob": ("x", "theta"), "sdob": ("x", "y", "force"), "drive": ("x", "force"), "emps": ("x", "force")}
    return lambda d: change(kept(*names.get(base, ("theta", "tau")))(d))


KINDS: dict[str, Kind] = {
    # units
    "pob: x in mm": Kind("pob", scaled(x=1e3), r"x is too large by 1000"),
    "pob: v in mm/s": Kind("pob", scaled(v=1e3), r"v is too large by 1000"),
    "pob: a in mm/s^2": Kind("pob", scaled(a=1e3), r"a is too large by 1000"),
    "pob: a in g": Kind("pob", scaled(a=1 / GRAVITY), r"a is too small by 9.81"),
    "pob: x, v and a in mm": Kind("pob", scaled(x=1e3, v=1e3, a=1e3), r"x, v and a in mm"),
    "pob: x in inch": Kind("pob", scaled(x=39.3701), r"x is too large by 39.4"),
    "pob: theta in degrees": Kind("pob", scaled(theta=DEG), r"theta is too large by 57.3"),
    "pob: omega in degrees": Kind("pob", scaled(omega=DEG), r"omega is too large by 57.3"),
    "pob: alpha in degrees": Kind("pob", scaled(alpha=DEG), r"alpha is too large by 57.3"),
    "pob: omega in rpm": Kind("pob", scaled(omega=30 / np.pi), r"omega is too large by 9.55"),
    "pob: the whole link in degrees": Kind("pob", scaled(theta=DEG, omega=DEG, alpha=DEG), r"in degrees|turns"),
    "pob: time in ms": Kind("pob", scaled(t=1e3), r"time is off by a factor of 1000"),
    "drive: time in minutes": Kind("drive", scaled(t=1 / 60), r"time is off by a factor of 60"),
    "drive: force in mN": Kind("drive", scaled(force=1e3), r"1000|force in mN"),
    "drive: force in kN": Kind("drive", scaled(force=1e-3), r"0.001|force in kN"),
    "drive: force in V": Kind("drive", scaled(force=1 / 35.15), r"times the declared inertia"),
    "drive: x in cm": Kind("drive", scaled(x=1e2), r"x is too large by 100"),
    "drive: x, v and a in mm": Kind("drive", scaled(x=1e3, v=1e3, a=1e3), r"in mm"),
    "joint: torque in mN m": Kind("joint", scaled(tau=1e3), r"1000|tau in mN"),
    "joint: the whole motion in degrees": Kind("joint", scaled(theta=DEG, omega=DEG, alpha=DEG), r"in degrees"),
    "pendulum: the whole motion in degrees": Kind("pendulum", scaled(theta=DEG, omega=DEG, alpha=DEG), r"in degrees"),
    "sdob: y in mm": Kind("sdob", scaled(y=1e3), r"y is too large by 1000"),
    # signs
    "pob: sign of x": Kind("pob", scaled(x=-1), r"x has its sign turned"),
    "pob: sign of v": Kind("pob", scaled(v=-1), r"v has its sign turned"),
    "pob: sign of a": Kind("pob", scaled(a=-1), r"a has its sign turned"),
    "pob: sign of theta": Kind("pob", scaled(theta=-1), r"theta has its sign turned"),
    "pob: sign of omega": Kind("pob", scaled(omega=-1), r"omega has its sign turned"),
    "pob: sign of alpha": Kind("pob", scaled(alpha=-1), r"alpha has its sign turned"),
    "pob: sign of the whole link": Kind("pob", scaled(theta=-1, omega=-1, alpha=-1), r"theta, omega and alpha turned"),
    "pob: sign of the whole box": Kind("pob", scaled(x=-1, v=-1, a=-1), r"the sign of .* turned"),
    "drive: sign of the force": Kind("drive", scaled(force=-1), r"sign of force turned"),
    "joint: sign of the torque": Kind("joint", scaled(tau=-1), r"sign of tau turned"),
    "sdob: sign of the force": Kind("sdob", scaled(force=-1), r"sign of force turned"),
    "damper: sign of the force": Kind("damper", scaled(force=-1), r"friction would drive"),
    "pendulum: angle from hanging": Kind("pendulum", lambda d: d.assign(theta=d.theta - np.pi), r"pi added"),
    # swaps
    "pob: x and v swapped": Kind("pob", exchanged("x", "v"), r"x and v"),
    "pob: v and a swapped": Kind("pob", exchanged("v", "a"), r"v and a"),
    "pob: x and theta swapped": Kind("pob", exchanged("x", "theta"), r"x and theta|theta and x"),
    "pob: v and omega swapped": Kind("pob", exchanged("v", "omega"), r"v and omega"),
    "pob: omega and alpha swapped": Kind("pob", exchanged("omega", "alpha"), r"omega and alpha"),
    "drive: a and force swapped": Kind("drive", exchanged("a", "force"), r"a and force"),
    "drive: v is a copy of x": Kind("drive", lambda d: d.assign(v=d.x), r"v is not the rate|not the rate of v"),
    # clipping, delays, offsets, resolution
    "pob: a clipped": Kind("pob", clipped("a", 0.4), r"a stays at its very end.*clipped"),
    "pob: v clipped": Kind("pob", clipped("v", 0.5), r"v stays at its very end.*clipped"),
    "pob: theta clipped": Kind("pob", clipped("theta", 0.6), r"theta stays at its very end.*clipped"),
    "drive: force clipped": Kind("drive", clipped("force", 0.5), r"force stays at its very end"),
    "pob: v late by 20 ms": Kind("pob", late("v", 0.02), r"v comes .* ms late"),
    "pob: a late by 20 ms": Kind("pob", late("a", 0.02), r"a comes .* ms late"),
    "pob: theta late by 20 ms": Kind("pob", late("theta", 0.02), r"theta .*(late|early)|(late|early).* theta"),
    "pob: omega early by 15 ms": Kind("pob", late("omega", -0.015), r"omega comes .* ms early"),
    "drive: a with gravity in it": Kind("drive", lambda d: d.assign(a=d.a + GRAVITY), r"a has an offset"),
    "drive: v with a bias": Kind("drive", lambda d: d.assign(v=d.v + 2 * d.v.std()), r"v has an offset"),
    "pob: theta in 12 steps": Kind("pob", lambda d: d.assign(theta=np.round(d.theta / 0.2) * 0.2), r"steps of"),
    # clocks
    "pob: sampled unequally": Kind("pob", jittered, RIGHT),
    "pob: rows repeat": Kind("pob", rows(_repeated), RIGHT),
    "pob: rows come late": Kind("pob", rows(_swap_rows), RIGHT),
    "pob: samples dropped": Kind("pob", rows(_dropped), RIGHT),
    "pob: a gap": Kind("pob", rows(_gap), RIGHT),
    "drive: a gap": Kind("drive", rows(_gap), RIGHT),
    "drive: a clock with two digits": Kind("drive", lambda d: d.assign(t=d.t.round(2)), r"time repeats"),
    "pendulum: angle wrapped at pi": Kind("pendulum", wrapped(2 * np.pi, -np.pi), RIGHT),
    "pendulum: angle wrapped in degrees": Kind(
        "pendulum", wrapped(360.0, 0.0, DEG), RIGHT, ("data.units={theta: deg, default: SI}",)
    ),
    "pob: files of different rates": Kind("pob", same, RIGHT, files=at_rates),
    "pob: time of a second trial without a trial column": Kind("pob", lambda d: d.drop(columns="trial"), r"backwards"),
    # constant, missing
    "pob: a constant": Kind("pob", lambda d: d.assign(a=0.0), r"never changes"),
    "pob: the box stands": Kind("pob", lambda d: d.assign(x=0.1, v=0.0, a=0.0), r"never changes"),
    "pob: noise where the box should move": Kind("pob", noise_alone("x", "v", "a"), r"nothing slips"),
    "drive: force constant": Kind("drive", lambda d: d.assign(force=1.0), r"never changes"),
    "pob: no alpha": Kind("pob", kept("x", "v", "a", "theta", "omega"), RIGHT),
    "pob: positions alone": Kind("pob", kept("x", "theta"), RIGHT),
    "pob: velocities alone": Kind("pob", kept("v", "theta", "omega"), RIGHT),
    **{
        f"{base}, positions alone: {what}": Kind(base, alone(base, change), expect)
        for base in ALONE
        for what, change, expect in ALONE[base]
    },
    "drive: no force": Kind("drive", kept("x", "v", "a"), r"speeds up without force"),
    "drive: position and force": Kind("drive", kept("x", "force"), RIGHT),
    "drive: no header": Kind("drive", kept("t", "x", "v", "force"), r"no header row", header=False),
    # wrong system, wrong masses
    "a pendulum on a box as a pendulum": Kind(
        "pob", same, r"opposite signs|explains|declared inertia", ("system=pendulum",)
    ),
    "a drive as a damper": Kind("drive", same, r"inertia", ("system=damper",)),
    "a joint's arm left out": Kind("joint", same, r"W_cos", tuple(f"system.parameters.{n}=0" for n in ARM)),
    "drive: mass ten times": Kind("drive", same, r"declared inertia", ("system.parameters.M=10",)),
    "drive: mass a tenth": Kind("drive", same, r"declared inertia", ("system.parameters.M=0.1",)),
    "joint: inertia five times": Kind("joint", same, r"declared inertia", ("system.parameters.J=5",)),
    "pob: box ten times": Kind("pob", same, r"declared inertia", ("system.parameters.m_b=5",)),
    "pendulum: arm three times": Kind("pendulum", same, r"declared inertia", ("system.parameters.l=1.5",)),
    # measured
    "EMPS as it is": Kind("emps", same, RIGHT),
    "EMPS: mass left at 1 kg": Kind("emps", same, r"M = 1\)|declared inertia", ("system.parameters.M=1",)),
    "EMPS: x in mm": Kind("emps", scaled(x=1e3), r"x is too large by 1000"),
    "EMPS: sign of v": Kind("emps", scaled(v=-1), r"v has its sign turned"),
    "EMPS: sign of the force": Kind("emps", scaled(force=-1), r"sign of force turned"),
    "EMPS: force in V": Kind("emps", scaled(force=1 / 35.15), r"declared inertia"),
    "EMPS: time in ms": Kind("emps", scaled(t=1e3), r"time is off by a factor of 1000"),
    "EMPS: v late by 40 ms": Kind("emps", late("v", 0.04), r"v comes .* ms late"),
    "EMPS: v and a swapped": Kind("emps", exchanged("v", "a"), r"v and a"),
    "UR10e, joint 2, as it is": Kind("ur10e", same, RIGHT),
    "UR10e: theta in degrees": Kind("ur10e", scaled(theta=DEG), r"theta is too large by 57.3|57.3"),
    "UR10e: sign of omega": Kind("ur10e", scaled(omega=-1), r"sign turned"),
    "UR10e: current for torque": Kind("ur10e", scaled(tau=1 / UR_GAIN), r"declared inertia|W_cos|explains"),
    "UR10e: sign of the torque": Kind("ur10e", scaled(tau=-1), r"sign of"),
    "UR10e: omega and theta swapped": Kind("ur10e", exchanged("omega", "theta"), r"omega|theta"),
    "UR10e: omega late by 50 ms": Kind("ur10e", late("omega", 0.05), r"omega comes .* ms late"),
    "UR10e: a gap": Kind("ur10e", rows(_gap), RIGHT),
}
