"""Launchers: the same sweep through each of them, with one job killed by SIGKILL."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import tempfile
from importlib.util import find_spec
from pathlib import Path

import pytest
from sweeping import LONG, running, start, wait_for

from frictionpinn.errors import UserError
from frictionpinn.workflow import cli, options
from frictionpinn.workflow.launchers import _left_the_queue

CONF = Path(__file__).resolve().parents[2] / "conf"
PACKAGES = {"joblib": "hydra_plugins.hydra_joblib_launcher", "slurm": "submitit", "ray": "ray"}
PRESETS = {
    "joblib": ["hydra/launcher=joblib", "hydra.launcher.n_jobs=2"],
    "slurm": ["hydra/launcher=slurm", "hydra.launcher.cluster=local"],
    "ray": ["hydra/launcher=ray", "hydra.launcher.init.num_cpus=2"],
}


def needs(launcher: str) -> None:
    if find_spec(PACKAGES[launcher]) is None:
        pytest.skip(f'{PACKAGES[launcher]} is not installed: pip install -e ".[{launcher}]"')


def kill_one_job(folder: Path, *options: str) -> tuple[int, str, str]:
    """A sweep of three jobs, one bad, one killed in the middle, one good; exit code and what it said."""
    arguments = ["-m", "trainer.log_every_n_steps=0,26,25", "model=bb1", *LONG, "hydra.sweep.dir=s", *options]
    process = start(folder, *arguments)
    job = folder / "s" / "1_pob_bb1_seed0"
    wait_for(lambda: running(job), process)
    os.kill(running(job), signal.SIGKILL)
    out, err = process.communicate(timeout=300)
    return process.returncode, out, err


@pytest.mark.parametrize("launcher", PRESETS)
def test_jobs_that_raise_or_die_cost_themselves_alone(launcher, tmp_path):
    needs(launcher)
    code, out, err = kill_one_job(tmp_path, *PRESETS[launcher])
    assert code == 2
    errors = [line for line in err.splitlines() if line.startswith("error: ")]
    assert len(errors) == 2, err
    assert sum("its process died: SIGKILL" in line for line in errors) == 1
    assert sum("impossible interval" in line for line in errors) == 1
    done = sorted(path.parent.name for path in tmp_path.glob("s/*/result.json"))
    assert done == ["2_pob_bb1_seed0"], out
    assert "1 of 3 jobs finished" in out and "python train.py resume=s" in out
    assert (tmp_path / "s" / done[0] / ".hydra" / "overrides.yaml").is_file()


def test_a_launcher_that_there_is_not_is_named():
    with pytest.raises(UserError, match=r"unknown launcher: hydra/launcher is joblip; .*did you mean 'joblib'"):
        cli.check_command_line(CONF, "train", ["-m", "hydra/launcher=joblip"])


def test_a_launcher_whose_package_is_missing_says_what_to_install(monkeypatch):
    monkeypatch.setattr(options, "find_spec", lambda name: None)
    with pytest.raises(UserError, match=r"submitit is not installed: hydra/launcher is slurm; pip install .*\[slurm\]"):
        cli.check_command_line(CONF, "train", ["-m", "hydra/launcher=slurm"])


def test_slurm_without_slurm_is_one_line(tmp_path, command):
    needs("slurm")
    process = command(tmp_path, "-m", "seed=0,1", *LONG, "hydra/launcher=slurm", PATH="/usr/bin:/bin")
    assert process.returncode == 2
    assert "error: no Slurm here: hydra/launcher is slurm, and no command sbatch" in process.stderr
    assert "summary" not in process.stdout


@pytest.mark.parametrize(
    ("script", "gone"),
    [
        ("echo '7 debug R 0:01'", False),
        ("true", True),
        ("echo 'slurm_load_jobs error: Invalid job id' >&2; exit 1", True),
        ("echo 'Unable to contact slurm controller' >&2; exit 1", False),
    ],
)
def test_a_job_that_left_slurms_queue_is_noticed_without_accounting(tmp_path, monkeypatch, script, gone):
    (tmp_path / "squeue").write_text(f"#!/bin/sh\n{script}\n")
    (tmp_path / "squeue").chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}:{os.environ['PATH']}")
    assert _left_the_queue("7") is gone


# ---- a cluster of two nodes on this host


@pytest.fixture
def cluster():
    """Address of a Ray cluster of two nodes with a core each."""
    needs("ray")
    ray = [str(Path(sys.executable).with_name("ray"))]
    port = 20000 + os.getpid() % 10000
    address = f"127.0.0.1:{port}"
    short = tempfile.mkdtemp(prefix="ray")  # its sockets lie there, whose paths may not be long
    environment = {**os.environ, "RAY_AUTH_MODE": "disabled", "RAY_TMPDIR": short}
    common = ["--num-cpus=1", "--disable-usage-stats", "--object-store-memory=80000000"]
    head = [*ray, "start", "--head", f"--port={port}", "--include-dashboard=false", *common]
    nodes = []
    try:
        for command in (head, [*ray, "start", f"--address={address}", *common]):
            nodes.append(
                subprocess.Popen(
                    [*command, "--block"], env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
                )
            )
            _reachable(port)
        yield address
    finally:
        for node in reversed(nodes):
            node.send_signal(signal.SIGTERM)
        for node in nodes:
            node.wait(timeout=30)
        shutil.rmtree(short, ignore_errors=True)


def _reachable(port: int) -> None:
    import socket
    import time

    end = time.monotonic() + 60
    while time.monotonic() < end:
        with socket.socket() as probe:
            if probe.connect_ex(("127.0.0.1", port)) == 0:
                return
        time.sleep(0.2)
    raise AssertionError("the cluster did not start")


def test_a_cluster_of_two_nodes_loses_only_the_job_that_is_killed(cluster, tmp_path):
    options = ["hydra/launcher=ray", f"hydra.launcher.init.address={cluster}"]
    code, out, err = kill_one_job(tmp_path, *options)
    assert code == 2 and "its process died: SIGKILL" in err, err
    assert "1 of 3 jobs finished" in out
