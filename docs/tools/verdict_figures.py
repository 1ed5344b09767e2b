"""What the verdicts mean: one recording for each, diagnosed, and what is left before and after."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from matplotlib.figure import Figure

import frictionpinn as fp
from frictionpinn.data.recording import Recording
from frictionpinn.evaluate.style import INK

TRUTH = {"mu_c": 3.0, "sigma_2": 2.0}
SIGMAS = {"x": 5e-4, "v": 4e-3, "a": 0.03, "force": 0.06}  # noise, SI units
STROKES = ("0.05*sin(4*t)", "0.05*sin(7*t)", "0.03*sin(3*t) + 0.02*sin(9*t)")
COLORS = {"effect found": INK["model"], "nothing missing": "#2a9d8f", "partly explained": "#d9722e",
          "unexplained": "#b8860b", "no verdict": "#6c757d"}  # fmt: skip


@dataclass(frozen=True)
class Case:
    """What acts beside the declared law, which names the diagnosis may use, and how far the drive moves."""

    words: str
    acts: Mapping[str, float]
    effects: Sequence[str]
    tried: Sequence[str]
    reach: float = 1.0


CASES = (
    Case("nothing acts beside the declared law", {}, (), ("constant_force", "drag")),
    Case("a constant force acts", {"constant_force": 0.4}, ("constant_force",), ("constant_force", "drag")),
    Case("a constant force, and friction that depends on position: only the first is tried",
         {"constant_force": 0.4, "position_gradient": 2.0}, ("constant_force", "position_friction"),
         ("constant_force",)),
    Case("friction that depends on position: no name that is tried fits",
         {"position_gradient": 3.0}, ("position_friction",), ("inertia",)),
    Case("the drive hardly moves: nothing slips", {}, (), ("constant_force",), 1e-5),
)  # fmt: skip


def system():
    """A drive whose force and motion are both measured."""
    return fp.system("drive", imposed=True)


def recorded(case: Case) -> Recording:
    """The recording of a case: three trials, the last held out by the diagnosis."""
    truth = fp.mechanism(system(), "coulomb_viscous", list(case.effects))
    paths = [{"duration": 3.0, "x": f"{case.reach}*({path})", "force": "0"} for path in STROKES]
    clean, rng = fp.simulate(truth, TRUTH | case.acts, paths, rate_hz=100), np.random.default_rng(0)
    noisy = [trial.with_signals(**{name: trial.signals[name] + sigma * rng.standard_normal(len(trial))
                                   for name, sigma in SIGMAS.items()}) for trial in clean.trials]  # fmt: skip
    return replace(clean, trials=tuple(noisy))


def verdicts() -> Figure:
    """A row for each case: the force's residual on the held-out trial, of the declared and the final model."""
    figure = Figure(figsize=(8.5, 1.75 * len(CASES)), layout="constrained")
    for axes, case in zip(figure.subplots(len(CASES), 1, sharex=True), CASES, strict=True):
        told = fp.diagnose(fp.mechanism(system(), "coulomb_viscous"), recorded(case), effects=list(case.tried),
                           check="warn")  # fmt: skip
        model, sigma = told.before.models[0], told.noise["force"]
        axes.axhspan(-2 * sigma, 2 * sigma, color=INK["band"], zorder=0)
        fits = ((told.before, INK["baseline"], "declared model"), (told.after, INK["model"], "with what was added"))
        for fit, color, words in fits[: 1 + bool(told.accepted)]:
            axes.plot(model.t, fit.state.pieces[0].residuals["force"], ".", ms=3, color=color, label=words)
        left = np.concatenate([told.before.state.pieces[0].residuals["force"]])
        reach = max(1.2 * float(np.nanpercentile(np.abs(left), 99)), 4 * sigma)
        axes.set_ylim(-reach, reach)
        axes.set_title(told.verdict, loc="left", fontsize=11, fontweight="bold", color=COLORS[told.verdict])
        axes.set_title(case.words, loc="right", fontsize=9)
        axes.spines[["top", "right"]].set_visible(False)
    axes.set_xlabel("time (s); shaded: the noise, two standard deviations")
    figure.supylabel("force, model minus measurement (N)", fontsize=10)
    handles = [
        figure.axes[1].plot([], [], ".", ms=8, color=color, label=words)[0]
        for color, words in ((INK["baseline"], "declared model"), (INK["model"], "with what was added"))
    ]
    figure.legend(handles=handles, frameon=False, loc="outside lower center", ncols=2, fontsize=9)
    return figure
