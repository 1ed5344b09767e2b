"""Options of the command line, checked before Hydra reads them: one line with the nearest valid name."""

from __future__ import annotations

import argparse
import re
import tempfile
from collections.abc import Iterable, Mapping, Sequence
from fnmatch import fnmatch
from glob import glob
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NoReturn

from hydra._internal.utils import get_args_parser
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.override_parser.types import ChoiceSweep, Glob, Override
from hydra.errors import HydraException
from omegaconf import OmegaConf
from omegaconf.errors import MissingMandatoryValue, OmegaConfBaseException

from ..errors import UserError, nearest, nearest_of
from .configs import CONF, Configs, called, quote
from .contact_options import contact_options
from .manifest import check_free

FILES = re.compile(r"data\.path=glob\(")  # Hydra's own glob() is of the options of groups
EXTENDED = ("system", "friction")  # groups to which users add options of their own


def parsed(arguments: Sequence[str]) -> argparse.Namespace:
    """Hydra's own flags and, as ``overrides``, the options, in any order.

    Raises:
        UserError: a flag that Hydra has not, or without its value.
    """

    def refuse(message: str) -> NoReturn:
        raise UserError("not a flag", where="command line", received=" ".join(arguments), fix=message)

    parser = get_args_parser()
    parser.error = refuse  # type: ignore[method-assign]
    return parser.parse_intermixed_args(list(arguments))


def composed(name: str, overrides: Sequence[str], own: str | Path | None = None) -> dict[str, Any]:
    """The configuration of a command with overrides, checked, as plain values.

    Raises:
        UserError: an unknown option, key or value.
    """
    configs, overrides = Configs(CONF, name, own), contact_options(overrides)
    _check(configs, overrides, many=False)
    with configs.opened():
        return OmegaConf.to_container(configs.compose(overrides), resolve=True)  # type: ignore[return-value]


def check_command_line(config_folder: Path, config_name: str, arguments: Sequence[str]) -> None:
    """Raise :class:`UserError` for an unknown group option or key, before Hydra reads the command line."""
    given = parsed(arguments)
    # A preset may ask for a sweep by itself (hydra.mode).
    many = given.multirun or any(item.startswith("experiment=") for item in given.overrides)
    _check(Configs(config_folder, given.config_name or config_name, given.config_dir), given.overrides, many)


def _check(configs: Configs, texts: list[str], many: bool) -> None:
    for text in texts:
        if "=" not in text and not text.startswith("~"):
            raise UserError("not an option", where="command line", received=repr(text), allowed="key=value",
                            fix=_meant(configs, text))  # fmt: skip
    try:
        overrides = OverridesParser.create().parse_overrides(texts)
    except HydraException as error:
        marked = next((text for text in texts if re.search(r"=[^'\"{\[]*[\[\](){},= ]", text)), "")
        key, _, value = marked.partition("=")
        if value.startswith(("{", "[")):  # a table as it is, its texts quoted
            value = re.sub(r"(?<=[:,{[])\s*([^\s,:{}\[\]\"'][^,:{}\[\]\"']*[*/^()= ][^,:{}\[\]\"']*)", r' "\1"', value)
            fix = f"quote the texts in it: '{key}={value}'"
        else:
            fix = f'quote it: "{key}={quote(value)}"' if marked else str(error).splitlines()[0]
        raise UserError("not an override", where="command line", received=marked or " ".join(texts), fix=fix) from error
    for override in overrides:
        if override.is_sweep_override() and not many:
            raise UserError(
                "several values for one run",
                where="command line",
                received=override.input_line,
                allowed="one value, or -m before the options for a sweep over them",
                fix="write a text that holds commas in quotes, a list in brackets",
            )
        _check_choice(configs, override)
    own = [override for override in overrides if not override.key_or_group.startswith("hydra")]
    plain = [item for item in own if not configs.is_group(item.key_or_group)]
    further = [(item.key_or_group, value) for item in plain for value in _values(item)[1:]]
    _check_keys(configs, [_first(override) for override in own], further)


def _meant(configs: Configs, text: str) -> str:
    """What a text without ``=`` may have been meant for."""
    if Path(text).exists():
        key = {"train": "data=csv data.path", "evaluate": "run"}.get(configs.name, "data=csv data.path")
        return f"say {key}={text}"
    return f"see {called(configs.name)} --help"


def with_files(arguments: Sequence[str]) -> list[str]:
    """The arguments of a sweep with the files that ``data.path=glob(logs/*.csv)`` stands for.

    Raises:
        UserError: there is no such file.
    """
    if not {"-m", "--multirun"} & set(arguments):
        return list(arguments)
    return [_files(item) if FILES.match(item) else item for item in arguments]


