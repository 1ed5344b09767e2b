"""The command line: errors in one line, before Hydra would print a traceback; Ctrl-C ends with one, too."""

from __future__ import annotations

import logging
import os
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path

from .. import __version__
from ..errors import Interrupted, UserError, unwritable
from .configs import CONF, Configs, written
from .contact_options import contact_options
from .options import check_command_line, output_folder, parsed, with_files

USER_ERROR, INTERRUPTED = 2, 130
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


def saved_friction(arguments: list[str]) -> list[str]:
    """The arguments with ``friction=<file of a diagnosis>`` as its law, its system and the file's effects.

    Raises:
        UserError: no such file, or not one of these; a system beside it that is another.
    """
    given = [a for a in arguments if a.startswith("friction=") and a.endswith((".yaml", ".yml"))]
    if not given:
        return arguments
    from ..export.augmented import data_of, load_augmented

    path = Path(given[0].partition("=")[2]).resolve()
    mechanism, _ = load_augmented(path)
    name = mechanism.system.name
    for other in (a for a in arguments if a.startswith("system=") and a != f"system={name}"):
        raise UserError("friction model of another system", where="friction", received=f"{path.name} with {other}",
                        allowed=f"system={name}", fix=f"say system={name}")  # fmt: skip
    rest = [a for a in arguments if a != given[0] and not a.startswith("system=")]
    own = [] if any(a.startswith("data=") for a in arguments) else _recording(data_of(path), rest)
    return [*rest, *own, f"system={name}", f"friction={mechanism.contacts[0].law.name}", f"+system.augmented='{path}'"]


def _recording(data: Mapping[str, object], given: Sequence[str]) -> list[str]:
    """Options of a recording as the command line has them; those that are given already are left out."""
    table = {f"data.{key}": value for key, value in data.items() if key not in ("name", "for_system")}
    taken = {item.partition("=")[0] for item in given}
    told = [f"{key}={written(value)}" for key, value in table.items() if key not in taken and value is not None]
    return [f"data={data['name']}", *told] if data else []


def run(main: Callable[[], None], name: str, failures: list[BaseException]) -> None:
    """Check the command line, run Hydra's main, end with exit code 2 after a user's error.

    Args:
        main: function decorated by ``hydra.main``.
        name: of the command and of its configuration.
        failures: errors that the task collected (in a sweep the others go on).
    """
    from .resume import resumed

    try:
        if {"--help", "-h"} & set(sys.argv[1:]):
            from .usage import usage

            print(usage(Configs(CONF, name)))
            return
        if "--version" in sys.argv[1:]:
            print(f"frictionpinn {__version__}")
            return
        asked = parsed(sys.argv[1:])
        if not (asked.hydra_help or asked.shell_completion or asked.info):
            arguments = with_files(contact_options(saved_friction(resumed(sys.argv[1:], name))))
            check_command_line(CONF, name, arguments)
            given = parsed(arguments).overrides  # Hydra wants its flags together
            sys.argv[1:] = [
                *given,
                *(item for item in arguments if item not in given),
            ]
            if not asked.cfg:
                output_folder(CONF, name, arguments)
        logging.raiseExceptions = False  # a log that cannot be written is no reason for a traceback
        main()
    except UserError as error:
        if full_error():
            raise
        fail(error)
        sys.exit(USER_ERROR)
    except (KeyboardInterrupt, Interrupted) as stop:
        kept = "the same command goes on where it stopped" if name == "reproduce" else "nothing was kept"
        print(f"\n{str(stop) or f'stopped; {kept}'}", flush=True)
        sys.exit(INTERRUPTED)
    if failures or failed_jobs:
        sys.exit(USER_ERROR)
