"""Trainings on a GPU against the same ones on the CPU beside it: how far apart they are, and what they take.

    python benchmarks/accelerator.py [--models bb1 bb2 pe1 pe2] [--memory windows state] [--whole] [--members 64]

Of each variant, from the same weights on both: the loss and its gradient at the start with every weight moved by a
tenth (PE1 and PE2 with memory start in the minimum of their loss, where a gradient is nothing but rounding); the
friction force on the held-out trials after so many epochs of train.py, relative to the force's root mean square, beside
what rounding alone makes of it (the CPU with one thread instead of all, or with the start moved by a part in 10^7), and
of those with memory the same with weights in double precision; the epoch's time. With --whole the force error and
seconds of default trainings. --members: so many networks as one program, ms per epoch.
Writes benchmarks/results/accelerator.txt. --other cpu compares the CPU with itself, which tries the program out.
"""

from __future__ import annotations

import argparse
import copy
import os
import platform
import statistics
import tempfile
import time
from pathlib import Path
from typing import Any

import lightning as L
import numpy as np
import torch
from hydra import compose, initialize_config_dir
from omegaconf import OmegaConf

from frictionpinn.evaluate.force import force_errors
from frictionpinn.workflow.build import build_system
from frictionpinn.workflow.ensemble import prepare
from frictionpinn.workflow.train import build_trainer, quiet, trained

ROOT = Path(__file__).resolve().parents[1]
ALL = os.cpu_count() or 1
EPOCHS = 50


def setup(name: str, memory: str, *overrides: str) -> tuple[dict[str, Any], Any, Any]:
    """Configuration, data and a fresh model on the CPU."""
    options = [f"model={name}", "trainer.early_stopping=null", "trainer.progress_bar=false", *overrides]
    options += ["experiment=memory", "model.loss.through=motion"] if memory == "state" else []
    with initialize_config_dir(str(ROOT / "conf"), version_base="1.3"):
        cfg: Any = OmegaConf.to_container(compose("train", overrides=options), resolve=True)
    return cfg, *prepare(cfg, build_system(cfg["system"]))


def slope(model: Any, batch: dict[str, torch.Tensor], device: str) -> np.ndarray:
    """Loss and its gradient on a device, in one row."""
    own = copy.deepcopy(model).to(device)
    loss = own.losses({key: value.to(device) for key, value in batch.items()})["loss"]
    found = torch.autograd.grad(loss, list(own.parameters()), allow_unused=True)
    return np.concatenate([[loss.item()], *(g.detach().cpu().double().numpy().ravel() for g in found if g is not None)])


def after(cfg: dict, data: Any, model: Any, accelerator: str, epochs: int) -> tuple[Any, float]:
    """The model after so many epochs, on the CPU, and the seconds of its training."""
    cfg = cfg | {"trainer": cfg["trainer"] | {"accelerator": accelerator, "max_epochs": epochs}}
    with tempfile.TemporaryDirectory() as folder:
        own = copy.deepcopy(model)
        _, told = trained(cfg, Path(folder), data, own, {}, time.perf_counter())
    return own.to("cpu"), told["seconds"]["training"]


def moved(model: Any, share: float) -> Any:
    """A copy whose weights are so much larger or smaller, at random."""
    own, chance = copy.deepcopy(model), torch.Generator().manual_seed(1)
    with torch.no_grad():
        for p in own.parameters():
            p.mul_(1 + share * torch.randn(p.shape, generator=chance))
    return own


def force(model: Any, data: Any) -> np.ndarray:
    return np.concatenate([model.predict_trial(trial)["force"] for trial in data.select("held_out")])


def apart(a: np.ndarray, b: np.ndarray) -> float:
    """Root mean square of the difference over that of the second."""
    return float(np.linalg.norm(a - b) / np.linalg.norm(b))


