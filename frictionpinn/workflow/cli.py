"""The command line: errors in one line, with the nearest valid name, before Hydra would print a traceback."""

from __future__ import annotations

import logging
import os
import re
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path

from hydra import compose, initialize_config_dir
from hydra.core.global_hydra import GlobalHydra
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.override_parser.types import ChoiceSweep, Override
from hydra.errors import HydraException
from omegaconf import OmegaConf
from omegaconf.errors import MissingMandatoryValue, OmegaConfBaseException

from ..errors import UserError, nearest, unwritable
from .manifest import check_free

USER_ERROR = 2
failed_jobs = 0  # of the sweep that ran in this process


def full_error() -> bool:
    """Whether the user wants tracebacks."""
    return os.environ.get("HYDRA_FULL_ERROR", "0") not in ("", "0")


def fail(error: BaseException) -> None:
    """Print the line of an error to the terminal."""
    text = " ".join(str(error).split())
    print(f"error: {text}", file=sys.stderr, flush=True)


@contextmanager
def collected(failures: list[BaseException]) -> Iterator[None]:
    """Print a user's error within and add it to ``failures``: in a sweep the other tasks go on."""
    try:
        try:
            yield
        except OSError as error:
            raise unwritable(error, "the disk", "make room or allow it, then start again") from error
    except UserError as error:
        if full_error():
            raise
        fail(error)
        failures.append(error)


def quote(value: object) -> str:
    """A value as Hydra's grammar reads any text: in single quotes."""
    text = str(value).replace("\\", "\\\\").replace("'", "\\'")
    return f"'{text}'"


def check_command_line(config_folder: Path, config_name: str, arguments: Sequence[str]) -> None:
    """Raise :class:`UserError` for an unknown group option or key, before Hydra reads the command line."""
    texts = [item for item in arguments if not item.startswith("-")]
    for text in texts:
        if "=" not in text and not text.startswith("~"):
            raise UserError(
                "not an option",
                where="command line",
                received=repr(text),
                allowed="key=value",
                fix="see python train.py --help",
            )
    try:
        overrides = OverridesParser.create().parse_overrides(texts)
    except HydraException as error:
        marked = next((text for text in texts if re.search(r"=[^'\"{\[]*[\[\](){},= ]", text)), "")
        key, _, value = marked.partition("=")
        fix = f'quote it: "{key}={quote(value)}"' if marked else str(error).splitlines()[0]
        raise UserError("not an override", where="command line", received=marked or " ".join(texts), fix=fix) from error
    # A preset may ask for a sweep by itself (hydra.mode).
    many = {"-m", "--multirun"} & set(arguments) or any(item.startswith("experiment=") for item in texts)
    for override in overrides:
        if override.is_sweep_override() and not many:
            raise UserError(
                "several values for one run",
                where="command line",
                received=override.input_line,
                allowed="one value, or -m before the options for a sweep over them",
                fix="write a text that holds commas in quotes, a list in brackets",
            )
        _check_choice(config_folder, override)
    own = [override for override in overrides if not override.key_or_group.startswith("hydra")]
    plain = [item for item in own if not (config_folder / item.key_or_group).is_dir()]
    further = [(item.key_or_group, value) for item in plain for value in _values(item)[1:]]
    _check_keys(config_folder, config_name, [_first(override) for override in own], further)


def check_output(config_folder: Path, config_name: str, arguments: Sequence[str]) -> None:
    """Raise :class:`UserError` where results cannot be written, or would overwrite those of another run."""
    multirun = any(item in ("-m", "--multirun") for item in arguments)
    texts = [item for item in arguments if not item.startswith("-")]
    overrides = [_first(override) for override in OverridesParser.create().parse_overrides(texts)]
    GlobalHydra.instance().clear()
    try:
        with initialize_config_dir(str(config_folder), version_base="1.3"):
            config = compose(config_name, overrides=[item for item in overrides if item], return_hydra_config=True)
            multirun = multirun or str(config.hydra.mode).endswith("MULTIRUN")
            folder = Path(str(config.hydra.sweep.dir if multirun else config.hydra.run.dir))
    except (HydraException, OmegaConfBaseException) as error:
        reason = " ".join(str(error.__cause__ or error).split())
        raise UserError("Hydra cannot be configured so", where="command line", fix=reason) from error
    finally:
        GlobalHydra.instance().clear()
    present = next((item for item in (folder, *folder.absolute().parents) if item.exists()), folder)
    try:
        with tempfile.TemporaryFile(dir=present) as file:
            file.write(b"0" * (1 << 16))
    except OSError as error:
        key = f"hydra.{'sweep' if multirun else 'run'}.dir"
        fix = f"make room or allow it, or write elsewhere with {key}=..."
        raise UserError("cannot write", where=str(folder), received=error.strerror, fix=fix) from error
    if not multirun and "ckpt_path" in config:
        check_free(folder, config.ckpt_path)


