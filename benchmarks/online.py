"""The online estimator: time per sample on one core, accuracy over seeds, and a surface whose mu_c drops by 30 %.

    python benchmarks/online.py                 everything, about 3 minutes; latencies want a quiet machine
    python benchmarks/online.py --seeds 1 --repeats 1

Writes benchmarks/results/online.txt and online.png. Parameters are identified on the training trials of every seed;
truth values serve the score and the observer that knows them.
"""

from __future__ import annotations

import argparse
import gc
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from omegaconf import OmegaConf

from frictionpinn.data.excitation import parse_expression
from frictionpinn.data.noise import GaussianNoise
from frictionpinn.data.recording import Recording, Trial
from frictionpinn.data.simulated import simulate_recording
from frictionpinn.evaluate.observers import identify
from frictionpinn.numerics.paths import InputPath
from frictionpinn.numerics.simulate import Simulator
from frictionpinn.numerics.torch_functions import contact_signals
from frictionpinn.online import OnlineEstimator, tune
from frictionpinn.physics import LAWS, SYSTEMS
from frictionpinn.physics.mechanism import Mechanism

ROOT = Path(__file__).resolve().parents[1]
NOISE = GaussianNoise(0.05)
RATE, SURFACE = 400.0, 0.01  # Hz; relative change per square root of a second of sliding
INK = {"truth": "#222222", "ours": "#00798c", "band": "#bfdde1"}


def pob() -> tuple[Mechanism, dict[str, float], list, list]:
    """The pendulum on a box with its true friction, its training trials and the trajectories of the evaluation."""
    cfg = OmegaConf.to_container(OmegaConf.load(ROOT / "conf" / "system" / "pob.yaml"), resolve=True)
    trajectories = OmegaConf.to_container(OmegaConf.load(ROOT / "conf" / "evaluate.yaml").trajectories.pob)
    mechanism = Mechanism(SYSTEMS["pob"](**cfg["parameters"]), LAWS["lugre"]())
    truth = {name: float(value) for name, value in cfg["simulate"]["truth"].items()}
    return mechanism, truth, cfg["simulate"]["trials"][:5], trajectories


def changing(mechanism: Mechanism, truth: dict[str, float], factor: float, seconds: float, rate: float) -> Trial:
    """A swing of 57.5 degrees whose mu_c is multiplied by ``factor`` midway, without noise."""
    t = np.arange(int(rate * seconds)) / rate
    half = len(t) // 2
    path = InputPath.from_expressions(mechanism, t, {"theta": parse_expression("57.5*deg*sin(2*pi*t)", "theta", {})})
    driven = {name: path.signals[name] for name in ("theta", "omega", "alpha")}
    simulator = Simulator(mechanism)
    first = simulator.simulate(t[: half + 1], {n: v[: half + 1] for n, v in driven.items()}, truth, z0="steady")
    y0 = {"x": first.q[-1, 0], "v": first.v[-1, 0], "z": first.z[-1]}
    after = truth | {"mu_c": factor * truth["mu_c"]}
    second = simulator.simulate(t[half:], {n: v[half:] for n, v in driven.items()}, after, y0)
    signals = {n: np.append(first.signals[n][:-1], second.signals[n]) for n in ("x", "v", "a", *driven)}
    told = {"friction_force": np.append(first.F[:-1], second.F), "v_slip": np.append(first.v_slip[:-1], second.v_slip)}
    return Trial(f"mu_c times {factor:g}", t, signals, told)


def noisy(trial: Trial, units: dict[str, str], seed: int) -> Trial:
    """The trial as its sensors show it."""
    return NOISE(Recording((trial,), units), seed).trials[0]


def latency(estimator: OnlineEstimator, trial: Trial, repeats: int) -> np.ndarray:
    """Seconds of every call of ``update``, shape (repeats * n,)."""
    samples = [{name: float(trial.signals[name][k]) for name in estimator.signals} for k in range(len(trial))]
    spent = []
    gc.disable()
    for _ in range(repeats):
        estimator.reset()
        for t, sample in zip(trial.t.tolist(), samples, strict=True):
            begin = time.perf_counter()
            estimator.update(t, sample)
            spent.append(time.perf_counter() - begin)
    gc.enable()
    return np.array(spent)


