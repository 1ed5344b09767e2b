"""Where configurations lie, in the repository, in a wheel and in a folder of the user's, and how they are composed."""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from hydra import compose, initialize_config_dir
from hydra.core.global_hydra import GlobalHydra
from omegaconf import DictConfig, OmegaConf

from ..errors import UserError

_PACKAGE = Path(__file__).resolve().parents[1]
# Shipped inside a wheel, at the top of the repository beside the package.
CONF = next((path for path in (_PACKAGE / "conf", _PACKAGE.parent / "conf") if path.is_dir()), _PACKAGE / "conf")
SCRIPTS = frozenset(path.stem for path in CONF.glob("*.yaml"))  # a command is a file there


def quote(value: object) -> str:
    """A value as Hydra's grammar reads any text: in single quotes."""
    text = str(value).replace("\\", "\\\\").replace("'", "\\'")
    return f"'{text}'"


def written(value: object) -> str:
    """A plain value in Hydra's grammar."""
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{key}: {written(item)}" for key, item in value.items()) + "}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(written(item) for item in value) + "]"
    if value is None or isinstance(value, bool):
        return "null" if value is None else str(value).lower()
    return repr(value) if isinstance(value, int | float) else quote(value)


def called(command: str) -> str:
    """A command as it is called here: by its script, or as one of the package's console commands."""
    return f"python {command}.py" if Path(sys.argv[0]).stem in SCRIPTS else f"frictionpinn {command}"


def with_extensions(cfg: dict[str, Any]) -> dict[str, Any]:
    """The configuration with the paths of its ``extensions`` absolute: its run may be read from elsewhere."""
    return cfg | {"extensions": [str(Path(item).absolute()) for item in cfg.get("extensions") or []]}


class Configs:
    """The folders that hold configurations: the package's own and one of the user's (``--config-dir``).

    Args:
        folder: with the files of every group, and ``<name>.yaml``.
        name: of the command.
        own: the user's folder, which adds options to the groups; None for none.
    """

    def __init__(self, folder: Path, name: str, own: str | Path | None = None):
        self.folder, self.name = folder, name
        self.own = None if own is None else Path(own).absolute()
        if self.own is not None and not self.own.is_dir():
            raise UserError("no such folder", where="--config-dir", received=str(own), fix="name a folder")

    def is_group(self, key: str) -> bool:
        """Whether files are the values of this key."""
        return any((folder / key).is_dir() for folder in self._folders)

    def options(self, group: str) -> list[str]:
        """Names of the files of a group."""
        return sorted({path.stem for folder in self._folders for path in (folder / group).glob("*.yaml")})

    def commands_with(self, group: str) -> list[str]:
        """Commands that take an option of a group."""
        tables = {name: OmegaConf.load(self.folder / f"{name}.yaml") for name in sorted(SCRIPTS)}
        groups = {name: [*table.get("defaults", [])] for name, table in tables.items() if isinstance(table, DictConfig)}
        return [name for name, own in groups.items() if any(group in item for item in own if item != "_self_")]

    def meant(self, key: str) -> str:
        """What a value that has to be given may be, in the words of the file that asks for it."""
        asks = re.compile(rf"^ *{re.escape(key.rpartition('.')[2])}: \?\?\? *# *(.+)$", re.M)
        texts = (
            path.read_text(encoding="utf-8") for folder in self._folders for path in sorted(folder.rglob("*.yaml"))
        )
        return next((found[1] for found in map(asks.search, texts) if found), "")

    @property
    def _folders(self) -> list[Path]:
        return [folder for folder in (self.folder, self.own) if folder is not None]

    @contextmanager
    def opened(self) -> Iterator[Configs]:
        """Hydra's state for :meth:`compose`, as it was again afterwards."""
        GlobalHydra.instance().clear()
        try:
            with initialize_config_dir(str(self.folder), version_base="1.3"):
                yield self
        finally:
            GlobalHydra.instance().clear()

    def compose(self, overrides: Sequence[str], hydra: bool = False) -> DictConfig:
        """The configuration with these options, within :meth:`opened`; with its section ``hydra`` if wanted."""
        path = [] if self.own is None else [f"hydra.searchpath=[{quote(f'file://{self.own}')}]"]
        return compose(self.name, overrides=[*overrides, *path], return_hydra_config=hydra)
