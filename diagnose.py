"""What a declared model lacks: ``python diagnose.py system=pob data=csv data.path=run.csv``; see conf/diagnose.yaml."""

from __future__ import annotations

from pathlib import Path

import hydra
from hydra.core.hydra_config import HydraConfig
from omegaconf import DictConfig, OmegaConf

from frictionpinn.workflow import cli

CONFIG = Path(__file__).resolve().parent / "conf"
failures: list[BaseException] = []


@hydra.main(config_path=str(CONFIG), config_name="diagnose", version_base="1.3")
def main(cfg: DictConfig) -> None:
    """Diagnose the model and the recording that the configuration names."""
    from frictionpinn.workflow.diagnose import diagnose

    with cli.collected(failures):
        folder = Path(HydraConfig.get().runtime.output_dir)
        diagnose(OmegaConf.to_container(cfg, resolve=True), folder)  # type: ignore[arg-type]


if __name__ == "__main__":
    cli.run(main, CONFIG, "diagnose", failures)
