"""The figures of the concepts: computed by the package, drawn when the site is built."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import sympy as sp
from excitation_figures import experiments, sensitivities
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from verdict_figures import verdicts

import frictionpinn as fp
from frictionpinn.evaluate.style import INK
from frictionpinn.numerics.simulate import Simulator
from frictionpinn.physics import LAWS
from frictionpinn.physics.base import CONTACT

VALUES = {"sigma_0": 2e4, "sigma_1": 150.0, "sigma_2": 2.0, "mu_c": 3.0, "mu_s": 4.5, "v_s": 0.02}
RATE = 1000.0  # Hz


def draw_all(folder: Path) -> None:
    """Draw every figure into a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, make in FIGURES.items():
        make().savefig(folder / name, dpi=130)


def plain(axes: Axes) -> Axes:
    """Axes without a box."""
    axes.spines[["top", "right"]].set_visible(False)
    return axes


def imposed(x: np.ndarray, v: np.ndarray, a: np.ndarray, t: np.ndarray, **start: float):
    """What LuGre friction does on a drive whose motion is imposed."""
    mechanism = fp.mechanism(fp.system("drive", imposed=True), "lugre")
    return Simulator(mechanism).simulate(t, {"x": x, "v": v, "a": a, "force": np.zeros_like(t)}, VALUES, start)


def bristle() -> Figure:
    """A sketch of the model: bristles of a surface, bent by z, that slip off one after another."""
    figure = Figure(figsize=(8, 2.6), layout="constrained")
    axes = figure.subplots()
    axes.axis("off")
    axes.set(xlim=(0, 10), ylim=(-0.5, 2.7), aspect="equal")
    axes.fill_between([0.5, 6.6], 1.5, 2.1, color=INK["baseline"], lw=0)
    axes.fill_between([0, 10], -0.35, 0, color=INK["reference"], lw=0)
    height = np.linspace(0, 1, 30)
    for k, root in enumerate(np.linspace(0.9, 5.9, 9)):
        bend = 0.55 * height**2 if k % 4 != 3 else 0.04 * height
        axes.plot(root + bend, 1.5 - 1.5 * height * (0.97 if k % 4 != 3 else 0.9), color=INK["model"], lw=2.2)
    axes.annotate("", (8.6, 1.8), (6.8, 1.8), arrowprops={"arrowstyle": "->", "lw": 2, "color": INK["reference"]})
    axes.text(7.7, 2.0, "slip velocity v", ha="center")
    axes.annotate("", (1.45, 0.52), (0.9, 0.52), arrowprops={"arrowstyle": "<->", "lw": 1.2, "color": INK["reference"]})
    axes.plot([0.9, 0.9], [0.35, 1.5], color=INK["reference"], lw=0.8, ls=":")
    axes.text(0.72, 0.45, "z", ha="center", style="italic")
    axes.annotate("force of the bristles: sigma_0 z + sigma_1 dz/dt", (5.3, 0.75), (6.8, 0.75), va="center",
                  arrowprops={"arrowstyle": "-", "color": INK["model"]}, color=INK["model"])  # fmt: skip
    axes.text(3.5, 1.8, "normal force N presses, body slides", ha="center", va="center")
    return figure


def steady_curve() -> Figure:
    """Friction force in steady sliding over slip velocity."""
    law = LAWS["lugre"]()
    p = {par.symbol: VALUES.get(par.name, par.value) for par in law.parameters} | {CONTACT.N: 1.0}
    g = sp.lambdify(CONTACT.v, sp.sympify(law.capacity(CONTACT, law.symbols)).subs(p), "numpy")
    v = np.linspace(-0.25, 0.25, 2001)
    force = np.sign(v) * g(v) + VALUES["sigma_2"] * v
    figure = Figure(figsize=(7.5, 3.4), layout="constrained")
    axes = plain(figure.subplots())
    axes.plot(v, force, color=INK["model"], lw=2.2)
    axes.axhline(0, color=INK["reference"], lw=0.6)
    axes.axvline(0, color=INK["reference"], lw=0.6)
    level, top, fast = VALUES["mu_c"], VALUES["mu_s"], 0.25
    axes.plot([0, fast], [level, level], color=INK["baseline"], ls="--", lw=1)
    axes.text(-0.012, level, "Coulomb friction\nmu_c N", ha="right", va="center", color=INK["observer"])
    axes.text(-0.012, top, "static friction\nmu_s N", ha="right", va="center", color=INK["observer"])
    axes.plot([0, -0.008], [level, level], color=INK["observer"])
    axes.plot([0, -0.008], [top, top], color=INK["observer"])
    axes.axvline(VALUES["v_s"], 0.5, color=INK["baseline"], ls=":", lw=1.2)
    axes.text(VALUES["v_s"] + 0.004, 0.4, "Stribeck\nvelocity v_s", color=INK["observer"])
    axes.annotate("viscous friction:\nslope sigma_2", (0.2, level + VALUES["sigma_2"] * 0.2), (0.17, 1.3),
                  color=INK["observer"], arrowprops={"arrowstyle": "->", "color": INK["observer"]})  # fmt: skip
    axes.set(xlabel="slip velocity (m/s)", ylabel="friction force (N), N = 1 N", xlim=(-fast, fast), ylim=(-5.3, 5.6))
    return figure


