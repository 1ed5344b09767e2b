"""A sweep: which jobs are finished, which are to run; launching, and the summary at its end."""

from __future__ import annotations

import logging
import os
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from filelock import FileLock, Timeout
from omegaconf import DictConfig, OmegaConf, open_dict
from omegaconf.errors import OmegaConfBaseException

from ..errors import Interrupted, UserError, unwritable
from . import cli
from .configs import called, quote
from .manifest import (
    MANIFEST,
    STATUS,
    Job,
    check_command,
    digest,
    read_manifest,
    result_of,
    set_status,
    status_of,
    write_manifest,
)
from .swept import KINDS

log = logging.getLogger(__name__)
Compose = Callable[[list[str]], DictConfig]


class Sweep:
    """The jobs of one command line in one folder, some of them finished perhaps.

    Args:
        config: Hydra's configuration of the sweep.
        arguments: options of the command line, as written.
        swept: keys of the options that vary.
        combinations: options of each job.
        compose: options -> configuration with its ``hydra`` section.
    """

    def __init__(
        self,
        config: DictConfig,
        arguments: list[str],
        swept: list[str],
        combinations: list[list[str]],
        compose: Compose,
    ):
        self.folder = Path(str(config.hydra.sweep.dir)).absolute()
        self.told = os.path.relpath(self.folder)
        self.arguments = arguments
        skip = ("hydra.sweep.dir", "hydra.mode")
        self.launch = [item for item in config.hydra.overrides.hydra if item.partition("=")[0] not in skip]
        self.swept, self.combinations, self.compose = swept, combinations, compose
        self.command = str(OmegaConf.select(config, "hydra.job.name") or "train")
        self.kind = KINDS[self.command]
        # Jobs side by side would contend for the cores with a thread for each core.
        alone = str(OmegaConf.select(config, "hydra.launcher._target_")).endswith("BasicLauncher")
        threads = OmegaConf.select(config, self.kind.threads_key)
        self.manner = [] if alone or threads is not None else [f"{self.kind.threads_key}=1"]

    def run(self, launcher: Any, batch: int) -> list[Any]:
        """Run what is not finished; write the summary. Jobs that fail are reported, the others go on."""
        self.folder.mkdir(parents=True, exist_ok=True)
        try:
            with FileLock(self.folder / ".lock", timeout=0):
                return self._run(launcher, batch)
        except Timeout as error:
            raise UserError(
                "another process runs this sweep", where="hydra.sweep.dir", received=self.told, fix="wait for its end"
            ) from error
        except OSError as error:
            fix = f"make room or allow it, then {called(self.command)} resume={self.told}"
            raise unwritable(error, self.told, fix) from error
        except KeyboardInterrupt:
            raise Interrupted(f"stopped; go on with: {called(self.command)} resume={self.told}") from None

    def _run(self, launcher: Any, batch: int) -> list[Any]:
        jobs = self._plan()
        done = [job for job in jobs if result_of(self.folder / job.folder, job.digest)]
        todo = [job for job in jobs if job not in done]
        for job in todo:
            (self.folder / job.folder / STATUS).unlink(missing_ok=True)
        self._announce(jobs, done, todo)
        try:
            for first in range(0, len(todo), max(batch, 1)):
                self._launch(launcher, todo[first : first + max(batch, 1)])
        finally:
            if any(self._begun(job) for job in jobs):
                self.kind.summarise(self.folder, of_all_commands(read_manifest(self.folder)["jobs"]), self.told)
        failed = [job for job in jobs if not result_of(self.folder / job.folder)]
        cli.failed_jobs += len(failed)
        if failed:
            print(f"run the failed jobs again with: {called(self.command)} resume={self.told}", flush=True)
        return [result_of(self.folder / job.folder) for job in jobs]

    def _plan(self) -> list[Job]:
        """Jobs of this command in their order; known ones keep number and folder, whatever else was there before."""
        known: list[Job] = []
        if (self.folder / MANIFEST).exists():
            manifest = read_manifest(self.folder)
            check_command(self.told, manifest["command"], self.command, "hydra.sweep.dir", "sweep in another folder")
            known = manifest["jobs"]
        by_digest = {job.digest: job for job in known}
        number = 1 + max((job.number for job in known), default=-1)
        jobs: list[Job] = []
        for overrides in self.combinations:
            cfg = self.compose(overrides)
            plain = _plain(cfg)
            mark = digest(plain)
            values = dict(item.partition("=")[::2] for item in overrides)
            swept = {key.lstrip("+"): values[key] for key in self.swept}
            old = by_digest.get(mark)
            if old is None:
                job = Job(number, self._folder(cfg, number), mark, swept, overrides)
                number += 1
            else:
                job = Job(old.number, old.folder, mark, swept, overrides)
            if mark not in {other.digest for other in jobs}:
                jobs.append(job)
        rest = [job for job in known if job.digest not in {job.digest for job in jobs}]
        _check_folders([*rest, *jobs])
        every = sorted([*rest, *jobs], key=lambda job: job.number)
        write_manifest(self.folder, self.command, self.arguments, self.launch, every)
        return jobs

    def _folder(self, cfg: DictConfig, number: int) -> str:
        with open_dict(cfg):
            cfg.hydra.job.num, cfg.hydra.job.id = number, number
        return str(OmegaConf.select(cfg, "hydra.sweep.subdir"))

    def _announce(self, jobs: list[Job], done: list[Job], todo: list[Job]) -> None:
        print(f"sweep of {len(jobs)} jobs in {self.told}", flush=True)
        if done:
            print(f"finished before and skipped: {', '.join(job.folder for job in done)}", flush=True)
        half = [job.folder for job in todo if (self.folder / job.folder / "checkpoints" / "last.ckpt").exists()]
        if half:
            print(f"going on from their last checkpoint: {', '.join(half)}", flush=True)
        others = [job for job in read_manifest(self.folder)["jobs"] if job.folder not in {own.folder for own in jobs}]
        if left := [job.folder for job in others if not result_of(self.folder / job.folder)]:
            print(f"of earlier commands, and not gone on with: {', '.join(left)}; give these again", flush=True)

    def _launch(self, launcher: Any, jobs: list[Job]) -> None:
        """Launch jobs; those lost with a worker of the launcher itself are launched once more, each alone."""
        rest, alone = list(jobs), False
        while rest:
            groups = [[job] for job in rest] if alone else [rest]
            for group in groups:
                error = self._call(launcher, group)
            lost = [job for job in rest if not self._settled(job)]
            started = [job for job in lost if status_of(self.folder / job.folder)["state"] == "running"]
            if error is not None and len(lost) == len(rest) and not started:
                raise UserError(
                    "the launcher cannot launch",
                    where="hydra/launcher",
                    received=f"{type(error).__name__}: {error}",
                    fix="see the launchers in docs/guide/sweeps.md",
                ) from error
            if alone or (error is None and lost):
                for job in lost:
                    set_status(self.folder / job.folder, "failed", kind="died", error="the launcher's process died")
                return
            rest, alone = lost, True

    def _call(self, launcher: Any, jobs: list[Job]) -> Exception | None:
        overrides = [[*job.overrides, *self.manner, f"hydra.sweep.subdir={quote(job.folder)}"] for job in jobs]
        try:
            launcher.launch(overrides, initial_job_idx=jobs[0].number)
        except UserError:
            raise
        except Exception as error:  # a launcher may raise whatever its engine does
            log.warning("the launcher stopped: %s: %s", type(error).__name__, error)
            return error
        return None

    def _begun(self, job: Job) -> bool:
        folder = self.folder / job.folder
        return result_of(folder) is not None or status_of(folder)["state"] != "missing"

    def _settled(self, job: Job) -> bool:
        folder = self.folder / job.folder
        return result_of(folder) is not None or status_of(folder)["state"] == "failed"