def _files(text: str) -> str:
    (override,) = OverridesParser.create().parse_overrides([text])
    told = override.value()
    if not isinstance(told, Glob):
        return text
    # A job knows its recording by name; a folder that moves takes its sweep along.
    found = sorted({path for pattern in told.include for path in glob(pattern, recursive=True)})
    found = [path for path in found if not any(fnmatch(path, pattern) for pattern in told.exclude)]
    if not found:
        raise UserError("no such files", where=override.key_or_group, received=", ".join(told.include),
                        fix="name files that are there")  # fmt: skip
    return f"{override.key_or_group}={','.join(quote(path) for path in found)}"


def output_folder(config_folder: Path, config_name: str, arguments: Sequence[str]) -> Path:
    """Where the results of a run or a sweep will be.

    Raises:
        UserError: they cannot be written there, or would overwrite those of another run.
    """
    given = parsed(arguments)
    texts = [_first(override) for override in OverridesParser.create().parse_overrides(given.overrides)]
    configs = Configs(config_folder, given.config_name or config_name, given.config_dir)
    try:
        with configs.opened():
            config = configs.compose([item for item in texts if item], hydra=True)
            many = given.multirun or str(config.hydra.mode).endswith("MULTIRUN")
            folder = Path(str(config.hydra.sweep.dir if many else config.hydra.run.dir))
    except (HydraException, OmegaConfBaseException) as error:
        reason = " ".join(str(error.__cause__ or error).split())
        raise UserError("Hydra cannot be configured so", where="command line", fix=reason) from error
    present = next((item for item in (folder, *folder.absolute().parents) if item.exists()), folder)
    try:
        with tempfile.TemporaryFile(dir=present) as file:
            file.write(b"0" * (1 << 16))
    except OSError as error:
        key = f"hydra.{'sweep' if many else 'run'}.dir"
        fix = f"make room or allow it, or write elsewhere with {key}=..."
        raise UserError("cannot write", where=str(folder), received=error.strerror, fix=fix) from error
    if not many and "ckpt_path" in config:
        check_free(folder, config.ckpt_path)
    return folder


def _values(override: Override) -> list[object]:
    value = override.value()
    return list(value.list) if isinstance(value, ChoiceSweep) else [value]


def _check_launcher(configs: Configs, name: str) -> None:
    """Raise :class:`UserError` for a launcher that there is not, or whose package is missing."""
    valid = ["basic", "joblib", *configs.options("hydra/launcher")]
    if name not in valid:
        fix = nearest(name, valid) or "use one of the allowed names"
        raise UserError("unknown launcher", where="hydra/launcher", received=name, allowed=", ".join(valid), fix=fix)
    package = {"joblib": "hydra_plugins.hydra_joblib_launcher", "ray": "ray", "slurm": "submitit"}.get(name)
    if package is not None and find_spec(package) is None:
        fix = f'pip install -c constraints.txt -e ".[{name}]"'
        raise UserError(
            f"{package.rpartition('.')[2]} is not installed", where="hydra/launcher", received=name, fix=fix
        )


def _check_choice(configs: Configs, override: Override) -> None:
    if override.key_or_group == "hydra/launcher":
        _check_launcher(configs, str(override.value()))
    group = override.key_or_group
    if group.startswith("hydra") or not configs.is_group(group):
        return
    valid = configs.options(group)
    if override.is_delete():
        raise UserError("cannot be left out", where=group, allowed=", ".join(valid))
    for value in _values(override):
        if str(value) not in valid and not (value is None and group in ("experiment", "preset")):
            own = f"; one of your own is FOLDER/{group}/{value}.yaml with --config-dir FOLDER, and extensions=[FILE.py]"
            raise UserError(
                "unknown option",
                where=group,
                received=str(value),
                allowed=", ".join(valid),
                fix=nearest(value, valid) or "use one of the allowed names" + (own if group in EXTENDED else ""),
            )


def _first(override: Override) -> str:
    """The override with only the first value of a sweep."""
    if not override.is_sweep_override():
        return override.input_line or ""
    text = override.input_line or ""
    key, _, value = text.partition("=")
    return f"{key}={value.split(',')[0]}" if isinstance(override.value(), ChoiceSweep) else ""


