"""One call for every estimator: maximum likelihood, search methods, networks."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import lightning as L
import numpy as np
from omegaconf import OmegaConf

from ..data.contact import contact_trials
from ..data.module import TrajectoryData
from ..data.recording import Recording
from ..errors import UserError, choose, nearest
from ..evaluate.search_methods import METHODS, search
from ..identify.likelihood import maximum_likelihood
from ..identify.problem import Problem
from ..identify.result import CONVERGED, Estimate
from ..physics.base import contact_of, plain_name
from ..physics.mechanism import Mechanism
from ..progress import shorter
from .build import Config, at_one_rate, build_smoothing
from .configs import CONF, Configs
from .contact_options import options_of
from .experiment import build_model, frictional
from .load import trained_parameters
from .train import build_trainer, quiet

NETWORKS = ("pe1", "pe2")
ESTIMATORS = ("maximum_likelihood", *METHODS, *NETWORKS)


def estimate(
    method: str,
    mechanism: Mechanism,
    recording: Recording,
    *,
    start: Mapping[str, float] | str | Path | None = None,
    seed: int = 0,
    epochs: int | None = None,
    simulations: float = np.inf,
    **options: Any,
) -> Estimate:
    """Estimate the parameters of a mechanism's friction law from a recording.

    Args:
        method: one of ``ESTIMATORS``.
        mechanism: system and friction law.
        recording: what was measured, noise included, SI units.
        start: start values by name, SI units; the others come from the data. Or "pe1" or "pe2", a network that is
            trained on the recording first, or the folder of a training run: its parameters.
        seed: of the genetic algorithm and of the networks.
        epochs: of the networks' training; None: as configured.
        simulations: most simulations of the whole recording, for the search methods.
        options: of :class:`frictionpinn.identify.Problem` (bounds, fixed, sigmas, windows, loss ...).

    Raises:
        UserError: an unknown method or start; names, bounds or signals that do not fit.
    """
    choose(method, dict.fromkeys(ESTIMATORS), "estimator")
    if start in NETWORKS:
        start = network(str(start), mechanism, recording, None, seed, epochs, options).values
    elif start is not None:
        start = given_start(start, mechanism)
    if method in NETWORKS:
        return network(method, mechanism, recording, start, seed, epochs, options)
    problem = Problem(mechanism, recording, **options)
    noisy = "" if options.get("inputs") == "fixed" else ", noisy inputs estimated, too (else inputs=fixed)"
    shorter(f"{len(recording)} samples{noisy}; fewer samples (data.rate_hz) make it shorter")
    if method == "maximum_likelihood":
        return maximum_likelihood(problem, start=start)
    return search(method, problem, start=start, seed=seed, simulations=simulations)


def given_start(start: Mapping[str, Any] | str | Path, mechanism: Mechanism) -> dict[str, float]:
    """Start values by name, SI units, as they are given or from the folder of a training run.

    Raises:
        UserError: names or values that the law cannot have; no such run, or one without parameters of this law.
    """
    if isinstance(start, Mapping):
        mechanism.check_values(start, "start")
        return {name: float(value) for name, value in start.items()}
    if not isinstance(start, str | Path) or not Path(start).exists():
        raise UserError("no such start", where="start", received=repr(start),
                        allowed=f"{', '.join(NETWORKS)}, the folder of a training run, or values: {{mu_c: 0.3}}",
                        fix=nearest(start, NETWORKS))  # fmt: skip
    return trained_parameters(start, mechanism)


def default_config(overrides: list[str], name: str = "train") -> Config:
    """A configuration of conf/ (by default that of a training) with overrides, as plain values."""
    with Configs(CONF, name).opened() as configs:
        return OmegaConf.to_container(configs.compose(overrides), resolve=True)  # type: ignore[return-value]


def network(
    variant: str,
    mechanism: Mechanism,
    recording: Recording,
    start: Mapping[str, float] | None,
    seed: int,
    epochs: int | None,
    options: Mapping[str, Any],
) -> Estimate:
    """Train a PE on every trial of the recording; a network has no intervals of its own."""
    began = time.perf_counter()
    quiet()
    cfg = default_config([f"model={variant}", f"system={mechanism.system.name}", *options_of(mechanism.law)])
    cfg["trainer"] |= {"progress_bar": False} | ({"max_epochs": epochs} if epochs else {})
    for key, table in (("start", start), ("bounds", options.get("bounds")), ("fixed", options.get("fixed"))):
        cfg["friction"][key] = (cfg["friction"].get(key) or {}) | dict(table or {})
    L.seed_everything(seed, verbose=False)
    offline, online = build_smoothing(cfg["smoothing"])
    own = frictional(cfg, mechanism.system)
    recording = at_one_rate(recording)
    trials = contact_trials(recording, mechanism.system, offline, online, recording.names, own)
    data = TrajectoryData(recording, trials, {"train": recording.names, "validation": [], "held_out": []})
    model = build_model(cfg, mechanism.system, data)
    data.prepare_for(model)
    with tempfile.TemporaryDirectory() as folder:
        build_trainer(cfg, Path(folder), validation=False).fit(model, datamodule=data)
    values = model.physical()
    trained = {name: model.map_of(contact_of(name)).law_parameters.raw for name in values}  # type: ignore[union-attr]
    names = tuple(name for name, raw in trained.items() if plain_name(name) in raw)  # type: ignore[operator]
    nan = float("nan")
    advice = ("a network gives no intervals: start maximum likelihood from its values (refine=true)",)
    return Estimate(
        variant,
        names,
        {name: values[name] for name in names},
        {name: mechanism.read_in[name] for name in names},
        np.full((len(names), len(names)), nan),
        dict.fromkeys(names, (nan, nan)),
        CONVERGED,
        advice,
        nan,
        0,
        time.perf_counter() - began,
        {},
    )
