"""One job of a sweep, a training or a diagnosis, in a process of its own: its death costs that job alone, whatever the
launcher."""

from __future__ import annotations

import atexit
import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from statistics import fmean
from typing import IO, Any

from ..progress import SHORT, in_words
from .manifest import MANIFEST, read_json, result_of, set_status, status_of
from .swept import KINDS
from .threads import THREADS

UNWRITTEN = "nothing can be written to its folder; is the disk full?"


class Worker:
    """A child process that runs one job after another; the next job after its death gets a new one.

    It is told of a job in a line of JSON on its standard input and answers with a line when the job is settled. When
    this process dies, however, the pipe closes and the child ends at once: nothing goes on behind a dead sweep.
    """

    def __init__(self, environment: dict[str, str]):
        root = str(Path(__file__).resolve().parents[2])
        path = os.pathsep.join(filter(None, [root, os.environ.get("PYTHONPATH", "")]))
        self.environment = environment
        self.process = subprocess.Popen(
            [sys.executable, "-m", "frictionpinn.workflow.worker"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            env={**os.environ, **environment, "PYTHONPATH": path},
            start_new_session=True,  # Ctrl-C reaches the sweep, which then ends its jobs
        )
        atexit.register(self.stop)

    def run(self, cfg: dict[str, Any], folder: Path, command: str) -> int | None:
        """Run a job; None when it is settled, else the exit code of the process that died."""
        pipe: IO[str] = self.process.stdin  # type: ignore[assignment]
        try:
            pipe.write(json.dumps({"config": cfg, "folder": str(folder), "command": command}, default=str) + "\n")
            pipe.flush()
            if self.process.stdout.readline():  # type: ignore[union-attr]
                return None
        except BrokenPipeError:
            pass
        return self.process.wait()

    def stop(self) -> None:
        """End the child."""
        atexit.unregister(self.stop)
        if self.process.poll() is None:
            self.process.kill()
            self.process.wait()


_worker: Worker | None = None
_spent: dict[Path, list[float]] = {}  # s, by the folder of a sweep: on its jobs that this process has seen finished


def _worker_for(environment: dict[str, str]) -> Worker:
    global _worker
    if _worker is not None and (_worker.process.poll() is not None or _worker.environment != environment):
        _worker.stop()
        _worker = None
    _worker = _worker or Worker(environment)
    return _worker


def in_sweep(folder: Path) -> bool:
    """Whether a folder is that of a job of a sweep with a manifest."""
    return (folder.parent / MANIFEST).is_file()


@dataclass(frozen=True)
class Outcome:
    """How a job ended: its score (the error on held-out trials), None where it failed, and a line for people."""

    score: float | None
    line: str

    def tell(self) -> None:
        """Print the line."""
        if self.score is None:
            print(f"error: {self.line}", file=sys.stderr, flush=True)
        else:
            print(self.line, flush=True)


def run_job(cfg: dict[str, Any], folder: Path, command: str) -> float | None:
    """Run one job in a process of its own, say in one line how it ended, and return its score."""
    outcome = settled(cfg, folder, command)
    outcome.tell()
    return outcome.score


def settled(cfg: dict[str, Any], folder: str | Path, command: str) -> Outcome:
    """Run one job in a process of its own; what became of it is in its folder."""
    begin, folder, kind = time.perf_counter(), Path(folder), KINDS[command]
    threads = kind.threads(cfg)
    environment = dict.fromkeys(THREADS, str(threads)) if threads else {}
    code = _worker_for(environment).run(cfg, folder, command)
    result, status = result_of(folder), status_of(folder)
    if code is not None and result is None:
        status = {"state": "failed", "kind": "died", "error": f"its process died: {ending(code)}"}
        set_status(folder, **status)
    label = describe(folder)
    if result is None:
        return Outcome(None, f"{label}: {status.get('error', UNWRITTEN)}")
    spent = time.perf_counter() - begin
    _spent.setdefault(folder.parent, []).append(spent)
    return Outcome(kind.score(result), f"{label}: {kind.line(result)}, {spent:.1f} s{_left(folder)}")


def _left(folder: Path) -> str:
    """How long the sweep may still take where jobs take as long as those so far on average, as many side by side."""
    jobs = [folder.parent / job["folder"] for job in (read_json(folder.parent / MANIFEST) or {}).get("jobs", [])]
    states = [status_of(job)["state"] for job in jobs if result_of(job) is None]
    rest = fmean(_spent[folder.parent]) * (len(states) - states.count("failed")) / (1 + states.count("running"))
    return f", about {in_words(rest)} left" if rest > SHORT else ""


def ending(code: int) -> str:
    """How a process ended, in words."""
    if code >= 0:
        return f"exit code {code}"
    try:
        return signal.Signals(-code).name + (" (out of memory?)" if -code == signal.SIGKILL else "")
    except ValueError:
        return f"signal {-code}"


def describe(folder: Path) -> str:
    """Number of a job of its sweep, and its varied options."""
    jobs = (read_json(folder.parent / MANIFEST) or {}).get("jobs", [])
    for job in jobs:
        if job["folder"] == folder.name:
            options = " ".join(f"{key}={value}" for key, value in job["swept"].items())
            return f"[{job['number'] + 1}/{len(jobs)}] {options}".rstrip()
    return folder.name
