"""Networks with memory on three measured mechanisms: chosen on training and validation runs, held-out runs scored once.

    FRICTIONPINN_DATA=... python benchmarks/networks_measured.py [--sets brfd emps multiarm_pendulum] [--epochs 1500]

Every candidate is trained without the validation runs and scored on them; the best is trained on all training runs and
scored on the held-out ones, beside Coulomb + viscous friction. The damper's and the drive's score: what the measured
motion needs of force less what was measured, over the measured force, %. The pendulum's: free runs of 4 s from the
measured state, mrad, on the run that is set aside and on the authors' own validation runs, held out the raw tail. Its
inertia is that of Coulomb + viscous friction, by maximum likelihood on the same training runs, and its rate is taken
from the angle (the authors' own comes 0.7 ms late). Most candidates learn friction beside the effects that diagnose.py
finds in the training runs, judged by the run that is set aside, as far as these are forces: they and the inertia are
estimated with Coulomb + viscous friction on the same runs. What one training makes of friction at low speeds, which
these runs hardly tell, changes with any of them; some are the mean of such networks each trained without one run
(bagging: Breiman, Machine Learning 24 (1996)). Writes benchmarks/results/networks_measured.txt, in which sets that are
not run keep what they have.
"""

from __future__ import annotations

import argparse
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from hydra import compose, initialize_config_dir
from omegaconf import OmegaConf

from frictionpinn.data.contact import ContactTrial
from frictionpinn.data.sets import FIT, HELD_OUT, load_public
from frictionpinn.errors import UserError
from frictionpinn.evaluate.force import CoulombViscousFit
from frictionpinn.evaluate.in_motion import simulate_in_motion
from frictionpinn.export.augmented import folded
from frictionpinn.identify import maximum_likelihood
from frictionpinn.models import StateModel
from frictionpinn.numerics.paths import InputPath
from frictionpinn.numerics.simulation import SimulationFailed
from frictionpinn.physics import LAWS, SYSTEMS, System
from frictionpinn.physics.mechanism import Mechanism
from frictionpinn.workflow.experiment import build_data
from frictionpinn.workflow.load import load_run
from frictionpinn.workflow.train import train

ROOT = Path(__file__).resolve().parents[1]
RESULT = ROOT / "benchmarks" / "results" / "networks_measured.txt"
SYSTEM = {"brfd": "damper", "emps": "drive", "multiarm_pendulum": "pendulum"}
MEASURED = {"brfd": "damper", "emps": "emps", "multiarm_pendulum": "pendulum"}  # as diagnose_measured.txt calls them
# The drive has one training run. The pendulum's first is one of its training runs, the others are the authors' own.
VALIDATION: dict[str, tuple[str, ...]] = {
    "brfd": ("0.5Hz_30lb_1in",), "emps": (), "multiarm_pendulum": ("id_4", "vad_1", "vad_2")
}  # fmt: skip
MOTION = "model.loss.through=motion"
GAPS = "model.state.gaps=true"
BESIDE = "beside what a diagnosis finds"
BAGGED = "mean of those without one run each"
CANDIDATES: dict[str, list[tuple[str, ...]]] = {
    "brfd": [("model=bb1", "model.state.elements=1"), ("model=bb1", "model.state.elements=1", GAPS),
             ("model=bb1", "model.state.elements=2", GAPS), ("model=bb1", "model.state.elements=3", GAPS),
             ("model=bb1", "model.state.elements=4", GAPS), ("model=pe1",)],
    "emps": [("model=bb1", "model.state.elements=1"), ("model=bb1", "model.state.elements=1", "model.state.delay=true"),
             ("model=bb1", "model.state.elements=2", "model.state.delay=true"), ("model=pe1",)],
    "multiarm_pendulum": [("model=bb1", "model.state.elements=1"),
                          *(("model=bb1", f"model.state.elements={k}", MOTION) for k in (1, 2, 3)),
                          ("model=pe1", MOTION),
                          *(("model=bb1", f"model.state.elements={k}", MOTION, BESIDE) for k in (1, 2, 3, 4)),
                          ("model=pe1", MOTION, BESIDE),
                          *(("model=bb1", f"model.state.elements={k}", MOTION, BESIDE, BAGGED) for k in (1, 3)),
                          ("model=pe1", MOTION, BESIDE, BAGGED)],
}  # fmt: skip
FROM_ANGLE = "+data.options.from_angle=true"
ROLLOUT_S = 4.0


def trained(name: str, options: Sequence[str], held_out: Sequence[str], epochs: int, folder: Path):
    """A run's configuration, system, model, trials by split, and processor seconds."""
    with initialize_config_dir(str(ROOT / "conf"), version_base="1.3"):
        given = ["experiment=memory", f"data={name}", f"system={SYSTEM[name]}", *options, "data.check=warn",
                 f"data.held_out={list(held_out)}", "trainer.accelerator=cpu", "trainer.threads=1",
                 "trainer.progress_bar=false", f"trainer.max_epochs={epochs}"]  # fmt: skip
        cfg: Any = OmegaConf.to_container(compose("train", overrides=given), resolve=True)
    begin = time.process_time()
    train(cfg, folder)
    cfg, system, model = load_run(folder)
    return system, model, build_data(cfg, system), time.process_time() - begin


