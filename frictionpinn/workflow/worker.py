"""The process in which jobs of a sweep run: told by lines on standard input, see :class:`.job.Worker`."""

from __future__ import annotations

import contextlib
import json
import logging
import os
import sys
import threading
import traceback
from pathlib import Path
from queue import SimpleQueue
from typing import Any

from filelock import FileLock, Timeout

from ..errors import UserError
from ..physics import extensions
from .manifest import RESULT, digest, result_of, set_status
from .swept import KINDS

LOCK_SECONDS = 30.0


def main() -> None:
    """Run every job that standard input names, until it closes."""
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # what libraries print must not be taken for an answer
    logging.raiseExceptions = False  # a log that cannot be written is no reason for a traceback
    jobs: SimpleQueue[str] = SimpleQueue()
    threading.Thread(target=_listen, args=(jobs,), daemon=True).start()
    while True:
        job = json.loads(jobs.get())
        with contextlib.suppress(OSError):  # not even its status can be written: who asked for the job says so
            settle(job["config"], Path(job["folder"]), job["command"])
        print("settled", file=answers, flush=True)


def _listen(jobs: SimpleQueue) -> None:
    for line in sys.stdin:
        jobs.put(line)
    os._exit(1)  # who asked for the jobs is gone: end in the middle, the next one goes on from the last checkpoint


def settle(cfg: dict[str, Any], folder: Path, command: str) -> None:
    """Run one job unless its result is there; whatever happens is in its folder afterwards."""
    folder.mkdir(parents=True, exist_ok=True)
    handler = logging.FileHandler(folder / f"{command}.log")
    handler.setFormatter(logging.Formatter("[%(asctime)s][%(levelname)s] %(message)s"))
    root = logging.getLogger()
    root.setLevel(logging.INFO)
    root.addHandler(handler)
    try:
        with FileLock(folder / ".lock", timeout=LOCK_SECONDS):
            _run(cfg, folder, command)
    except Timeout:
        text = "another process runs this job: wait for it, or end it"
        set_status(folder, "failed", kind="user", error=text)
    except UserError as error:
        logging.error(str(error))
        set_status(folder, "failed", kind="user", error=str(error))
    except Exception as error:
        logging.exception("unexpected error")
        last = traceback.extract_tb(error.__traceback__)[-1]
        text = f"{type(error).__name__}: {error} ({Path(last.filename).name}, line {last.lineno}; see {command}.log)"
        set_status(folder, "failed", kind="crash", error=" ".join(text.split()))
    finally:
        root.removeHandler(handler)
        handler.close()


def _run(cfg: dict[str, Any], folder: Path, command: str) -> None:
    if result_of(folder, digest(cfg)) is not None:
        return
    if (folder / RESULT).exists():
        raise UserError("a folder with another run's result", where=str(folder), fix="sweep in another folder")
    set_status(folder, "running", process=os.getpid())
    extensions.load(cfg.get("extensions") or ())
    KINDS[command].run(cfg, folder)
    (folder / "status.json").unlink(missing_ok=True)


if __name__ == "__main__":
    main()
