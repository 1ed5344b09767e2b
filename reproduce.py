"""Reproduce the paper: ``python reproduce.py`` writes docs/paper.md; options: conf/reproduce.yaml."""

from __future__ import annotations

from pathlib import Path

import hydra
from omegaconf import DictConfig, OmegaConf

from frictionpinn.workflow import cli

CONFIG = Path(__file__).resolve().parent / "conf"
failures: list[BaseException] = []


@hydra.main(config_path=str(CONFIG), config_name="reproduce", version_base="1.3")
def main(cfg: DictConfig) -> None:
    """Run the parts that are not finished and write the document."""
    from frictionpinn.reproduce.parts import reproduce

    with cli.collected(failures):
        reproduce(OmegaConf.to_container(cfg, resolve=True))  # type: ignore[arg-type]


if __name__ == "__main__":
    cli.run(main, CONFIG, "reproduce", failures)