def _values(override: Override) -> list[object]:
    value = override.value()
    return list(value.list) if isinstance(value, ChoiceSweep) else [value]


def _check_launcher(config_folder: Path, name: str) -> None:
    """Raise :class:`UserError` for a launcher that there is not, or whose package is missing."""
    valid = ["basic", "joblib", *sorted(path.stem for path in (config_folder / "hydra" / "launcher").glob("*.yaml"))]
    if name not in valid:
        fix = nearest(name, valid) or "use one of the allowed names"
        raise UserError("unknown launcher", where="hydra/launcher", received=name, allowed=", ".join(valid), fix=fix)
    package = {"joblib": "hydra_plugins.hydra_joblib_launcher", "ray": "ray", "slurm": "submitit"}.get(name)
    if package is not None and find_spec(package) is None:
        fix = f'pip install -c constraints.txt -e ".[{name}]"'
        raise UserError(
            f"{package.rpartition('.')[2]} is not installed", where="hydra/launcher", received=name, fix=fix
        )


def _check_choice(config_folder: Path, override: Override) -> None:
    if override.key_or_group == "hydra/launcher":
        _check_launcher(config_folder, str(override.value()))
    group = config_folder / override.key_or_group
    if override.key_or_group.startswith("hydra") or not group.is_dir():
        return
    valid = sorted(path.stem for path in group.glob("*.yaml"))
    if override.is_delete():
        raise UserError("cannot be left out", where=override.key_or_group, allowed=", ".join(valid))
    for value in _values(override):
        if str(value) not in valid and not (value is None and override.key_or_group in ("experiment", "preset")):
            raise UserError(
                "unknown option",
                where=override.key_or_group,
                received=str(value),
                allowed=", ".join(valid),
                fix=nearest(value, valid) or "use one of the allowed names",
            )


def _first(override: Override) -> str:
    """The override with only the first value of a sweep."""
    if not override.is_sweep_override():
        return override.input_line or ""
    text = override.input_line or ""
    key, _, value = text.partition("=")
    return f"{key}={value.split(',')[0]}" if isinstance(override.value(), ChoiceSweep) else ""


def _check_keys(
    config_folder: Path, config_name: str, overrides: list[str], further: Sequence[tuple[str, object]] = ()
) -> None:
    """Compose the configuration; ``further`` are the other values of a sweep, by key."""
    GlobalHydra.instance().clear()
    try:
        with initialize_config_dir(str(config_folder), version_base="1.3"):
            plain = [item for item in overrides if item]
            config = compose(config_name, overrides=plain)
            default = compose(config_name, overrides=[item for item in plain if _is_group(config_folder, item)])
        OmegaConf.to_container(config, resolve=True, throw_on_missing=True)
        changed = [item.partition("=")[0].lstrip("+~") for item in plain]
        for key, value in [*((key, OmegaConf.select(config, key)) for key in changed), *further]:
            _check_type(key, OmegaConf.select(default, key), getattr(value, "text", value))
    except (HydraException, OmegaConfBaseException) as error:
        choices = [item for item in overrides if item and _is_group(config_folder, item)]
        raise _explain(error, config_folder, config_name, choices) from error
    finally:
        GlobalHydra.instance().clear()


def _is_group(config_folder: Path, override: str) -> bool:
    return (config_folder / override.partition("=")[0].lstrip("+~")).is_dir()


def _check_type(key: str, before: object, after: object) -> None:
    """A number or a switch of the configuration must stay one."""
    if isinstance(after, str) and "${" in after:
        return
    number = isinstance(before, int | float) and not isinstance(before, bool)
    kind = "list" if OmegaConf.is_list(before) else "table" if OmegaConf.is_dict(before) else ""
    same = isinstance(after, list) or OmegaConf.is_list(after) if kind == "list" else isinstance(after, Mapping)
    if kind and after is not None and not same:
        example = "[1, 2]" if kind == "list" else "{key: value}"
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