def of_variant(name: str, memory: str, other: str, whole: bool) -> str:
    """One row of the table."""
    cfg, data, model = setup(name, memory)
    batch, device = data.batches["train"], "cuda" if other == "gpu" else "cpu"
    here, there = (slope(moved(model, 0.1), batch, place) for place in ("cpu", device))
    told = [abs(there[0] / here[0] - 1), apart(there[1:], here[1:])]
    cpu, slow = after(cfg, data, model, "cpu", EPOCHS)
    accelerated, fast = after(cfg, data, model, other, EPOCHS)
    doubled = [after(cfg, data, copy.deepcopy(model).double(), place, EPOCHS)[0] for place in (other, "cpu")
               if memory == "state"]  # fmt: skip
    torch.set_num_threads(1)
    rounded = [after(cfg, data, start, "cpu", EPOCHS)[0] for start in (model, moved(model, 1e-7))]
    torch.set_num_threads(ALL)
    reached = force(cpu, data)
    told += [apart(force(accelerated, data), reached), max(apart(force(own, data), reached) for own in rounded)]
    double = f"{apart(*(force(own, data) for own in doubled)):12.1e}" if doubled else 12 * " "
    row = f"{name + '+' * (memory == 'state') + 'memory' * (memory == 'state'):14s}" + "".join(
        f"{x:12.1e}" for x in told
    )
    row += f"{double}{1e3 * slow / EPOCHS:12.1f}{1e3 * fast / EPOCHS:10.1f}"
    if whole:
        for accelerator in ("cpu", other):
            own, seconds = after(cfg, data, model, accelerator, int(cfg["trainer"]["max_epochs"]))
            row += f"{seconds:10.0f}{force_errors(own, data.select('held_out'))['mse']:10.4f}"
    return row


class Clock(L.Callback):
    """Seconds of every epoch."""

    def __init__(self, device: str):
        self.device, self.ends = device, list[float]()

    def on_train_epoch_end(self, trainer, pl_module) -> None:
        if self.device == "gpu":
            torch.cuda.synchronize()
        self.ends.append(time.perf_counter())

    def epoch(self) -> float:
        return statistics.median(np.diff(self.ends[2:]))


def together(name: str, count: int, other: str) -> str:
    """Milliseconds per epoch of so many networks as one program, and how far their forces are apart."""
    cfg, data, model = setup(name, "windows", f"ensemble={count}")
    seconds, forces = [], []
    for accelerator in ("cpu", other):
        own, clock = copy.deepcopy(model), Clock(accelerator)
        cfg = cfg | {"trainer": cfg["trainer"] | {"accelerator": accelerator, "max_epochs": EPOCHS}}
        with tempfile.TemporaryDirectory() as folder:
            trainer = build_trainer(cfg, Path(folder), False, None, clock)
            trainer.fit(own, datamodule=data)
        forces.append(force(own.to("cpu"), data))
        seconds.append(1e3 * clock.epoch())
    cpu, accelerated = seconds
    off = apart(*forces[::-1])
    return f"{name:14s}{count:4d}{cpu:14.1f}{accelerated:10.1f}{cpu / accelerated:9.1f}{off:14.1e}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--models", nargs="+", default=["bb1", "bb2", "pe1", "pe2"])
    parser.add_argument("--memory", nargs="+", default=["windows", "state"])
    parser.add_argument("--whole", action="store_true")
    parser.add_argument("--members", type=int, default=64)
    parser.add_argument("--other", default="gpu")
    given = parser.parse_args()
    quiet()
    device = torch.cuda.get_device_name() if given.other == "gpu" else "CPU"
    path = ROOT / "benchmarks" / "results" / "accelerator.txt"
    lines = [
        "python benchmarks/accelerator.py" + " --whole" * given.whole,
        f"{device} against a CPU with {ALL} cores; Python {platform.python_version()}, torch {torch.__version__}",
        "",
        f"{'relative differences':14s}{'loss':>6s}{'gradient':>12s}{f'after {EPOCHS}':>12s}{'rounding':>12s}"
        f"{'in double':>12s}{'CPU, ms':>12s}{'GPU, ms':>10s}" + "   CPU, s      N^2    GPU, s      N^2" * given.whole,
    ]

    def told(line: str) -> None:
        print(line, flush=True)
        lines.append(line)
        path.write_text("\n".join(lines) + "\n", encoding="utf-8")

    print("\n".join(lines))
    for memory in given.memory:
        for name in given.models:
            told(of_variant(name, memory, given.other, given.whole))
    told("")
    told(f"{'one program of':14s}{'N':>4s}{'CPU, ms':>14s}{'GPU, ms':>10s}{'ratio':>9s}{'forces apart':>14s}")
    for name in given.models if given.members else ():
        told(together(name, given.members, given.other))


if __name__ == "__main__":
    main()
