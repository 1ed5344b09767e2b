"""What Lightning costs: one epoch of the default training against the same step in a bare torch loop.

    python benchmarks/train_step.py [--cases pe1 pe2 pe2+memory]

Both train the same model on the same batch with the same optimizer and schedule, in turn, in one process: the ratio is
the median over rounds. An epoch is one full-batch step; +memory: experiment=memory. Writes
benchmarks/results/train_step.txt, cases that are not run staying as they are.
"""

from __future__ import annotations

import argparse
import statistics
import sys
import tempfile
import time
from pathlib import Path

import lightning as L
import torch
from hydra import compose, initialize_config_dir
from omegaconf import OmegaConf

from frictionpinn.workflow.build import build_system
from frictionpinn.workflow.experiment import build_data, build_model
from frictionpinn.workflow.train import build_trainer, quiet

ROOT = Path(__file__).resolve().parents[1]
RESULT = ROOT / "benchmarks" / "results" / "train_step.txt"
EPOCHS, ROUNDS = 100, 9


def setup(name: str, *overrides: str):
    """Configuration, data and a fresh model."""
    with initialize_config_dir(str(ROOT / "conf"), version_base="1.3"):
        options = [f"model={name}", f"trainer.max_epochs={EPOCHS}", "trainer.accelerator=cpu", *overrides]
        cfg = OmegaConf.to_container(compose("train", overrides=options), resolve=True)
    L.seed_everything(0, verbose=False)
    system = build_system(cfg["system"])
    data = build_data(cfg, system)
    model = build_model(cfg, system, data)
    data.prepare_for(model)
    return cfg, data, model


def bare(cfg, data, model) -> float:
    """Seconds of EPOCHS steps in a plain loop."""
    made = model.configure_optimizers()
    optimizer, scheduler = made["optimizer"], made["lr_scheduler"]["scheduler"]
    batch = data.batches["train"]
    start = time.perf_counter()
    for _ in range(EPOCHS):
        optimizer.zero_grad()
        loss = model.losses(batch)["loss"]
        loss.backward()
        optimizer.step()
        scheduler.step()
    return time.perf_counter() - start


class Clock(L.Callback):
    """Seconds between the start and the end of the training itself."""

    def on_train_epoch_start(self, trainer, pl_module) -> None:
        if trainer.current_epoch == 0:
            self.begin = time.perf_counter()

    def on_train_epoch_end(self, trainer, pl_module) -> None:
        self.seconds = time.perf_counter() - self.begin


def with_lightning(cfg, data, model) -> float:
    """Seconds of EPOCHS epochs with everything that train.py switches on."""
    with tempfile.TemporaryDirectory() as folder:
        trainer = build_trainer(cfg, Path(folder), validation=False)
        clock = Clock()
        trainer.callbacks.append(clock)
        trainer.fit(model, datamodule=data)
        return clock.seconds


WAYS = (bare, with_lightning)


def main() -> None:
    quiet()
    torch.set_num_threads(1)
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", nargs="*", default=["pe1", "pe2", "pe2+memory", "bb2+memory"])
    head = (
        f"one epoch (a full-batch step), median of {ROUNDS} rounds of {EPOCHS}; torch {torch.__version__}, one thread"
    )
    known = dict(line.split(": ", 1) for line in RESULT.read_text().splitlines()[1:]) if RESULT.is_file() else {}
    for case in parser.parse_args().cases:
        name, *memory = case.split("+")
        pairs = []
        for _ in range(ROUNDS):
            loop, epoch = (time_of(*setup(name, *(["experiment=memory"] if memory else []))) for time_of in WAYS)
            pairs.append((loop, epoch))
        loop, epoch = (1e3 * statistics.median(column) / EPOCHS for column in zip(*pairs, strict=True))
        ratio = statistics.median(b / a for a, b in pairs)
        known[case] = f"bare loop {loop:.2f} ms, Lightning {epoch:.2f} ms, ratio {ratio:.3f}"
    text = "\n".join([head, *(f"{case}: {told}" for case, told in known.items())]) + "\n"
    sys.stdout.write(text)
    RESULT.write_text(text)


if __name__ == "__main__":
    main()
