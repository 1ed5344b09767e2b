"""``resume=FOLDER`` on the command line: the options of a stopped run or sweep, and where it goes on."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from omegaconf import OmegaConf

from ..errors import UserError, nearest
from .configs import called, quote
from .manifest import MANIFEST, RESULT, check_command, read_manifest
from .options import parsed

_MANNER = ("hydra", "threads", "trainer.threads", "trainer.progress_bar", "trainer.max_epochs")


def resumed(arguments: Sequence[str], command: str) -> list[str]:
    """Replace ``resume=FOLDER`` by the options that the folder was started with.

    Args:
        command: that goes on, by its name.
        arguments: of the command line; others than resume= may say how to compute, not what.

    Returns:
        The arguments as they are where there is no resume= among them.

    Raises:
        UserError: no such folder, one of another command, nothing to go on with, further options that would make it
            another experiment.
    """
    given = parsed(arguments).overrides
    chosen = [item for item in given if item.startswith("resume=")]
    flags = [item for item in arguments if item not in given and item not in ("-m", "--multirun")]
    if not chosen:
        return list(arguments)
    folder = Path(chosen[-1].partition("=")[2].strip("'\"")).expanduser()
    others = [item for item in given if not item.startswith("resume=")]
    for item in others:
        if not item.startswith(_MANNER):
            raise UserError(
                "an option that would make it another experiment",
                where="command line",
                received=item,
                allowed=", ".join(f"{key}..." for key in _MANNER),
                fix="leave it out, or start a new run",
            )
    if not folder.is_dir():
        near = sorted(str(item) for item in folder.parent.glob("*") if item.is_dir())
        raise UserError(
            "no such folder", where="resume", received=str(folder), fix=nearest(folder, near) or "name a run's folder"
        )
    held = _command(folder)
    check_command(folder, held, command, "resume", f"say {called(held or command)} resume={folder}")
    if (folder / MANIFEST).exists():
        return [*flags, *_sweep(folder, others)]
    return [*flags, *_run(folder, others)]


def _command(folder: Path) -> str | None:
    """The command whose sweep or run a folder holds, the last one of several; None where that is not told."""
    if (folder / MANIFEST).exists():
        return read_manifest(folder)["command"]
    record = folder / ".hydra" / "hydra.yaml"
    return OmegaConf.select(OmegaConf.load(record), "hydra.job.name") if record.is_file() else None


def _sweep(folder: Path, others: list[str]) -> list[str]:
    manifest = read_manifest(folder)
    keys = {item.partition("=")[0] for item in others}
    kept = [item for item in (*manifest["launch"], *manifest["arguments"]) if item.partition("=")[0] not in keys]
    return ["-m", *kept, *others, f"hydra.sweep.dir={quote(folder)}"]


def _run(folder: Path, others: list[str]) -> list[str]:
    record = folder / ".hydra" / "overrides.yaml"
    if not record.is_file():
        inside = sorted(str(item.parent) for item in folder.glob(f"*/{MANIFEST}"))
        raise UserError(
            "neither a run nor a sweep",
            where="resume",
            received=str(folder),
            allowed="the folder of a training or of a sweep",
            fix=f"did you mean '{inside[-1]}'?" if inside else "give the folder that holds checkpoints/",
        )
    longer = any(item.startswith("trainer.max_epochs") for item in others)
    if (folder / RESULT).exists() and not longer:
        raise UserError(
            "the run has finished", where="resume", received=str(folder), fix=f"its result is {folder / RESULT}"
        )
    keys = {item.partition("=")[0] for item in others} | {"ckpt_path"}
    kept = [str(item) for item in OmegaConf.load(record) if str(item).partition("=")[0] not in keys]
    last = folder / "checkpoints" / "last.ckpt"
    if longer:  # a new run from the old one's end: what is finished stays as it is
        return [*kept, *others, f"ckpt_path={quote(last)}"]
    checkpoint = [f"ckpt_path={quote(last)}"] if last.is_file() else []
    return [*kept, *others, f"hydra.run.dir={quote(folder)}", *checkpoint]
