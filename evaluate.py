"""Evaluate a trained friction model: ``python evaluate.py run=outputs/pob/pe1/...``; options: conf/evaluate.yaml."""

from __future__ import annotations

from pathlib import Path

import hydra
from omegaconf import DictConfig, OmegaConf

from frictionpinn.workflow import cli

CONFIG = Path(__file__).resolve().parent / "conf"
failures: list[BaseException] = []


@hydra.main(config_path=str(CONFIG), config_name="evaluate", version_base="1.3")
def main(cfg: DictConfig) -> None:
    """Evaluate the run that the configuration names."""
    from frictionpinn.workflow.evaluate import evaluate
    from frictionpinn.workflow.export import export

    act = export if cfg.export else evaluate
    with cli.collected(failures):
        act(OmegaConf.to_container(cfg, resolve=True))  # type: ignore[arg-type]


if __name__ == "__main__":
    cli.run(main, CONFIG, "evaluate", failures)
