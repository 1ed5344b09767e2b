"""What a velocity that was differentiated makes of friction, and what the position says: laws fitted to the motion.

    python benchmarks/networks_derived.py [--seeds 6]

Pendulums drawn at random swing freely with Coulomb friction and some viscous friction; the angle is read by an encoder
with steps and a play, low-passed and differentiated, as the public pendulum's was. LuGre's law is fitted through the
motion as a training with memory does before it starts (models/state_start.py), by the rate and by the angle. Scored is
the friction that it gives at sliding speeds against the true one. Writes benchmarks/results/networks_derived.txt.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
import torch

from frictionpinn.data.prepare import prepare_trial
from frictionpinn.data.recording import Recording, Trial
from frictionpinn.models.state_start import fit_law
from frictionpinn.numerics.simulate import Simulator
from frictionpinn.numerics.torch_functions import numpy_function
from frictionpinn.physics import LAWS, SYSTEMS
from frictionpinn.physics.base import CONTACT
from frictionpinn.physics.mechanism import Mechanism
from frictionpinn.workflow.build import build_system
from frictionpinn.workflow.experiment import build_data, build_model
from frictionpinn.workflow.options import composed

RESULT = Path(__file__).resolve().parent / "results" / "networks_derived.txt"
SPEEDS = np.array([0.3, 1.0, 3.0])  # rad/s
RATE_HZ, CUTOFF_HZ, SECONDS = 200.0, 20.0, 8.0


def swing(
    parameters: dict[str, float], law: dict[str, float], first: float, play: float, step: float = 0.0
) -> Recording:
    """A free swing from ``first`` rad off rest, read with a play of +-``play`` and in steps of ``step``, rad."""
    t = np.arange(round(1000 * SECONDS)) / 1000.0
    pendulum = Mechanism(SYSTEMS["pendulum"](**parameters), LAWS["lugre"]())
    run = Simulator(pendulum).simulate(t, {}, law, {"theta": np.pi - first, "omega": 0.0})
    angle = run.signals["theta"] + play * np.sign(run.signals["omega"])
    angle = step * np.round(angle / step) if step else angle
    made = prepare_trial(Trial("1", t, {"theta": angle}), position="theta", derivatives=("omega", "alpha"), edge_s=0.2,
                         cutoff_hz=CUTOFF_HZ, rate_hz=RATE_HZ, thin_cutoff_hz=CUTOFF_HZ)  # fmt: skip
    return Recording((made,), {"theta": "rad", "omega": "rad/s", "alpha": "rad/s^2"})


def fitted(path: Path, parameters: dict[str, float], compared: str) -> tuple[Any, dict[str, float]]:
    """A model whose law is fitted through the motion of a recording that was saved there, and its parameters."""
    options = [f"system.parameters.{name}={value}" for name, value in parameters.items()]
    options += ["experiment=memory", "model=pe1", "model.loss.through=motion", f"model.loss.compare={compared}"]
    cfg = composed("train", ["system=pendulum", "data=csv", "smoothing=none", f"data.path={path}", *options])
    system = build_system(cfg["system"])
    data = build_data(cfg, system)
    model = build_model(cfg, system, data)
    arrays = [model.arrays(trial, "offline") for trial in data.select("train")]
    fit_law(model, {key: torch.from_numpy(np.concatenate([own[key] for own in arrays])) for key in arrays[0]})
    return model, model.physical()


def sliding(law: dict[str, float], v: np.ndarray) -> np.ndarray:
    """Friction of LuGre's law in steady sliding, v > 0, under a load of 1, shape of ``v``."""
    lugre = LAWS["lugre"]()
    settled = {CONTACT.z: lugre.capacity(CONTACT, lugre.symbols) / lugre.symbols.sigma_0, CONTACT.zdot: 0}
    force = lugre.force(CONTACT, lugre.symbols).subs(settled)
    values = [law.get(par.name, par.value) for par in lugre.parameters]
    return numpy_function([CONTACT.v, CONTACT.N, *(par.symbol for par in lugre.parameters)], force)(v, 1.0, *values)


def drawn(seed: int) -> tuple[dict[str, float], dict[str, float], float, float, float]:
    """Arguments of :func:`swing` off the beaten path."""
    rng = np.random.default_rng(seed)
    parameters = {"m": rng.uniform(0.1, 2.0), "l": rng.uniform(0.1, 0.6)}
    weight = 9.81 * parameters["m"] * parameters["l"]
    parameters["J"] = rng.uniform(0.02, 0.3) * parameters["m"] * parameters["l"] ** 2
    dry = rng.uniform(1e-3, 5e-3) * weight
    law = {"mu_c": dry, "mu_s": dry, "v_s": 0.01, "sigma_0": dry / rng.uniform(3e-4, 2e-3), "sigma_1": 0.0,
           "sigma_2": rng.uniform(0.0, 0.02) * dry}  # fmt: skip
    return parameters, law, rng.uniform(0.5, 1.2), rng.uniform(3e-5, 2e-4), rng.uniform(1e-5, 2e-4)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=6)
    torch.set_num_threads(1)
    seeds, off = parser.parse_args().seeds, dict[str, list[np.ndarray]](velocity=[], position=[])
    lines = [
        "friction of the law that is fitted through the motion over the true one, less 1, %",
        f"{'seed':4}  {'play, mrad':>10}  {'step, mrad':>10}  {'compared':>9}"
        + "".join(f"{f'{v:g} rad/s':>11}" for v in SPEEDS),
    ]
    for seed in range(seeds):
        parameters, law, first, play, step = drawn(seed)
        with tempfile.TemporaryDirectory() as folder:
            path = swing(parameters, law, first, play, step).save(Path(folder) / "swing.csv")
            for compared, own in off.items():
                begin = time.process_time()
                own.append(sliding(fitted(path, parameters, compared)[1], SPEEDS) / sliding(law, SPEEDS) - 1)
                told = "".join(f"{100 * x:11.1f}" for x in own[-1])
                lines.append(f"{seed:4}  {1e3 * play:10.3f}  {1e3 * step:10.3f}  {compared:>9}{told}")
                print(lines[-1], f" {time.process_time() - begin:.0f} s", flush=True)
    for compared, own in off.items():
        told = "".join(f"{100 * x:11.1f}" for x in np.median(np.abs(own), axis=0))
        lines.append(f"median without the sign     {compared:>9}{told}")
    RESULT.write_text("\n".join(lines) + "\n")
    print("\n".join(lines[-2:]))


if __name__ == "__main__":
    main()