def of_all_commands(jobs: Sequence[Job]) -> list[Job]:
    """Jobs of one folder, those of earlier commands too, each with every option that one of these varied: as its own
    command gave it, or "default"."""
    every, made = list(dict.fromkeys(key for job in jobs for key in job.swept)), []
    for job in jobs:
        given = dict(item.lstrip("+").partition("=")[::2] for item in job.overrides) | job.swept
        kept = [key for key in every if key in given or key != "seed"]  # which a result tells
        made.append(replace(job, swept={key: given.get(key, "default") for key in kept}))
    return made


def _plain(cfg: DictConfig) -> dict[str, Any]:
    own = OmegaConf.masked_copy(cfg, [str(key) for key in cfg if key != "hydra"])
    try:
        return OmegaConf.to_container(own, resolve=True, throw_on_missing=True)  # type: ignore[return-value]
    except OmegaConfBaseException as error:
        key = getattr(error, "full_key", None) or "a value"
        raise UserError("a value is missing in a job of the sweep", where=str(key), fix=f"add {key}=...") from error


def _check_folders(jobs: Sequence[Job]) -> None:
    names = [job.folder for job in jobs]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise UserError(
            "two jobs with one folder",
            where="hydra.sweep.subdir",
            received=twice,
            allowed="a name that differs by job",
            fix="put ${hydra.job.num} into it",
        )
