"""Networks with memory on the pendulum on a box: in simulation, online, parameters, and 200 random swings.

    python benchmarks/networks_in_simulation.py [--models pe2 bb2 pe1 bb1] [--seeds 5] [--swings 200] [--decade]
    python benchmarks/networks_in_simulation.py --system drive --swings 0        (or sdob)

Trained by experiment=memory on the six-trial protocol at 5 % noise, with seeds from 1000, on which no choice was made;
scored on Traj. 1 and Traj. 2 of conf/evaluate.yaml, or on another --system's held-out trial. The swings, of pob: 2 s of
30 to 65 degrees at 0.7 to 1.2 Hz, skewed at random, then 1 s of rest, in which a limit cycle would show. Writes
networks_in_simulation_<model>.txt of benchmarks/results, with --decade or another --system its name behind the model's.
Every training and swing is kept as it comes in the .json beside it, from which the next call goes on; --fresh begins
anew.
"""

from __future__ import annotations

import argparse
import json
import statistics
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from hydra import compose, initialize_config_dir
from omegaconf import OmegaConf

from frictionpinn.evaluate.in_motion import simulate_in_motion
from frictionpinn.models.elements import StateFriction
from frictionpinn.numerics.paths import InputPath
from frictionpinn.numerics.simulation import ContactLost, SimulationFailed
from frictionpinn.physics import LAWS, SYSTEMS, System
from frictionpinn.physics.mechanism import Mechanism
from frictionpinn.workflow.experiment import build_data
from frictionpinn.workflow.identify import bounds_of, start_within
from frictionpinn.workflow.load import load_run
from frictionpinn.workflow.train import train
from frictionpinn.workflow.trajectories import build_trajectories, transferred

ROOT = Path(__file__).resolve().parents[1]
RESULTS = ROOT / "benchmarks" / "results"
AT_REST = 1e-4  # m/s: faster than that after a second of rest is a limit cycle


def trained(name: str, seed: int, folder: Path, decade: bool = False, system: str = "pob") -> dict[str, Any]:
    """Errors of one training: by trajectory in simulation and online, parameters, processor seconds.

    ``decade``: bounds and start of the law's parameters as of identify.py bounds=decade.
    """
    with initialize_config_dir(str(ROOT / "conf"), version_base="1.3"):
        options = ["experiment=memory", f"model={name}", f"system={system}", f"seed={seed}", "trainer.accelerator=cpu",
                   "trainer.threads=1", "trainer.progress_bar=false", "model.loss.through=motion"]  # fmt: skip
        cfg: Any = OmegaConf.to_container(compose("train", overrides=options), resolve=True)
    if decade:
        around: Any = OmegaConf.to_container(OmegaConf.load(ROOT / "conf" / "bounds" / "decade.yaml"))
        bounds = bounds_of(cfg | {"bounds": around}, seed)
        cfg["friction"] |= {"bounds": bounds, "start": start_within(bounds, seed)}
    begin = time.process_time()
    result = train(cfg, folder)
    found: dict[str, Any] = {"seconds": time.process_time() - begin, "in simulation": {}, "online": {}}
    found["parameters"] = {
        key: entry["value"] / entry["truth"] - 1 for key, entry in result["parameters"].items() if entry.get("truth")
    }
    cfg, home, model = load_run(folder)
    data, wanted = build_data(cfg, home), OmegaConf.load(ROOT / "conf" / "evaluate.yaml").trajectories
    away = transferred(cfg, None, OmegaConf.to_container(wanted))  # type: ignore[arg-type]
    friction = model.friction()  # type: ignore[operator]
    for item in build_trajectories(away, home, data, {"seeds": [seed]}):
        try:
            force = simulate_in_motion(home, friction, item.path, item.start).F
            found["in simulation"][item.name] = float(np.mean((force - item.force) ** 2))
        except (ContactLost, SimulationFailed) as error:
            found["in simulation"][item.name] = error.what
        seen = item.seen[seed]
        found["online"][item.name] = float(np.mean((model.predict_trial(seen)["force"] - item.force) ** 2))
    parts = (friction.tables, friction.grid, friction.elements)
    return found | {"friction": [part.tolist() for part in parts], "system": home.name}