def tracking(found: dict[str, np.ndarray], trial: Trial, factor: float, mu_c: float) -> tuple[float, float, float]:
    """Largest relative error of mu_c before the change (0.5 s on), after one second of sliding on it, and then."""
    half, rate = len(trial) // 2, (len(trial) - 1) / (trial.t[-1] - trial.t[0])
    slid = np.cumsum(np.abs(trial.truth["v_slip"]) > 0.01) / rate
    after = int(np.argmax(slid >= slid[half] + 1.0))
    error = np.abs(found["mu_c"] / mu_c - 1)
    later = np.abs(found["mu_c"][after:] / (factor * mu_c) - 1)
    return float(error[int(rate / 2) : half].max()), float(later[0]), float(later.max())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--repeats", type=int, default=3)
    arguments = parser.parse_args()
    mechanism, truth, training, trajectories = pob()
    clean = simulate_recording(mechanism.system, "lugre", truth, training, RATE)
    tests = simulate_recording(mechanism.system, "lugre", truth, trajectories, RATE)
    lines = ["python benchmarks/online.py", "pendulum on a box, LuGre, 5 % noise on six signals at 400 Hz", ""]
    scores: dict[str, list[list[float]]] = {"force balance": [], "observer, identified": [], "observer, truth": []}
    covered, estimators = [], {}
    for seed in range(arguments.seeds):
        recording = NOISE(clean, seed)
        known = identify(mechanism.system, "lugre", recording)
        if known is None:
            raise SystemExit("identification failed")
        tuning, adapt = tune(mechanism, recording), dict.fromkeys(known.uncertain, 0.0)
        made = {
            "observer, identified": OnlineEstimator.fit(
                mechanism, known.parameters, recording, adapt, tuning=tuning, covariance=known.covariance
            ),
            "observer, truth": OnlineEstimator.fit(mechanism, truth, recording, tuning=tuning),
        }
        estimators.setdefault("plain", OnlineEstimator(mechanism, known.parameters, tuning))
        estimators.setdefault("with uncertain parameters", made["observer, identified"])
        share = made["observer, identified"].share
        estimators.setdefault("surface", OnlineEstimator(mechanism, known.parameters, tuning, {"mu_c": SURFACE}, share))
        rows: dict[str, list[float]] = {name: [] for name in scores}
        inside = []
        for trial in tests.trials:
            seen, force = noisy(trial, tests.units, seed), trial.truth["friction_force"]
            balance = contact_signals(mechanism.system, seen.signals)["friction_force"]
            rows["force balance"].append(float(np.mean((balance - force) ** 2)))
            for name, estimator in made.items():
                found = estimator.filter(seen)
                rows[name].append(float(np.mean((found["force"] - force) ** 2)))
                if name == "observer, identified":
                    inside.append(float(np.mean((found["low"] <= force) & (force <= found["high"]))))
        covered.append(inside)
        for name, row in rows.items():
            scores[name].append(row)
    lines.append(f"force, mean square error in N^2, medians over {arguments.seeds} seeds")
    for name, table in scores.items():
        values = "  ".join(
            f"{trial.name} {median:.4f}" for trial, median in zip(tests.trials, np.median(table, 0), strict=True)
        )
        lines.append(f"  {name:<24} {values}")
    shares = "  ".join(f"{t.name} {100 * m:.0f} %" for t, m in zip(tests.trials, np.median(covered, 0), strict=True))
    lines += [f"  inside the 95 % interval  {shares}", "", "time per sample (update), ms, one core"]
    sample = noisy(tests.trials[1], tests.units, 0)
    thousand = simulate_recording(mechanism.system, "lugre", truth, trajectories[1:], 1000.0)
    fast = noisy(thousand.trials[0], thousand.units, 0)
    spread: dict[str, np.ndarray] = {}
    for name, estimator in estimators.items():
        for rate, trial in ((400, sample), (1000, fast)):
            at = OnlineEstimator(
                mechanism, estimator.parameters, replace(estimator.tuning, interval=1 / rate), estimator.adapt,
                estimator.share, estimator.covariance,
            )  # fmt: skip
            latency(at, trial, 1)
            spent = 1e3 * latency(at, trial, arguments.repeats)
            spread[f"{name}, {rate} Hz"] = spent
            lines.append(
                f"  {name + f', {rate} Hz':<36} median {np.median(spent):.3f}  99 % {np.quantile(spent, 0.99):.3f}  "
                f"worst {spent.max():.3f}  ({1e3 / np.mean(spent):.0f} samples a second)"
            )
    lines += ["", f"surface: mu_c adapts at {SURFACE:g} per square root of a second of sliding; errors of mu_c"]
    shown = {}
    for factor in (1.0, 0.7):
        trial, rows = changing(mechanism, truth, factor, 8.0, RATE), []
        for seed in range(arguments.seeds):
            found = estimators["surface"].filter(noisy(trial, tests.units, seed))
            rows.append(tracking(found, trial, factor, truth["mu_c"]))
            shown.setdefault(factor, (trial, found))
        before, after, then = 100 * np.max(rows, axis=0)
        lines.append(
            f"  mu_c times {factor:g} at 4 s: at most {before:.2f} % before, {after:.2f} % after 1 s of sliding, "
            f"{then:.2f} % from then on (worst of {arguments.seeds} seeds)"
        )
    text = "\n".join(lines) + "\n"
    print(text)
    folder = ROOT / "benchmarks" / "results"
    (folder / "online.txt").write_text(text, encoding="utf-8")
    draw(shown, spread, truth["mu_c"]).savefig(folder / "online.png", dpi=120)


