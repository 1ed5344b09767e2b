"""What all variants share: features, network, loss of the equation of motion, optimizer, prediction of a trial."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import lightning as L
import numpy as np
import torch
from torch import Tensor, nn
from torch.func import jvp

from ..data.contact import ContactTrial
from ..errors import UserError, choose
from .features import Features
from .network import FrictionNetwork
from .optimizers import build_optimizer

Batch = Mapping[str, Tensor]


def tensors(trial: ContactTrial, features: Features, source: str = "online") -> dict[str, np.ndarray]:
    """Arrays of one trial for a model: x, x_rate (n, d); v, N, v_rate, N_rate, target (n, 1).

    Args:
        source: where v and N in the law come from: ``offline`` when training, ``online`` when predicting.
    """
    physics = getattr(trial, source)
    normal = np.abs(trial.online["normal_force"])
    seen = {**trial.online, "normal_force": normal}
    rates = {**trial.rates, "normal_force": trial.rates["normal_force"] * np.sign(trial.online["normal_force"])}
    load = np.abs(physics["normal_force"])
    load_rate = rates["normal_force"] if source == "online" else np.gradient(load, trial.t)
    columns = {
        "v": physics["v_slip"],
        "N": load,
        "v_rate": physics["a_slip"],
        "N_rate": load_rate,
        "target": trial.offline["friction_force"],
    }
    arrays = {"x": features(trial.t, seen), "x_rate": features(trial.t, rates)}
    arrays |= {name: np.asarray(values)[:, None] for name, values in columns.items()}
    return {name: np.ascontiguousarray(values, dtype=np.float32) for name, values in arrays.items()}


class FrictionModel(L.LightningModule):
    """Base of the variants: subclasses give :meth:`respond`, what the network's output means.

    Args:
        name: bb1, bb2, pe1 or pe2.
        inputs, windows: see :class:`Features`.
        network: width, depth, activation, odd.
        loss: ``force``: normalised (mean square over the target's variance) or plain (N^2); for PE also
            ``consistency`` (relative or plain) and ``weight`` (lambda).
        optimizer: see :func:`build_optimizer`.
        scales: see :func:`frictionpinn.models.start.data_scales`.
        context: plain values kept with the checkpoint (system, units).
    """

    def __init__(
        self,
        name: str,
        inputs: list[str],
        windows: dict[str, list],
        network: dict[str, Any],
        loss: dict[str, Any],
        optimizer: dict[str, Any],
        scales: dict[str, float],
        context: dict[str, Any] | None = None,
        **extra: Any,
    ):
        super().__init__()
        self.save_hyperparameters(logger=False)  # for checkpoints; TensorBoard gets those of the experiment
        self.features = Features.from_config(inputs, windows)
        self.network = FrictionNetwork(torch.as_tensor(self.features.odd), **network)
        check_loss(loss)
        self.loss, self.scales, self.optimizer_config = dict(loss), dict(scales), dict(optimizer)
        self.parts: dict[str, Tensor] = {}

    own: tuple[str, ...] = (
        "law_parameters.",
    )  # names of logarithms of physical quantities, with a step size of theirs
    sees_rates = False  # whether the prediction needs the rates of the signals

    @property
    def contacts(self) -> tuple[str, ...]:
        """Names of the contacts with friction; one without a name where the system has no other."""
        return ("",)

    def map_of(self, contact: str) -> FrictionModel:
        """The model of one contact."""
        return self

    def arrays(self, trial: ContactTrial, source: str = "online") -> dict[str, np.ndarray]:
        """What the model is given of one trial, see :func:`tensors`."""
        return tensors(trial, self.features, source)

    # physics of the variant ----------------------------------------------------------------------------------
    def outputs(self, batch: Batch) -> tuple[Tensor, ...]:
        """The network's output u, shape (n, 1), and where rates are seen u' along the trajectory (forward mode)."""
        if not self.sees_rates:
            return (self.network(batch["x"]),)
        return jvp(self.network, (batch["x"],), (batch["x_rate"],))[:2]

    def respond(self, batch: Batch, *outputs: Tensor) -> dict[str, Tensor]:
        """Return ``force`` (n, 1), N, and for PE ``z``, ``z_rate`` and ``residual`` (z' of network less law, m/s)."""
        raise NotImplementedError

    def predict(self, batch: Batch) -> dict[str, Tensor]:
        """What the variant says of a batch: see :meth:`respond`."""
        return self.respond(batch, *self.outputs(batch))

    def physical(self) -> dict[str, float]:
        """Current values of the physical parameters, SI units; none for a black box."""
        return {}

    # training ------------------------------------------------------------------------------------------------
    def losses(self, batch: Batch, outputs: tuple[Tensor, ...] | None = None) -> dict[str, Tensor]:
        """Terms of the loss; ``loss`` is their sum. ``outputs`` of the network, where they are known already."""
        predicted = self.respond(batch, *(self.outputs(batch) if outputs is None else outputs))
        force = (predicted["force"] - batch["target"]).square().mean()
        if self.loss["force"] == "normalised":
            force = force / self.scales["force"] ** 2
        parts = {"force": force} | self.beside(batch, predicted)
        parts["loss"] = sum(parts.values(), start=torch.zeros((), device=force.device))
        return parts

    def beside(self, batch: Batch, predicted: Mapping[str, Tensor]) -> dict[str, Tensor]:
        """Terms of the loss beside that of the force: of a PE that of its bristle."""
        return {"consistency": self.consistency(predicted["residual"], batch["v"])} if "residual" in predicted else {}

    def consistency(self, residual: Tensor, v: Tensor) -> Tensor:
        """lambda times the mean square of z' of network less law, m/s, or of it over the slip velocity v."""
        if self.loss["consistency"] == "relative":
            floor = float(self.loss.get("floor", 1.0)) * self.scales["velocity_noise"]
            residual = residual / (v.abs() + floor)
        return float(self.loss["weight"]) * residual.square().mean()

    def training_step(self, batch: Batch, batch_idx: int) -> Tensor:
        parts = self.losses(batch)
        self.parts = {name: value.detach() for name, value in parts.items()}
        if self._logs_now():
            self.log("loss/training", self.parts["loss"], on_step=False, on_epoch=True, batch_size=samples(batch))
        return parts["loss"]

    def _logs_now(self) -> bool:
        """Lightning's ``log`` is as dear as a small step: used only where a checkpoint or a schedule reads the loss."""
        trainer = self._trainer
        if trainer is None:
            return False
        every = trainer.check_val_every_n_epoch or 1
        plateau = self.optimizer_config["name"] == "adam_plateau"
        return plateau or (trainer.current_epoch + 1) % every == 0 or trainer.current_epoch + 1 == trainer.max_epochs

    def validation_step(self, batch: Batch, batch_idx: int) -> None:
        with torch.enable_grad():
            loss = self.losses(batch)["loss"].detach()
        self.log("loss/validation", loss, batch_size=samples(batch))

    def configure_optimizers(self):
        return self._optimizer_of(self.named_parameters(), self.own)

    def _optimizer_of(self, named: Iterable[tuple[str, nn.Parameter]], physical: Sequence[str]) -> Any:
        """The optimizer; parameters whose names hold one of ``physical`` have a step size of theirs."""
        steps = int(self.trainer.estimated_stepping_batches) if self._trainer is not None else 1000
        told = [(any(own in name for own in physical), p) for name, p in named]
        of_law, weights = ([p for own, p in told if own == wanted] for wanted in (True, False))
        return build_optimizer(self.optimizer_config, weights, of_law, steps)

    def on_load_checkpoint(self, checkpoint: dict[str, Any]) -> None:
        """Tell in one line when the checkpoint belongs to another model."""
        check_same_model(checkpoint, dict(self.hparams))

    # use -----------------------------------------------------------------------------------------------------
    def fit_scales(self, batch: Batch) -> None:
        """Standardise the network's inputs by the training data."""
        self.network.set_scale(batch["x"])

    @torch.no_grad()
    def predict_trial(self, trial: ContactTrial, source: str = "online") -> dict[str, np.ndarray]:
        """Force (N) and internal states along one trial, arrays of shape (n,)."""
        batch = {name: torch.as_tensor(v, device=self.device) for name, v in self.arrays(trial, source).items()}
        return {name: value.squeeze(-1).cpu().numpy().astype(float) for name, value in self.predict(batch).items()}


def samples(batch: Batch) -> int:
    """Number of samples of a batch."""
    return len(next(iter(batch.values())))


def check_loss(loss: Mapping[str, Any]) -> None:
    """Raise :class:`UserError` for an unknown term or a weight that is not a positive number."""
    for key, known in (("force", ("normalised", "plain")), ("consistency", ("relative", "plain"))):
        choose(loss.get(key, known[0]), dict.fromkeys(known), f"model.loss.{key}")
    for key in ("weight", "floor"):
        value = loss.get(key, 1.0)
        if isinstance(value, bool) or not isinstance(value, int | float) or not 0 < value < np.inf:
            raise UserError("not a weight", where=f"model.loss.{key}", received=repr(value), allowed="a number above 0")


def check_same_model(checkpoint: Mapping[str, Any], hparams: Mapping[str, Any], where: str = "ckpt_path") -> None:
    """Raise :class:`UserError` unless the checkpoint is of the same variant, network, law, system and optimizer."""
    saved = checkpoint.get("hyper_parameters")
    if not isinstance(saved, Mapping) or "name" not in saved:
        raise UserError(
            "not a checkpoint of frictionpinn", where=where, fix="give a file from a run's checkpoints folder"
        )
    difference = _first_difference(_identity(saved), _identity(hparams))
    if difference:
        key, theirs, ours = difference
        raise UserError(
            "checkpoint of another model",
            where=where,
            received=f"{key} = {theirs}",
            allowed=f"{key} = {ours}",
            fix=f"train with model={saved['name']} and the options of that run, or start afresh without ckpt_path",
        )


def _identity(hparams: Mapping[str, Any]) -> dict[str, Any]:
    """What must agree before a checkpoint's weights and the optimizer's state mean the same."""
    own = {key: hparams.get(key) for key in ("name", "inputs", "windows", "network", "bristle", "share")}
    state = hparams.get("state") or {}
    own["state"] = {key: state[key] for key in ("elements", "gaps", "delay") if state.get(key)}
    own["ensemble"] = len(hparams.get("members") or [None])
    own["system"] = (hparams.get("context") or {}).get("system")
    own["optimizer"] = (hparams.get("optimizer") or {}).get("name")
    contacts = {name: options.get("law") for name, options in (hparams.get("contacts") or {}).items()}
    return {**own, "friction": contacts or hparams.get("law")}


def _first_difference(saved: Any, own: Any, key: str = "") -> tuple[str, Any, Any] | None:
    """Key and both values where two plain structures first differ; numbers agree to 1e-6."""
    if isinstance(saved, Mapping) and isinstance(own, Mapping):
        pairs = ((name, saved.get(name), own.get(name)) for name in {**own, **saved})
        found = (_first_difference(a, b, f"{key}.{name}".lstrip(".")) for name, a, b in pairs)
        return next(filter(None, found), None)
    try:
        same = np.shape(saved) == np.shape(own) and bool(np.allclose(saved, own, rtol=1e-6, atol=0.0))
    except (TypeError, ValueError):
        same = saved == own
    return None if same else (key, saved, own)
