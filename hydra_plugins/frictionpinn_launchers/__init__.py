"""Hydra finds its plugins under this name; the launchers themselves are :mod:`frictionpinn.workflow.launchers`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from hydra.core.utils import JobReturn
from hydra.plugins.launcher import Launcher


class EngineLauncher(Launcher):
    """Hands jobs to an engine of :mod:`frictionpinn.workflow.launchers`; a job that is lost there is lost alone.

    The configuration of each job is resolved here, so that nothing depends on the environment of a worker.
    """

    engine = ""

    def __init__(self, **options: Any) -> None:
        self.options = options

    def setup(self, *, hydra_context, task_function, config) -> None:
        self.config, self.hydra_context = config, hydra_context

    def launch(self, job_overrides: Sequence[Sequence[str]], initial_job_idx: int) -> Sequence[JobReturn]:
        from frictionpinn.workflow.launchers import launch

        return launch(self.engine, self.options, self.hydra_context, self.config, job_overrides, initial_job_idx)


class RayLauncher(EngineLauncher):
    """Ray, on this machine or on an existing cluster."""

    engine = "ray"


class SlurmLauncher(EngineLauncher):
    """Slurm by submitit; ``cluster: local`` runs the same on this machine."""

    engine = "slurm"
