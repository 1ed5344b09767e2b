"""Train a friction model: ``python train.py model=pe2 system=pob``; every option is a file in conf/."""

from __future__ import annotations

from pathlib import Path

import hydra
from omegaconf import DictConfig, OmegaConf

from frictionpinn.workflow import cli, job

CONFIG = Path(__file__).resolve().parent / "conf"
failures: list[BaseException] = []


@hydra.main(config_path=str(CONFIG), config_name="train", version_base="1.3")
def main(cfg: DictConfig) -> float | None:
    """Train what the configuration says; returns the held-out force error."""
    folder = Path(hydra.core.hydra_config.HydraConfig.get().runtime.output_dir)
    plain: dict = OmegaConf.to_container(cfg, resolve=True)  # type: ignore[assignment]
    if job.in_sweep(folder):
        return job.run_job(plain, folder)
    from frictionpinn.workflow.train import train

    with cli.collected(failures):
        return train(plain, folder)["force_error"]["model"]["rmse"]
    return None


if __name__ == "__main__":
    cli.run(main, CONFIG, "train", failures)