def draw(shown: dict, spread: dict[str, np.ndarray], mu_c: float) -> Figure:
    """Tracking of mu_c on a surface that changes and on one that does not; latencies."""
    figure = Figure(figsize=(10, 7), layout="constrained")
    panels = figure.subplot_mosaic([["left", "right"], ["bottom", "bottom"]])
    left, right, bottom = panels["left"], panels["right"], panels["bottom"]
    for axis, factor in ((left, 1.0), (right, 0.7)):
        trial, found = shown[factor]
        half = len(trial) // 2
        true = np.where(np.arange(len(trial)) < half, mu_c, factor * mu_c)
        axis.plot(trial.t, true, color=INK["truth"], lw=1.5, label="truth")
        axis.fill_between(trial.t, 0.95 * true, 1.05 * true, color=INK["band"], label="5 %")
        axis.plot(trial.t, found["mu_c"], color=INK["ours"], lw=1.2, label="estimate")
        slides = np.abs(trial.truth["v_slip"]) > 0.01
        axis.fill_between(trial.t, 0, 0.02, where=slides, transform=axis.get_xaxis_transform(), color="#8d99ae",
                          lw=0, label="slides")  # fmt: skip
        axis.set(xlabel="time (s)", title="surface unchanged: no drift" if factor == 1 else "mu_c drops by 30 % at 4 s")
        axis.set(ylim=(0.19, 0.33))
    left.set(ylabel="mu_c")
    left.legend(loc="lower left", bbox_to_anchor=(0.0, 0.08), frameon=False, ncols=2)
    axis, names = bottom, list(spread)
    axis.boxplot([spread[name] for name in names], orientation="horizontal", whis=(1, 99), sym=".")
    axis.set(xscale="log", xlabel="time per sample (ms); whiskers 1 and 99 %", yticks=range(1, len(names) + 1))
    axis.set_yticklabels(names)
    axis.axvline(1.0, color=INK["truth"], lw=0.8, ls="--")
    axis.annotate("1 kHz", (1.0, 0.6), (4, 0), textcoords="offset points", fontsize=8)
    figure.suptitle("Online estimator: follows a surface that changes, faster than the samples come")
    return figure


if __name__ == "__main__":
    main()