def _explain(error: Exception, config_folder: Path, config_name: str, choices: list[str]) -> UserError:
    cause = error.__cause__ or error
    text = f"{error} {cause}"
    if isinstance(cause, MissingMandatoryValue) or isinstance(error, MissingMandatoryValue):
        key = getattr(error, "full_key", None) or getattr(cause, "full_key", None) or "?"
        return UserError("a value is missing", where=key, received="nothing", fix=f"add {key}=... to the command")
    unknown = re.search(r"(?:Could not override|No match in the defaults list[^']*|Key) '([\w./@]+)'", text)
    if unknown:
        key = unknown.group(1)
        full = re.search(r"full_key: ([\w.]+)", text)
        keys = _all_keys(config_folder, config_name, choices)
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
            fix=nearest(key, siblings) or nearest(key, keys) or "see conf/ for all keys",
        )
    return UserError("the configuration cannot be composed", where="command line", fix=str(cause).splitlines()[0])


def _all_keys(config_folder: Path, config_name: str, choices: list[str]) -> dict[str, object]:
    """Full key -> value as written, of the configuration with these choices of groups."""
    with initialize_config_dir(str(config_folder), version_base="1.3"):
        config = OmegaConf.to_container(compose(config_name, overrides=choices), resolve=False)

    def walk(node: object, prefix: str) -> dict[str, object]:
        if not isinstance(node, dict):
            return {}
        table = {f"{prefix}{key}": value for key, value in node.items()}
        for key, value in node.items():
            table |= walk(value, f"{prefix}{key}.")
        return table

    return walk(config, "")


def saved_friction(arguments: list[str]) -> list[str]:
    """The arguments with ``friction=<file of a diagnosis>`` as its law, its system and the file's effects.

    Raises:
        UserError: no such file, or not one of these; a system beside it that is another.
    """
    given = [a for a in arguments if a.startswith("friction=") and a.endswith((".yaml", ".yml"))]
    if not given:
        return arguments
    from ..diagnose.augmented import data_of, load_augmented

    path = Path(given[0].partition("=")[2]).resolve()
    mechanism, _ = load_augmented(path)
    name = mechanism.system.name
    for other in (a for a in arguments if a.startswith("system=") and a != f"system={name}"):
        raise UserError("friction model of another system", where="friction", received=f"{path.name} with {other}",
                        allowed=f"system={name}", fix=f"say system={name}")  # fmt: skip
    rest = [a for a in arguments if a != given[0] and not a.startswith("system=")]
    own = [] if any(a.startswith("data=") for a in arguments) else _recording(data_of(path), rest)
    return [*rest, *own, f"system={name}", f"friction={mechanism.law.name}", f"+system.augmented='{path}'"]


def _recording(data: Mapping[str, object], given: Sequence[str]) -> list[str]:
    """Options of a recording as the command line has them; those that are given already are left out."""
    table = {f"data.{key}": value for key, value in data.items() if key not in ("name", "for_system")}
    taken = {item.partition("=")[0] for item in given}
    told = [f"{key}={_written(value)}" for key, value in table.items() if key not in taken and value is not None]
    return [f"data={data['name']}", *told] if data else []


def _written(value: object) -> str:
    """A plain value in Hydra's grammar."""
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{key}: {_written(item)}" for key, item in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(_written(item) for item in value) + "]"
    if value is None or isinstance(value, bool):
        return "null" if value is None else str(value).lower()
    return quote(value) if isinstance(value, str) else repr(value)


def run(main: Callable[[], None], config_folder: Path, config_name: str, failures: list[BaseException]) -> None:
    """Check the command line, run Hydra's main, end with exit code 2 after a user's error.

    Args:
        main: function decorated by ``hydra.main``.
        config_folder, config_name: as given to ``hydra.main``.
        failures: errors that the task collected (in a sweep the others go on).
    """
    from .resume import resumed

    try:
        if not any(item in ("--help", "-h", "--hydra-help", "--version") for item in sys.argv[1:]):
            sys.argv[1:] = saved_friction(resumed(sys.argv[1:]))
            check_command_line(config_folder, config_name, sys.argv[1:])
            check_output(config_folder, config_name, sys.argv[1:])
        logging.raiseExceptions = False  # a log that cannot be written is no reason for a traceback
        main()
    except UserError as error:
        if full_error():
            raise
        fail(error)
        sys.exit(USER_ERROR)
    if failures or failed_jobs:
        sys.exit(USER_ERROR)