def _check_keys(configs: Configs, overrides: list[str], further: Sequence[tuple[str, object]] = ()) -> None:
    """Compose the configuration; ``further`` are the other values of a sweep, by key."""
    plain = [item for item in overrides if item]
    choices = [item for item in plain if configs.is_group(item.partition("=")[0].lstrip("+~"))]
    with configs.opened():
        try:
            config, default = configs.compose(plain), configs.compose(choices)
            OmegaConf.to_container(config, resolve=True, throw_on_missing=True)
            changed = [item.partition("=")[0].lstrip("+~") for item in plain]
            for key, value in [*((key, OmegaConf.select(config, key)) for key in changed), *further]:
                _check_type(key, OmegaConf.select(default, key), getattr(value, "text", value))
        except (HydraException, OmegaConfBaseException) as error:
            raise _explain(error, configs, choices) from error


def _check_type(key: str, before: object, after: object) -> None:
    """A number or a switch of the configuration must stay one."""
    if isinstance(after, str) and "${" in after:
        return
    number = isinstance(before, int | float) and not isinstance(before, bool)
    kind = "list" if OmegaConf.is_list(before) else "table" if OmegaConf.is_dict(before) else ""
    same = isinstance(after, list) or OmegaConf.is_list(after) if kind == "list" else isinstance(after, Mapping)
    if kind and after is not None and not same:
        alone = kind == "list" and isinstance(after, str | int | float)
        example = f"[{after}]" if alone else "[1, 2]" if kind == "list" else "{key: value}"
        raise UserError(f"not a {kind}", where=key, received=repr(after), allowed=f"a {kind} such as {example}")
    whole = isinstance(before, int) and re.search(r"epochs|steps|seed|patience|width|depth|bits|size|iter", key)
    if whole and isinstance(after, float) and not after.is_integer():
        raise UserError("not a whole number", where=key, received=after, allowed=f"a whole number such as {before}")
    wrong = number and (isinstance(after, bool) or not isinstance(after, int | float | None))
    if wrong or (isinstance(before, bool) and not isinstance(after, bool)):
        raise UserError(
            "not a number" if number else "not a switch",
            where=key,
            received=repr(after),
            allowed=f"a number such as {before}" if number else "true or false",
            fix="write the value without a unit" if number else "",
        )


def _explain(error: Exception, configs: Configs, choices: list[str]) -> UserError:
    cause = error.__cause__ or error
    text = f"{error} {cause}"
    if isinstance(cause, MissingMandatoryValue) or isinstance(error, MissingMandatoryValue):
        key = getattr(error, "full_key", None) or getattr(cause, "full_key", None) or "?"
        return UserError("a value is missing", where=key, received="nothing", allowed=configs.meant(key),
                         fix=f"add {key}=... to the command")  # fmt: skip
    unknown = re.search(r"(?:Could not override|No match in the defaults list[^']*|Key) '([\w./@]+)'", text)
    if unknown:
        key = unknown.group(1)
        full = re.search(r"full_key: ([\w.]+)", text)
        if configs.is_group(key):
            takes = ", ".join(called(name) for name in configs.commands_with(key))
            return UserError("no option of this command", where="command line", received=key, allowed=f"with {takes}",
                             fix="use one of these, or leave it out")  # fmt: skip
        keys = _all_keys(configs, choices)
        key = full.group(1) if full else key
        parent = key.rpartition(".")[0]
        while parent and parent not in keys:
            parent = parent.rpartition(".")[0]
        written = keys.get(parent)
        if isinstance(written, str) and written.startswith("${"):
            source = written.strip("${}")
            return UserError(
                "set where it is written",
                where="command line",
                received=key,
                allowed=f"{source}{key[len(parent) :]}",
                fix=f"{parent} is a copy of {source}",
            )
        siblings = [name for name in keys if name.rpartition(".")[0] == parent] or list(keys)
        return UserError(
            "unknown key",
            where="command line",
            received=key,
            allowed=", ".join(name.rpartition(".")[2] for name in siblings[:15]),
            fix=_meant_key(key, siblings) or _meant_key(key, keys, 0.8) or "see conf/ for all keys",
        )
    return UserError("the configuration cannot be composed", where="command line", fix=str(cause).splitlines()[0])


def _meant_key(key: str, keys: Iterable[str], cutoff: float = 0.5) -> str:
    """The nearest of some keys by the last part of each: that is misspelt, and not the path to it."""
    return nearest_of(key.rpartition(".")[2], {name.rpartition(".")[2]: name for name in keys}, cutoff)


def _all_keys(configs: Configs, choices: list[str]) -> dict[str, object]:
    """Full key -> value as written, of the configuration with these choices of groups, within ``opened``."""
    config = OmegaConf.to_container(configs.compose(choices), resolve=False)

    def walk(node: object, prefix: str) -> dict[str, object]:
        if not isinstance(node, dict):
            return {}
        table = {f"{prefix}{key}": value for key, value in node.items()}
        for key, value in node.items():
            table |= walk(value, f"{prefix}{key}.")
        return table

    return walk(config, "")