def force_error(model: Any, system: System, trials: Sequence[ContactTrial]) -> float:
    """Error of the whole force along the measured motion, over the measured force, %."""
    off, size = 0.0, 0.0
    for trial in trials:
        force = model.predict_trial(trial)["force"]
        if isinstance(model, StateModel) and hasattr(model, "delay"):
            whole = trial.online["a_frictionless"] / model.scales["mobility"]
            force = force - float(model.lag().detach()) * np.gradient(whole, trial.t)
        off += float(np.sum((force - trial.online["friction_force"]) ** 2))
        size += float(np.sum(trial.measured["force"] ** 2))
    return 100 * (off / size) ** 0.5


def rollout_error(model: Any, system: System, trials: Sequence[ContactTrial]) -> float:
    """Root mean square error of the angle over consecutive free runs, mrad."""
    mechanism, friction, errors = Mechanism(system, LAWS["coulomb"]()), model.friction(), []
    for trial in trials:
        count = round(ROLLOUT_S / float(np.median(np.diff(trial.t))))
        for k in range(0, len(trial.t) - count + 1, count):
            t = np.ascontiguousarray(trial.t[k : k + count])
            start = {name: float(trial.measured[name][k]) for name in ("theta", "omega")}
            try:
                run = simulate_in_motion(system, friction, InputPath.from_signals(mechanism, t, {}), start)
                errors.append(run.signals["theta"] - trial.measured["theta"][k : k + count])
            except SimulationFailed:
                return float("inf")
    return 1e3 * float(np.sqrt(np.mean(np.concatenate(errors) ** 2)))


def plain_pendulum(
    names: Sequence[str], free: Sequence[str] = ("mu_c", "sigma_2"), effects: tuple[str, ...] = (), **fixed: float
) -> dict[str, float]:
    """Inertia and friction of the pendulum, Coulomb and viscous unless said, by maximum likelihood on training runs."""
    config: Any = OmegaConf.to_container(OmegaConf.load(ROOT / "conf" / "data" / "multiarm_pendulum.yaml"))
    mechanism = Mechanism(SYSTEMS["pendulum"](**config["system"]["parameters"]), LAWS["coulomb_viscous"](), effects)
    recording = load_public("multiarm_pendulum").select(names)
    found = maximum_likelihood(mechanism, recording, free=("J", *free), fixed=fixed, windows=ROLLOUT_S)
    return found.values | fixed


def found_model(judged: str, set_aside: Sequence[str], folder: Path) -> dict[str, Any]:
    """What diagnose.py writes of the pendulum's training runs, with the forces, loads and masses of its effects."""
    command = [sys.executable, str(ROOT / "diagnose.py"), "preset=pendulum", f"data.held_out=[{judged}]"]
    command += [f"data.validation={list(set_aside)}", f"hydra.run.dir={folder}/diagnosis"]
    subprocess.run(command, check=True, cwd=folder, stdout=subprocess.DEVNULL)
    content: Any = OmegaConf.to_container(OmegaConf.load(folder / "diagnosis" / "augmented.yaml"))

    def acts_as_known(effect: str) -> bool:
        try:
            folded(saved(folder / "one.yaml", {**content, "effects": {effect: content["effects"][effect]}}))
        except UserError:
            return False
        return True

    return {**content, "effects": {name: own for name, own in content["effects"].items() if acts_as_known(name)}}


def estimated(content: dict[str, Any], runs: Sequence[str]) -> dict[str, Any]:
    """The same model with inertia, friction and effects by maximum likelihood on these runs."""
    effects = content["effects"]
    free = ("mu_c", "sigma_2", *(name for own in effects.values() for name, value in own.items() if value))
    values = plain_pendulum(runs, free, tuple(effects))
    system = {**content["system"], "parameters": {**content["system"]["parameters"], "J": values["J"]}}
    tables = {effect: {name: values.get(name, own[name]) for name in own} for effect, own in effects.items()}
    law = {name: values.get(name, value) for name, value in content["values"].items()}
    return {**content, "system": system, "values": law, "effects": tables}


def saved(path: Path, content: dict[str, Any]) -> Path:
    """A model as a file for ``friction=``."""
    OmegaConf.save(OmegaConf.create(content), path)
    return path


class Mean:
    """The mean force of several models' friction, each with states of its own."""

    def __init__(self, models: Sequence[Any]):
        self.parts = [model.friction() for model in models]
        self.cuts = np.cumsum([part.states for part in self.parts])
        self.states = int(self.cuts[-1])

    def friction(self) -> Mean:
        return self

    def settled(self, v: float, N: float) -> np.ndarray:
        return np.concatenate([part.settled(v, N) for part in self.parts])

    def rates(self, v: float, N: float, z: np.ndarray) -> np.ndarray:
        pairs = zip(self.parts, np.split(z, self.cuts[:-1]), strict=True)
        rates = [part.rates(v, N, own) for part, own in pairs]
        return np.concatenate([[np.mean([own[0] for own in rates])], *(own[1:] for own in rates)])