def swings(system: System, friction: StateFriction, done: list[str], count: int) -> Iterator[str]:
    """What becomes of the random swings that are not ``done``: rest, cycle, failed, lifted (the contact ends)."""
    rng = np.random.default_rng(1000)
    t = np.arange(1201) / 400.0
    mechanism = Mechanism(system, LAWS["coulomb"]())
    for k in range(count):
        size, w, skew = np.deg2rad(rng.uniform(30, 65)), 2 * np.pi * rng.uniform(0.7, 1.2), rng.uniform(-0.45, 0.45)
        if k < len(done):
            continue
        fade = np.where(t < 1.5, 1.0, np.where(t < 2.0, 0.5 + 0.5 * np.cos(2 * np.pi * (t - 1.5)), 0.0))
        theta = size * fade * np.sin(w * t + skew * np.sin(w * t))
        omega = np.gradient(theta, t)
        path = InputPath.from_signals(mechanism, t, {"theta": theta, "omega": omega, "alpha": np.gradient(omega, t)})
        try:
            run = simulate_in_motion(system, friction, path, {})
            yield "cycle" if np.abs(run.v_slip[-80:]).max() > AT_REST else "rest"
        except (ContactLost, SimulationFailed) as error:
            yield "lifted" if isinstance(error, ContactLost) else "failed"


def told(values: list[Any]) -> str:
    """Median [lowest, highest]; how many failed."""
    known = [value for value in values if isinstance(value, float)]
    text = f"{statistics.median(known):.3g} [{min(known):.3g}, {max(known):.3g}]" if known else "-"
    return text + (f" ({len(values) - len(known)} failed)" if len(known) < len(values) else "")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--models", nargs="*", default=["pe2", "bb2"])
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--swings", type=int, default=200)
    parser.add_argument("--decade", action="store_true", help="bounds a decade wide around the truth, of a PE")
    parser.add_argument("--system", default="pob", help="that the data are simulated of")
    parser.add_argument("--fresh", action="store_true", help="forget what is kept")
    options = parser.parse_args()
    for name in options.models:
        away = "" if options.system == "pob" else f"_{options.system}"
        kind = f"{name}{away}_decade" if options.decade else f"{name}{away}"
        kept, result = (RESULTS / f"networks_in_simulation_{kind}.{ending}" for ending in ("json", "txt"))
        known: dict[str, Any] = {"runs": {}, "swings": []}
        if kept.exists() and not options.fresh:
            known = json.loads(kept.read_text())
        for seed in range(1000, 1000 + options.seeds):
            if str(seed) in known["runs"]:
                continue
            with tempfile.TemporaryDirectory() as folder:
                known["runs"][str(seed)] = trained(name, seed, Path(folder) / "run", options.decade, options.system)
            kept.write_text(json.dumps(known))
            result.write_text(table(name, known))
        first = known["runs"]["1000"]
        friction = StateFriction(*(np.array(part) for part in first["friction"]))
        for fate in swings(SYSTEMS[first["system"]](), friction, known["swings"], options.swings):
            known["swings"].append(fate)
            kept.write_text(json.dumps(known))
        result.write_text(table(name, known))
        print(result.read_text(), flush=True)


def table(name: str, known: dict[str, Any]) -> str:
    """The result as text."""
    runs, fates = list(known["runs"].values()), known["swings"]
    seeds = f"seeds 1000 to {999 + len(runs)}"
    system = runs[0]["system"]
    lines = [f"experiment=memory on {system}, {seeds}: medians [lowest, highest]; force in N^2", ""]
    lines.append(f"{name}: {told([run['seconds'] for run in runs])} s of processor time for a training")
    for way in ("in simulation", "online"):
        for trajectory in runs[0][way]:
            lines.append(f"  {trajectory} {way:<14} {told([run[way][trajectory] for run in runs])}")
    for key in runs[0]["parameters"]:
        if any(run["parameters"][key] for run in runs):
            off = [100 * run["parameters"][key] for run in runs]
            far = statistics.median(map(abs, off))
            lines.append(f"  {key:<8} off by {told(off)} %, {far:.3g} % without the sign")
    if fates:
        failed, cycles, lifted = (fates.count(fate) for fate in ("failed", "cycle", "lifted"))
        lines.append(f"  {len(fates)} random swings: {failed} failed, {cycles} not at rest after a second of rest, "
                     f"{lifted} lost the contact")  # fmt: skip
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    main()
