"""The commands: ``frictionpinn train ...`` of an installed package, and the scripts of the same names."""

from __future__ import annotations

import os
import shutil
import sys
from collections.abc import Callable
from contextlib import nullcontext
from importlib import import_module
from pathlib import Path
from typing import Any

import hydra
from hydra.core.hydra_config import HydraConfig
from hydra.types import RunMode
from omegaconf import DictConfig, OmegaConf

from .. import __version__
from ..errors import UserError, choose
from ..progress import clock
from . import cli
from .configs import CONF, with_extensions

Act = Callable[[dict[str, Any], Path], Any]  # takes the resolved configuration and the folder of the run


def _later(module: str, name: str, *, with_folder: bool = True) -> Act:
    """A function of the package, imported when it is called: a command that is refused loads nothing."""

    def act(cfg: dict[str, Any], folder: Path) -> Any:
        function = getattr(import_module(f"frictionpinn.{module}"), name)
        return function(cfg, folder) if with_folder else function(cfg)

    return act


def _train(cfg: dict[str, Any], folder: Path) -> float | None:
    from . import job

    if job.in_sweep(folder):
        return job.run_job(cfg, folder, "train")
    from .train import train

    return train(cfg, folder)["force_error"]["model"]["rmse"]


def _diagnose(cfg: dict[str, Any], folder: Path) -> Any:
    from . import job

    if job.in_sweep(folder):
        return job.run_job(cfg, folder, "diagnose")
    return _later("workflow.diagnose", "diagnose")(cfg, folder)


def _evaluate(cfg: dict[str, Any], folder: Path) -> Any:
    name = "export" if cfg["export"] else "evaluate"
    return _later(f"workflow.{name}", name, with_folder=False)(cfg, folder)


# Name, which is that of a file in conf/, -> what it does. A new command is one file there and one line here.
COMMANDS: dict[str, tuple[str, Act]] = {
    "check": (
        "what is assumed of a recording, what speaks against it",
        _later("workflow.check", "check", with_folder=False),
    ),
    "train": ("learn a friction model from a recording", _train),
    "evaluate": ("a trained model online and in simulation, and its export", _evaluate),
    "identify": ("parameters of a friction law, by several estimators", _later("workflow.identify", "identify")),
    "diagnose": ("what a friction model lacks, of one recording or of many (-m)", _diagnose),
    "compensate": (
        "friction compensation of an axis, recorded before and after",
        _later("workflow.compensate", "compensate"),
    ),
    "reproduce": ("the paper's tables and figures", _later("reproduce.parts", "reproduce", with_folder=False)),
}


def run(name: str) -> None:
    """Run a command with the options of ``sys.argv``; ends the process after an error."""
    failures: list[BaseException] = []

    @hydra.main(config_path=str(CONF), config_name=name, version_base="1.3")
    def main(cfg: DictConfig) -> Any:
        from ..physics import extensions

        config = HydraConfig.get()
        folder = Path(config.runtime.output_dir)
        in_sweep = config.mode == RunMode.MULTIRUN
        fresh = config.mode == RunMode.RUN and sorted(os.listdir(folder)) == [".hydra"]
        try:
            with cli.collected(failures):
                plain: dict[str, Any] = OmegaConf.to_container(cfg, resolve=True)  # type: ignore[assignment]
                plain = with_extensions(plain)
                extensions.load(plain["extensions"])
                with clock() if name != "train" and not in_sweep else nullcontext():  # a training has its own bar
                    return COMMANDS[name][1](plain, folder)
        finally:
            if fresh:
                _clear(folder)
        return None

    cli.run(main, name, failures)


def _clear(folder: Path) -> None:
    """Remove a run's folder that holds but Hydra's record and a log, and the folders that this leaves empty."""
    if any(item.name != ".hydra" and item.suffix != ".log" for item in folder.iterdir()):
        return
    shutil.rmtree(folder, ignore_errors=True)
    here = Path.cwd()
    for parent in folder.parents:
        if parent == here or here not in parent.parents or any(parent.iterdir()):
            return
        parent.rmdir()


def main() -> None:
    """``frictionpinn COMMAND ...``."""
    name, *rest = sys.argv[1:] or ["--help"]
    if name in ("-sc", "--shell-completion"):
        name, rest = _completed(sys.argv[1:])
    if name == "--version":
        print(f"frictionpinn {__version__}")
    elif name in ("-h", "--help"):
        width = max(map(len, COMMANDS))
        lines = [f"  {key:<{width}}  {text}" for key, (text, _) in COMMANDS.items()]
        print("\n".join(["frictionpinn COMMAND key=value ...", "", *lines, "", "frictionpinn COMMAND --help"]))
    elif name:
        try:
            choose(name, COMMANDS, "command")
        except UserError as error:
            cli.fail(error)
            sys.exit(cli.USER_ERROR)
        sys.argv[1:] = rest
        run(name)


def _completed(arguments: list[str]) -> tuple[str, list[str]]:
    """Tab completion: the command whose options Hydra completes; empty where the command itself is being typed."""
    words = os.environ.get("COMP_LINE", "").split(" ")
    if "query=bash" not in arguments:
        return "train", arguments  # prints the shell's function, the same for all
    if len(words) < 3:
        print(" ".join(COMMANDS))
        return "", []
    os.environ["COMP_LINE"] = " ".join([words[0], *words[2:]])
    return (words[1], arguments) if words[1] in COMMANDS else ("", [])
