"""Engines that run the jobs of a sweep on many machines: Ray and Slurm.

Hydra's plugins for them wait for the jobs one after another and stop at the first that is lost, while the others still
run; these wait for each.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from hydra.core.hydra_config import HydraConfig
from hydra.core.utils import JobReturn, JobStatus, _save_config, setup_globals
from omegaconf import DictConfig, OmegaConf, open_dict

from ..errors import UserError, choose
from .configs import with_extensions
from .job import Outcome, settled

Task = tuple[dict[str, Any], str, str]
Engine = Callable[[Mapping[str, Any], Sequence[Task]], Iterator[tuple[int, Outcome | BaseException]]]
ROOT = Path(__file__).resolve().parents[2]


def launch(
    engine: str,
    options: Mapping[str, Any],
    hydra_context: Any,
    config: DictConfig,
    job_overrides: Sequence[Sequence[str]],
    initial_job_idx: int,
) -> list[JobReturn]:
    """Run jobs on an engine; tell of each when it is settled.

    Returns:
        What Hydra expects of a launcher; ``return_value`` is its score, or the exception of a job that was lost.
    """
    setup_globals()
    tasks, returns = [], []
    for number, overrides in enumerate(job_overrides, initial_job_idx):
        cfg = hydra_context.config_loader.load_sweep_config(config, list(overrides))
        task, told = _prepare(cfg, number, list(overrides))
        tasks.append(task)
        returns.append(told)
    here = os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH", "")]))
    os.environ["PYTHONPATH"] = here  # workers import the package from where this process has it
    run = choose(engine, ENGINES, "hydra/launcher")
    for k, outcome in run({key: _plain(value) for key, value in options.items()}, tasks):
        if isinstance(outcome, BaseException):
            returns[k].return_value, returns[k].status = outcome, JobStatus.FAILED
        else:
            outcome.tell()
            returns[k].return_value, returns[k].status = outcome.score, JobStatus.COMPLETED
    return returns


def _plain(value: Any) -> Any:
    return OmegaConf.to_container(value, resolve=True) if OmegaConf.is_config(value) else value


def _prepare(cfg: DictConfig, number: int, overrides: list[str]) -> tuple[Task, JobReturn]:
    """Configuration and folder of a job; Hydra's record of them in the folder."""
    with open_dict(cfg):
        cfg.hydra.job.num, cfg.hydra.job.id = number, f"{cfg.hydra.job.name}_{number}"
    HydraConfig.instance().set_config(cfg)
    folder = Path(str(cfg.hydra.sweep.dir), str(cfg.hydra.sweep.subdir)).absolute()
    own = OmegaConf.masked_copy(cfg, [str(key) for key in cfg if key != "hydra"])
    record = folder / str(cfg.hydra.output_subdir)
    _save_config(own, "config.yaml", record)
    _save_config(cfg.hydra.overrides.task, "overrides.yaml", record)
    plain: dict[str, Any] = OmegaConf.to_container(own, resolve=True)  # type: ignore[assignment]
    return (with_extensions(plain), str(folder), str(cfg.hydra.job.name)), JobReturn(
        overrides=overrides, cfg=own, task_name=str(cfg.hydra.job.name)
    )


def on_ray(options: Mapping[str, Any], tasks: Sequence[Task]) -> Iterator[tuple[int, Outcome | BaseException]]:
    """Ray: ``init`` are options of ``ray.init``, ``remote`` those of the task of each job."""
    import ray

    if not ray.is_initialized():
        environment = {"env_vars": {"PYTHONPATH": os.environ["PYTHONPATH"]}}
        told = {key: value for key, value in options["init"].items() if value is not None}
        ray.init(**{"runtime_env": environment, "logging_level": "ERROR", **told})
    # A job that is lost is reported, not tried again behind the user's back.
    task = ray.remote(**{"max_retries": 0, **options["remote"]})(settled)
    waiting = {task.remote(*own): k for k, own in enumerate(tasks)}
    try:
        while waiting:
            (ready,), _ = ray.wait(list(waiting), num_returns=1)
            outcome: Outcome | BaseException
            try:
                outcome = ray.get(ready)
            except Exception as error:  # a worker or a node died
                outcome = error
            yield waiting.pop(ready), outcome
    finally:
        ray.shutdown()


def on_slurm(options: Mapping[str, Any], tasks: Sequence[Task]) -> Iterator[tuple[int, Outcome | BaseException]]:
    """Slurm by submitit: ``cluster`` (slurm or local), ``folder`` of its logs, ``parameters`` of its executor."""
    import submitit

    cluster = options["cluster"]
    if cluster == "slurm" and shutil.which("sbatch") is None:
        raise UserError(
            "no Slurm here",
            where="hydra/launcher",
            received="slurm, and no command sbatch",
            allowed="a machine that submits to Slurm",
            fix="hydra.launcher.cluster=local runs the same on this machine",
        )
    executor = submitit.AutoExecutor(folder=Path(options["folder"]).absolute() / "%j", cluster=cluster)
    executor.update_parameters(**{key: value for key, value in options["parameters"].items() if value is not None})
    jobs = executor.map_array(settled, *map(list, zip(*tasks, strict=True)))
    waiting = dict(enumerate(jobs))
    while waiting:
        for k, job in list(waiting.items()):
            if job.done() or (cluster == "slurm" and _left_the_queue(str(job.job_id))):
                del waiting[k]
                yield k, _result(job)
        time.sleep(0.2 if cluster == "local" else 5.0)


def _result(job: Any) -> Outcome | BaseException:
    try:
        if not job.paths.result_pickle.exists():
            time.sleep(1.0)  # a shared disk may show it late
        if not job.paths.result_pickle.exists():
            raise RuntimeError(f"job {job.job_id} ended without a result; see {job.paths.stderr}")
        return job.result()
    except Exception as error:  # cancelled, out of time or memory, a node that died
        return error


def _left_the_queue(job_id: str) -> bool:
    """Whether Slurm neither runs nor queues a job. submitit asks sacct, which never answers without accounting."""
    told = subprocess.run(["squeue", "-h", "-j", job_id], capture_output=True, text=True, check=False)
    gone = "Invalid job id" in told.stderr
    return gone or (told.returncode == 0 and not told.stdout.strip())


ENGINES: dict[str, Engine] = {"ray": on_ray, "slurm": on_slurm}
