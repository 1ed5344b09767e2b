"""Systems, friction laws and effects from outside the package: files of the user's, and other installed packages."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from functools import cache
from importlib.metadata import entry_points
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType

from ..errors import UserError
from .base import FrictionLaw
from .effect import Effect
from .effects import EFFECTS
from .friction import LAWS
from .system import System
from .systems import SYSTEMS

_MODULE = "frictionpinn_extension_"
GROUP = "frictionpinn"  # of the entry points: each a module with classes, or a class
TABLES: tuple[tuple[type, dict], ...] = ((System, SYSTEMS), (FrictionLaw, LAWS), (Effect, EFFECTS))


def load(files: Iterable[str | Path] = ()) -> None:
    """Register what installed packages bring, and every class of the files that is a system, a law or an effect.

    Args:
        files: Python files; a name ``tilt`` that a class of one of them has is then a system, law or effect as any.

    Raises:
        UserError: no such file, one that cannot be imported or holds no such class, a name that is taken.
    """
    _installed()
    for file in files:
        path = Path(file).absolute()
        if not path.is_file():
            raise UserError("no such file", where="extensions", received=str(file), fix="name a Python file")
        _from_file(path, path.stat().st_mtime)


def files_of(things: Iterable[object]) -> list[str]:
    """The files that define systems, laws or effects; none for those of the package and of installed ones."""
    modules = sorted({type(thing).__module__ for thing in things})
    return [str(sys.modules[name].__file__) for name in modules if name.startswith(_MODULE)]


@cache
def _installed() -> None:
    for point in entry_points(group=GROUP):
        try:
            found = point.load()
        except Exception as error:
            raise _broken(f"entry point {point.name}", point.value, error) from error
        register([found] if isinstance(found, type) else _kinds(found), f"entry point {point.name}")


@cache
def _from_file(path: Path, changed: float) -> None:
    """Import a file and register its classes; again where it has changed."""
    name = f"{_MODULE}{path.stem}"
    spec = spec_from_file_location(name, path)
    if spec is None or spec.loader is None:
        raise UserError("not a Python file", where="extensions", received=str(path), allowed="a file ending in .py")
    module = sys.modules[name] = module_from_spec(spec)
    try:
        spec.loader.exec_module(module)
    except Exception as error:
        raise _broken("extensions", str(path), error) from error
    register(_kinds(module), str(path))


def _broken(where: str, received: str, error: Exception) -> UserError:
    said = f"{type(error).__name__}: {error}"
    return UserError("an extension cannot be imported", where=where, received=received, fix=said)


def _kinds(module: ModuleType) -> list[type]:
    """The systems, laws and effects that a module defines."""
    bases = tuple(base for base, _ in TABLES)
    own = [item for item in vars(module).values() if isinstance(item, type) and item.__module__ == module.__name__]
    return [kind for kind in own if issubclass(kind, bases) and kind.name]  # type: ignore[attr-defined]


def register(kinds: Iterable[type], source: str) -> None:
    """Add classes to the tables of systems, laws and effects, by their names.

    Raises:
        UserError: there is none, or another class has the name.
    """
    kinds = list(kinds)
    if not kinds:
        raise UserError("no system, friction law or effect", where=source, allowed="classes with a name, derived from "
                        "System, FrictionLaw or Effect of frictionpinn.physics")  # fmt: skip
    for kind in kinds:
        table = next(table for base, table in TABLES if issubclass(kind, base))
        name = kind.name  # type: ignore[attr-defined]
        present = table.get(name)
        if present is not None and (present.__module__, present.__name__) != (kind.__module__, kind.__name__):
            raise UserError("a name that is taken", where=source, received=name, fix=f"rename {kind.__name__}.name")
        table[name] = kind