def hysteresis() -> Figure:
    """Force over displacement while nothing slides, and once it does."""
    figure = Figure(figsize=(8, 3.3), layout="constrained")
    small, large = figure.subplots(1, 2)
    t = np.arange(0, 4, 1 / RATE)
    cases = ((small, 4e-5, INK["observer"], "not yet sliding: nearly a spring"),
             (large, 1e-3, INK["model"], "sliding: dry friction, built up over z"))  # fmt: skip
    for axes, reach, color, words in cases:
        w = 2 * np.pi
        run = imposed(reach * np.sin(w * t), reach * w * np.cos(w * t), -reach * w**2 * np.sin(w * t), t)
        later = t >= 1
        plain(axes).plot(1e6 * reach * np.sin(w * t[later]), run.F[later], color=color, lw=1.8)
        axes.set_title(words, fontsize=10)
        axes.set(xlabel="displacement (µm)", ylabel="friction force (N)")
    return figure


def breakaway() -> Figure:
    """A force ramp from rest: the body creeps by micrometres, then breaks away."""
    drive = fp.mechanism("drive", "lugre")
    log = fp.simulate(drive, VALUES, [{"duration": 1.0, "force": "5.5*t"}], rate_hz=RATE)
    trial = log.trials[0]
    figure = Figure(figsize=(8, 3.2), layout="constrained")
    left, right = figure.subplots(1, 2)
    plain(left).plot(trial.t, trial.signals["force"], color=INK["baseline"], lw=1.8, label="force that pulls")
    left.plot(trial.t, trial.truth["friction_force"], color=INK["model"], lw=1.8, label="friction force")
    peak = int(np.argmax(trial.truth["friction_force"]))
    left.annotate("breakaway", (trial.t[peak], trial.truth["friction_force"][peak]), (0.35, 4.9),
                  arrowprops={"arrowstyle": "->"})  # fmt: skip
    left.legend(frameon=False, fontsize=9, loc="lower right")
    left.set(xlabel="time (s)", ylabel="force (N)")
    plain(right).semilogy(trial.t, np.maximum(1e6 * trial.signals["x"], 1e-3), color=INK["observer"], lw=1.8)
    right.axvline(trial.t[peak], color=INK["baseline"], ls=":")
    right.set(xlabel="time (s)", ylabel="displacement (µm)", ylim=(1, None))
    return figure


def lag() -> Figure:
    """Friction lags behind velocity: loops that widen with frequency."""
    figure = Figure(figsize=(7.5, 3.3), layout="constrained")
    axes = plain(figure.subplots())
    for rate, color in ((1.0, INK["baseline"]), (5.0, INK["observer"]), (15.0, INK["model"])):
        periods = 4
        t = np.arange(0, periods / rate, 1 / (400 * rate))
        w, mean, swing = 2 * np.pi * rate, 0.03, 0.028
        v, a = mean - swing * np.cos(w * t), swing * w * np.sin(w * t)
        run = imposed(mean * t - swing / w * np.sin(w * t), v, a, t, z=1e-4)
        later = t >= (periods - 1) / rate
        axes.plot(v[later], run.F[later], color=color, lw=1.8, label=f"velocity swings at {rate:g} Hz")
    figure.legend(frameon=False, fontsize=9, loc="outside upper center", ncols=3)
    axes.set(xlabel="slip velocity (m/s)", ylabel="friction force (N)")
    return figure


FIGURES: dict[str, Callable[[], Figure]] = {
    "bristle.svg": bristle,
    "steady_curve.svg": steady_curve,
    "hysteresis.svg": hysteresis,
    "breakaway.svg": breakaway,
    "lag.svg": lag,
    "sensitivities.svg": sensitivities,
    "experiments.svg": experiments,
    "verdicts.png": verdicts,
}
