"""What a sweep consists of and what became of each job: ``manifest.json`` of the sweep, ``status.json`` of a job."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from ..errors import UserError

MANIFEST, STATUS, RESULT = "manifest.json", "status.json", "result.json"
# Options that say how to compute, not what: a job that differs in these alone is the same job.
_MANNER = {"trainer": ("threads", "progress_bar")}


@dataclass(frozen=True)
class Job:
    """One job of a sweep.

    Attributes:
        number: counts from 0, in the order of the sweep.
        folder: its name inside the sweep's folder.
        digest: of its configuration (:func:`digest`).
        swept: key -> value of the options that the sweep varies, as text.
        overrides: all options of the command line, this job's values.
    """

    number: int
    folder: str
    digest: str
    swept: dict[str, str]
    overrides: list[str]

    @property
    def label(self) -> str:
        """Its varied options in words."""
        return " ".join(f"{key}={value}" for key, value in self.swept.items()) or self.folder


def digest(cfg: Mapping[str, Any]) -> str:
    """Fingerprint of a resolved configuration: equal where two jobs compute the same."""
    plain = {key: value for key, value in cfg.items() if key not in ("ckpt_path", "extensions", "threads")}
    for group, keys in _MANNER.items():
        plain[group] = {key: value for key, value in (plain.get(group) or {}).items() if key not in keys}
    text = json.dumps(json.loads(json.dumps(plain, default=str)), sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()


@contextmanager
def whole(path: Path) -> Iterator[Path]:
    """A file to write beside ``path``, whose place it takes once all is written: a kill or a full disk leaves the last
    one."""
    temporary = path.with_name(f".{os.getpid()}.{path.name}")
    try:
        yield temporary
        with temporary.open("rb+") as file:
            os.fsync(file.fileno())
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)


def write_text(path: Path, text: str) -> None:
    """Write whole or not at all."""
    with whole(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def write_json(path: Path, content: Mapping[str, Any]) -> None:
    """Write whole or not at all."""
    write_text(path, json.dumps(content, indent=2, allow_nan=True) + "\n")


def read_json(path: Path) -> dict[str, Any] | None:
    """Content of a file, None where it is missing or damaged."""
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    return content if isinstance(content, dict) else None


def result_of(folder: Path, expected: str | None = None) -> dict[str, Any] | None:
    """Result of a finished job, None where it has not finished or computed something else than ``expected``."""
    result = read_json(folder / RESULT)
    if result is None or not isinstance(result.get("config"), dict):
        return None
    return result if expected in (None, digest(result["config"])) else None


def status_of(folder: Path) -> dict[str, Any]:
    """``state`` (missing, running or failed) of a job without a result, with ``error`` where it failed."""
    return read_json(folder / STATUS) or {"state": "missing"}


def set_status(folder: Path, state: str, **more: Any) -> None:
    """Record the state of a job."""
    write_json(folder / STATUS, {"state": state, **more})


def check_free(folder: Path, ckpt_path: str | None) -> bool:
    """Raise :class:`UserError` for a folder that another run has used; return whether ``ckpt_path`` is of this one."""
    own = folder / "checkpoints"
    if (folder / RESULT).exists():
        raise UserError(
            "the folder holds a finished run", where="hydra.run.dir", received=str(folder), fix="choose another folder"
        )
    same = ckpt_path is not None and Path(ckpt_path).resolve().parent == own.resolve()
    if (own / "last.ckpt").exists() and not same:
        raise UserError(
            "the folder holds a run that was stopped",
            where="hydra.run.dir",
            received=str(folder),
            fix=f"go on with resume={folder}, or choose another folder",
        )
    return same


def read_manifest(folder: Path) -> dict[str, Any]:
    """The manifest of a sweep's folder; its ``command`` is None where an earlier version wrote it.

    Raises:
        UserError: there is none, or it is damaged.
    """
    manifest = read_json(folder / MANIFEST)
    try:
        assert manifest is not None
        jobs = [Job(**job) for job in manifest["jobs"]]
        given = {key: list(manifest[key]) for key in ("arguments", "launch")}
        return {"command": manifest.get("command"), **given, "jobs": jobs}
    except (AssertionError, KeyError, TypeError) as error:
        missing = not (folder / MANIFEST).exists()
        raise UserError(
            "not a sweep" if missing else "damaged manifest",
            where="resume",
            received=str(folder),
            allowed=f"a folder with a {MANIFEST}, which a sweep writes",
            fix="" if missing else "start the sweep anew in another folder",
        ) from error


def write_manifest(folder: Path, command: str, arguments: list[str], launch: list[str], jobs: list[Job]) -> None:
    """Record what the sweep consists of, before it starts."""
    told = {"command": command, "arguments": arguments, "launch": launch, "jobs": [asdict(job) for job in jobs]}
    write_json(folder / MANIFEST, told)


def check_command(folder: str | Path, held: str | None, command: str, where: str, fix: str) -> None:
    """Raise :class:`UserError` where a folder holds the run or sweep of another command, by their names."""
    if held not in (None, command):
        raise UserError("a folder of another command", where=where, received=f"{folder}, of {held}",
                        allowed=f"one of {command}", fix=fix)  # fmt: skip
