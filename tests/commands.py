"""The project's commands in a folder and an environment of their own, without the seconds of imports that each takes.

``call`` asks a server, one per test process, that has loaded the packages; a command is a fork of it that goes on as
the interpreter does with a script, down to its exit. Tests that kill a command, and those of a user's first steps,
start an interpreter of their own.
"""

from __future__ import annotations

import atexit
import json
import os
import runpy
import selectors
import signal
import subprocess
import sys
import tempfile
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]


def call(
    script: str, *arguments: str, cwd: Path | None = None, timeout: float = 240.0, **variables: str
) -> subprocess.CompletedProcess[str]:
    """``python script arguments`` in a folder, with further variables of the environment; its exit code and output.

    Raises:
        subprocess.TimeoutExpired: it took longer than ``timeout`` seconds; it is killed.
    """
    command = [str(ROOT / script), *arguments]
    environment = {key: value for key, value in os.environ.items() if key != "HYDRA_FULL_ERROR"} | variables
    with tempfile.TemporaryDirectory() as folder:
        told = [Path(folder) / name for name in ("stdout", "stderr")]
        server = _server()
        job = {"argv": command, "cwd": str(cwd or Path.cwd()), "environment": environment, "told": [*map(str, told)]}
        server.stdin.write(json.dumps(job).encode() + b"\n")
        process = int(server.stdout.readline())
        with selectors.DefaultSelector() as ready:
            ready.register(server.stdout, selectors.EVENT_READ)
            late = not ready.select(timeout)
        if late:
            os.kill(process, signal.SIGKILL)
        code = int(server.stdout.readline())
        if late:
            raise subprocess.TimeoutExpired(command, timeout, told[0].read_text(), told[1].read_text())
        return subprocess.CompletedProcess(command, code, *(t.read_text() for t in told))


@cache
def _server() -> subprocess.Popen[bytes]:
    path = os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH", "")]))
    server = subprocess.Popen(
        [sys.executable, __file__],
        bufsize=0,  # a line read is no byte more, so that the next one can be waited for
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        env=os.environ | {"PYTHONPATH": path},
    )
    atexit.register(server.kill)
    return server


def _serve() -> dict | None:
    """Fork for every line; returns the job in the fork, None at the end."""
    for line in sys.stdin:
        process = os.fork()
        if not process:
            return json.loads(line)
        print(process, flush=True)
        print(os.waitstatus_to_exitcode(os.waitpid(process, 0)[1]), flush=True)
    return None


def _become(job: dict) -> None:
    for number, path in enumerate([os.devnull, *job["told"]]):
        opened = os.open(path, os.O_RDONLY if number == 0 else os.O_WRONLY | os.O_CREAT, 0o600)
        os.dup2(opened, number)
        os.close(opened)
    os.environ.clear()
    os.environ.update(job["environment"])
    os.chdir(job["cwd"])
    sys.argv = job["argv"]
    sys.path[0] = str(ROOT)
    runpy.run_path(sys.argv[0], run_name="__main__")


if __name__ == "__main__":
    import frictionpinn.reproduce.parts
    import frictionpinn.workflow.evaluate
    import frictionpinn.workflow.export
    import frictionpinn.workflow.train  # noqa: F401

    if (given := _serve()) is not None:
        _become(given)
