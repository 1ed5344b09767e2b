"""Check a recording before anything is learned from it: ``python check.py system=pob data.path=run.csv``."""

from __future__ import annotations

from pathlib import Path

import hydra
from omegaconf import DictConfig, OmegaConf

from frictionpinn.workflow import cli

CONFIG = Path(__file__).resolve().parent / "conf"
failures: list[BaseException] = []


@hydra.main(config_path=str(CONFIG), config_name="check", version_base="1.3")
def main(cfg: DictConfig) -> None:
    """Print what is assumed of the recording that the configuration names, and what speaks against it."""
    from frictionpinn.workflow.check import check

    with cli.collected(failures):
        check(OmegaConf.to_container(cfg, resolve=True))  # type: ignore[arg-type]


if __name__ == "__main__":
    cli.run(main, CONFIG, "check", failures)
