"""Compare estimators of friction parameters: ``python identify.py system=pob``; options: conf/identify.yaml."""

from __future__ import annotations

from pathlib import Path

import hydra
from omegaconf import DictConfig, OmegaConf

from frictionpinn.workflow import cli

CONFIG = Path(__file__).resolve().parent / "conf"
failures: list[BaseException] = []


@hydra.main(config_path=str(CONFIG), config_name="identify", version_base="1.3")
def main(cfg: DictConfig) -> None:
    """Estimate by every method that the configuration names."""
    from frictionpinn.workflow.identify import identify

    folder = Path(hydra.core.hydra_config.HydraConfig.get().runtime.output_dir)
    with cli.collected(failures):
        identify(OmegaConf.to_container(cfg, resolve=True), folder)  # type: ignore[arg-type]


if __name__ == "__main__":
    cli.run(main, CONFIG, "identify", failures)