class PlainPendulum:
    """Coulomb + viscous friction as the friction of a model, sharp at rest to a hundredth of a radian per second."""

    def __init__(self, values: dict[str, float]):
        self.values, self.states = values, 1

    def friction(self) -> PlainPendulum:
        return self

    def settled(self, v: float, N: float) -> np.ndarray:
        return np.zeros(1)

    def rates(self, v: float, N: float, z: np.ndarray) -> np.ndarray:
        p = self.values
        return np.array([p["mu_c"] * N * np.tanh(v / 0.01) + p["sigma_2"] * v, 0.0])


def diagnosed(name: str) -> str:
    """Held-out error of the diagnosed model, from what benchmarks/diagnose_measured.py wrote."""
    found = re.search(rf"^{name} .* after +(\S+ \S+) ", RESULT.with_name("diagnose_measured.txt").read_text(), re.M)
    return found[1] if found else "not known: run benchmarks/diagnose_measured.py"


def fitted(
    name: str, options: Sequence[str], runs: Sequence[str], content: dict[str, Any], epochs: int, folder: Path
) -> tuple[System, Any, Any, float]:
    """System, model, data and processor seconds of a candidate that is trained on these runs, beside the effects of a
    model (:func:`found_model`) if it is to be."""
    given = [option for option in options if option not in (BESIDE, BAGGED)]
    folder.mkdir()
    if BESIDE in options:
        path = saved(folder / "beside.yaml", estimated(content, runs))
        given += [FROM_ANGLE, f"+system.augmented={path}"]
    elif name == "multiarm_pendulum":
        given += [FROM_ANGLE, f"system.parameters.J={plain_pendulum(runs)['J']}"]
    others = [run for run in (*FIT[name], *HELD_OUT[name]) if run not in runs]
    without = [[run] for run in runs] if BAGGED in options else [[]]
    made = [trained(name, given, others + own, epochs, folder / str(k)) for k, own in enumerate(without)]
    system, model, data, _ = made[0]
    model = model if len(made) == 1 else Mean([own for _, own, *_ in made])
    return system, model, data, sum(seconds for *_, seconds in made)


def scored(name: str, epochs: int) -> list[str]:
    """Every candidate on the validation runs, the best one on the held-out runs."""
    pendulum, aside = name == "multiarm_pendulum", list(VALIDATION[name])
    score = rollout_error if pendulum else force_error
    held_out = [run for run in HELD_OUT[name] if run not in aside]
    unit, lines, found = "mrad" if pendulum else "%", list[str](), list[float]()
    with tempfile.TemporaryDirectory() as folder:
        model_found = found_model(aside[0], [*aside[1:], *held_out], Path(folder)) if pendulum else {"effects": {}}
        for place, options in enumerate(CANDIDATES[name]):
            runs = [run for run in FIT[name] if run not in aside]
            system, model, data, seconds = fitted(name, options, runs, model_found, epochs, Path(folder) / str(place))
            judged = [data.by_name[key] for key in aside] or data.select("train")
            found.append(score(model, system, judged))
            on = f"validation runs ({', '.join(aside)})" if aside else "training run"
            lines.append(f"  {' '.join(options):<66} {found[-1]:8.2f} {unit} on the {on}, {seconds:.0f} s")
            print(lines[-1], flush=True)
        best = CANDIDATES[name][int(np.argmin(found))]
        system, model, data, _ = fitted(name, best, FIT[name], model_found, epochs, Path(folder) / "best")
        trials = [data.by_name[key] for key in held_out]
        lines.append(f"  chosen: {' '.join(best)}; held out {score(model, system, trials):.2f} {unit}")
        if pendulum:
            told = f", {', '.join(model_found['effects']) or 'nothing'} found"
            lines[-1] += told if BESIDE in best else ""
            plain = plain_pendulum(FIT[name])
            system = SYSTEMS["pendulum"](**{**system.values, "J": plain["J"]})
            beside = rollout_error(PlainPendulum(plain), system, trials)
        else:
            beside = force_error(CoulombViscousFit(data.select("train")), system, trials)
        lines.append(f"  Coulomb + viscous fit: held out {beside:.2f} {unit}")
    return [f"{name}: diagnosed model held out {diagnosed(MEASURED[name])}", *lines]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sets", nargs="*", default=list(SYSTEM), choices=list(SYSTEM))
    parser.add_argument("--epochs", type=int, default=1500)
    options = parser.parse_args()
    first = f"experiment=memory, {options.epochs} steps; chosen without the held-out runs, which are scored once"
    known = (
        {part.split(":")[0]: part for part in RESULT.read_text().strip().split("\n\n")[1:]} if RESULT.exists() else {}
    )
    for name in options.sets:
        known[name] = "\n".join(scored(name, options.epochs))
        RESULT.write_text("\n\n".join([first, *known.values()]) + "\n")
    print(RESULT.read_text())


if __name__ == "__main__":
    main()
