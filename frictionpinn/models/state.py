"""A friction network with memory: bristles in parallel whose saturation and rest a network gives, by construction
dissipative; trained along the measured motion or through the motion that it makes itself."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from ..data.contact import ContactTrial
from ..errors import choose
from ..numerics.state_function import Drive, Recursion
from ..numerics.torch_functions import LawFunctions
from ..physics import LAWS
from ..physics.beforehand import EXCESS, SPREADS, STRIBECK
from .base import Batch, FrictionModel
from .beside_law import beside_law, met_at
from .black_box_start import start_black_box
from .elements import StateFriction
from .input_errors import of_training
from .knots import KNOTS, LOADS, cells, knots_of, read
from .network import perceptron
from .parameters import LawParameters
from .segments import GATE, SEGMENT, TRIAL, curved, segments, through
from .state_start import find_start

STEPS = 4  # of the recursion per sample: slip velocity to 1e-4 m/s on the pendulum on a box at 400 Hz
GAIN = 0.05  # share by which the slip velocity is corrected to the measured one, per sample, online
PRESLIDING = 1e-2  # share of v^2 / a that a bristle bends: where its training starts
SHARP = -3.0  # where training starts: n = 1.05, an exponential saturation, whose step is nearly exact
FAR = 50.0  # noises: a residual that diverged


class StateModel(FrictionModel):
    """F = sum_k kappa_k dead(z_k, gap_k) + damp(c_k z_k') + v r(v, N), z_k' = v - |v| sgn(z_k) (|z_k| / s_k)^n_k.

    A black box has ``elements`` such bristles, s_k = gap_k + N T_k(v, N), kappa_k T_k(v, N) and r(v, N) from a
    network with positive outputs: kappa_k T_k, the share of the load at which a bristle slides, is what a motion
    tells best, so the stiffness is free to move under it. Through the motion it begins as LuGre's law
    (:mod:`.black_box_start`), and a weight (``loss.weight``, else ``state.weight``) keeps small how T and r depend on
    the load. No closed cycle of motion gives energy (:mod:`..numerics.parallel_bristles`). A parameter estimator has
    the law's one bristle: kappa = sigma_0, c = sigma_1, n = 1, no gap, N T = capacity / sigma_0 times exp(network), a
    departure from the law that this weight keeps small, and r = sigma_2. The network is read at the knots of a table,
    which recursion, simulation and export share. Static friction and Stribeck velocity are weakly held to what is known
    of them beforehand (:mod:`..physics.beforehand`) where a training through the motion estimates them.

    Trained through the ``balance`` the slip velocity is the measured one, and the force is compared with that of the
    equation of motion. Trained through the ``motion`` it moves, v' = a_frictionless - mobility F, and velocity and
    force are compared with the measured ones over their noise. Where it leaves the measured motion, a_frictionless
    follows (:attr:`..physics.System.feedback`). A trial is cut where it slides fastest, and each segment starts anew
    from what was measured: a stop that is simulated wrongly spoils one segment. A parameter estimator
    carries on from segment to segment where its law explains whole trials (:mod:`.state_start`): what a segment forgets
    tells of viscous friction. The errors of the smoothed a_frictionless and of the velocities at the starts are
    estimated beside the weights (:mod:`.input_errors`), as maximum likelihood treats them. Online a model that sees
    a_frictionless carries slip velocity and bristles on from sample to sample and corrects the velocity by the measured
    one while the contact slides; one that does not follows the measured velocity.

    Args:
        state: ``elements``, ``gaps`` (whether a bristle has play), ``start`` (of a black box,
            :data:`.black_box_start.STARTS`), ``delay`` (whether the measured force comes early by a time that is
            estimated too), ``weight`` (where ``loss`` has none), ``lengths`` (samples of every segment, by training
            trial, see :func:`segments`), ``input_shape`` and ``input_ends`` (:func:`..data.input_noise.input_noise`).
        law: of a parameter estimator, see :class:`.parameter_estimator.ParameterEstimator`.
        scales: beside :func:`.start.data_scales` mobility, load_low, load_high, fastest, step and those of input_noise.
        others: see :class:`.base.FrictionModel`.
    """

    met: Tensor
    knots: Tensor
    eyes: Tensor
    carried: Tensor
    departs: Tensor
    discount: Tensor
    begins: Tensor
    own = ("law_parameters.", "stiffness", "damping", "gap", "sharp")

    def __init__(self, *, state: dict[str, Any], law: dict[str, Any] | None = None, **common: Any):
        super().__init__(**common, state=state, law=law)
        self.save_hyperparameters(logger=False)
        del self.network  # of the windows
        scales, options = self.scales, dict(state)
        # Share of its velocity and bristles that a segment has from the one before.
        self.register_buffer("carried", torch.zeros((), dtype=torch.float64))
        # Square of the residuals in noises times the samples over which they stay correlated, where it is not 1.
        self.register_buffer("discount", torch.ones((), dtype=torch.float64))
        # Whether the network of a parameter estimator departs from the law.
        self.register_buffer("departs", torch.ones((), dtype=torch.float64))
        self.lengths = [int(n) for own in state.get("lengths", ()) for n in own]
        self.weight = float(self.loss.get("weight", options.get("weight", 1.0)))
        self.K = 1 if law else int(options["elements"])
        self.moving = scales["mobility"] > 0 and "a_frictionless" in self.features.inputs
        self.through = through(self.loss.get("through"), self.moving, scales)
        self.odd = bool(common["network"].get("odd", True))
        self.grid, knots, eyes = knots_of(self.scales, self.odd)
        self.register_buffer("knots", torch.from_numpy(knots), persistent=False)
        self.register_buffer("eyes", torch.from_numpy(eyes).float(), persistent=False)
        self.network = perceptron(  # type: ignore[assignment]
            common["network"], self.K + (0 if law else 1)
        )
        self.law_parameters = None
        if law:
            kind = choose(law["name"], LAWS, "friction")
            self.law_parameters = LawParameters(kind(), **{key: value for key, value in law.items() if key != "name"})
            self.functions = LawFunctions(kind())
            self.register_buffer("met", torch.ones(len(knots), dtype=torch.float64))
        else:
            self._elements(options)
        if options.get("delay"):
            self.delay = nn.Parameter(torch.zeros(()))
        self.errors = of_training(options, scales, self.through)

    def _elements(self, options: dict[str, Any]) -> None:
        """Start of the black box's bristles: reaches side by side, each with the same share of the force."""
        scales, K = self.scales, self.K
        bend = PRESLIDING * scales["velocity"] ** 2 / scales["acceleration"]
        reach = bend * 4.0 ** torch.arange(K)
        self.stiffness = nn.Parameter(torch.log(scales["force"] / K / reach))
        self.sharp = nn.Parameter(torch.full((K,), SHARP))
        if options.get("gaps"):
            self.gap = nn.Parameter(torch.log(0.5 * reach))
        load = 0.5 * (scales["load_low"] + scales["load_high"])
        dry, viscous = np.log(scales["force"] / K / load), np.log(scales["viscous"])
        # log of kappa_k T_k and r at the knots, to which the network adds.
        self.register_buffer("begins", torch.tensor([dry] * K + [viscous]).repeat(len(self.knots), 1))
        mass = 1 / scales["mobility"] if scales["mobility"] else 0.0
        self.damping = nn.Parameter(torch.log(torch.sqrt(torch.exp(self.stiffness.detach()) * mass).clamp_min(1e-9)))

    # the map -------------------------------------------------------------------------------------------------
    def tables(self) -> tuple[Tensor, Tensor, Tensor]:
        """T and r at the knots, shape (K + 1, velocities, loads); kappa, c, gap, n, shape (4, K); the network there."""
        told = self.network(self.eyes).double()
        shape = (KNOTS, LOADS)
        if self.law_parameters is not None:
            p = {name: value.double() for name, value in self.law_parameters().items()}
            v, N = self.knots[:, 0], self.knots[:, 1]
            told, free = self.departs * told, self.law_parameters.raw
            told = beside_law(told, self.functions.capacity, free, p, self.knots, self.met)
            T = self.functions.capacity(v, N, *p.values()) / (p["sigma_0"] * N) * torch.exp(told[:, 0])
            zero = torch.zeros((), dtype=torch.float64, device=T.device)
            r = p.get("sigma_2", zero) * torch.ones_like(T)
            one = [p["sigma_0"], p.get("sigma_1", zero), zero, zero + 1.0]
            return torch.stack([T, r]).reshape(2, *shape), torch.stack(one)[:, None], told
        shares = told + self.begins
        T = torch.exp(shares[:, : self.K] - self.stiffness)
        r = torch.exp(shares[:, self.K])
        gap = torch.exp(self.gap) if hasattr(self, "gap") else torch.zeros_like(self.stiffness)
        n = 1 + nn.functional.softplus(self.sharp)
        rows = torch.stack([torch.exp(self.stiffness), torch.exp(self.damping), gap, n]).double()
        return torch.cat([T.T, r[None]]).reshape(self.K + 1, *shape), rows, told

    def _along(self, batch: Batch, moving: bool, gain: float, known: bool) -> dict[str, Tensor]:
        """Force, slip velocity and states along the trials of a batch; ``known``: the trials that it is trained on."""
        tables, elements, told = self.tables()
        column = {name: batch[name][:, 0].double() for name in ("v", "N", "A", "h", "start", "seen_v", "target")}
        starts = column["start"] > 0
        anew = torch.where(column["start"] == SEGMENT, 1 - self.carried if known and moving else 1.0, starts)
        first = anew > 0
        v, A = column["v"], column["A"]
        if moving:
            follow = torch.where(first, v, column["seen_v"])
            noise = GATE * max(self.scales["slip_noise"], 1e-12)
            gate = 1 / (1 + (noise / follow.abs().clamp_min(1e-12)) ** 4)
        else:
            follow, gate = v, torch.zeros_like(v)
        off = torch.zeros_like(A)
        start_off = torch.zeros((int(first.sum()), 2), dtype=torch.float64, device=A.device)
        if known and self.errors is not None:
            off = self.errors.along()
            A = A + off
            start_off = self.errors.at_starts(anew[starts])[first[starts]]
        if moving and hasattr(self, "delay"):
            A = A + self.lag() * self.scales["mobility"] * batch["whole_rate"][:, 0].double()
        z0 = self._start(column["target"][first], v[first], column["N"][first], tables, elements)
        arrays = [x.detach().cpu().numpy() for x in (follow, column["N"], column["h"], anew, gate)]
        mobility = self.scales["mobility"] if moving else 0.0
        v_, N_, h_, anew_, gate_ = (np.ascontiguousarray(x) for x in arrays)
        u = slopes = None
        if known and moving:
            u, *back = (np.ascontiguousarray(batch[name][:, 0].double().cpu()) for name in ("u", "pull", "drag"))
            slopes = np.stack(back, axis=1)
        drive = Drive(v_, N_, h_, anew_, gate_, mobility, STEPS, u, slopes)
        share = torch.as_tensor(gain, dtype=torch.float64)
        force, slip, states, left = Recursion.apply(z0, tables, elements, share, A, start_off, self.grid, drive)
        return {"force": force, "slip": slip, "z": states, "left": left, "off": off, "told": told}

    def _start(self, force: Tensor, v: Tensor, N: Tensor, tables: Tensor, elements: Tensor) -> Tensor:
        """States at the starts, shape (trials, K): settled where the contact surely slides; at rest those that carry
        the measured force, each the same share of its reach."""
        still, now = read(self.grid, tables, torch.zeros_like(v), N), read(self.grid, tables, v, N)
        settled = v.sign()[:, None] * (elements[2] + N[:, None] * now[:, : self.K])
        dry = N[:, None] * still[:, : self.K]
        share = ((force - still[:, self.K] * v)[:, None] / (elements[0] * dry).sum(1, keepdim=True)).clamp(-1, 1)
        carried = share.sign() * (elements[2] + dry * share.abs())
        slides = v.abs() > 2 * GATE * self.scales["slip_noise"]
        return torch.where(slides[:, None] & (self.moving or self.through == "motion"), settled, carried)

    # training ------------------------------------------------------------------------------------------------
    def arrays(self, trial: ContactTrial, source: str = "online") -> dict[str, np.ndarray]:
        """Columns of one trial, shape (n, 1): v, N, A, h, start, target, what is measured, rate of the whole force."""
        table, raw = getattr(trial, source), trial.seen if source == "offline" else trial.felt
        start = np.zeros(len(trial.t))
        simulated = source == "offline" and self.through == "motion"
        if simulated:
            start[segments(trial, self.scales["slip_noise"])] = SEGMENT
        start[0] = TRIAL
        load = np.abs(table["normal_force"])
        A, u = table["a_frictionless"], table["v_slip"]
        back = trial.feedback if simulated and trial.feedback is not None else np.zeros((len(trial.t), 2))
        force = A / self.scales["mobility"] if self.scales["mobility"] else np.zeros_like(A)
        columns = {
            "v": table["v_slip"], "N": load, "A": curved(A) if simulated else A,
            "h": np.append(np.diff(trial.t), 0.0), "start": start,
            "target": trial.offline["friction_force"] if source == "offline" else table["friction_force"],
            "seen_v": raw.get("v_slip", table["v_slip"]),
            "seen_F": raw.get("friction_force", table["friction_force"]),
            "whole_rate": np.gradient(force, trial.t), "u": curved(u), "pull": back[:, 0], "drag": back[:, 1],
            "off_position": np.zeros(len(u)) if trial.off_position is None else trial.off_position,
        }  # fmt: skip
        arrays = {name: np.ascontiguousarray(x, dtype=np.float32)[:, None] for name, x in columns.items()}
        return arrays | {"x": np.concatenate([arrays["v"], arrays["N"]], axis=1)}

    def fit_scales(self, batch: Batch) -> None:
        """The knots are scaled by construction; a black box starts as :mod:`.black_box_start` says, a parameter
        estimator that is trained through the motion as :mod:`.state_start`."""
        if self.law_parameters is None:
            return start_black_box(self, batch)
        v, N = (batch[name][:, 0].double() for name in ("v", "N"))
        self.met.copy_(met_at(cells(self.grid, v, N), N**2, (KNOTS, LOADS)))
        if self.through == "motion" and self.law_parameters.raw:
            find_start(self, batch)

    @torch.no_grad()
    def loss_now(self, batch: Batch) -> float:
        """Loss as it is now."""
        return float(self.losses(batch)["loss"])

    def losses(self, batch: Batch, outputs: tuple[Tensor, ...] | None = None) -> dict[str, Tensor]:
        own = sum(self.lengths) == len(batch["v"])
        if self.through == "motion":
            parts, told = self._through_motion(batch, own)
        else:
            parts, told = self._through_balance(batch)
        if self.law_parameters is not None:
            parts |= self.beside(batch, {"told": told})
        elif self.through == "motion":  # in noises: beside a force balance, which has none, the weight means nothing
            by_load = told.reshape(KNOTS, LOADS, -1)
            parts["consistency"] = self.weight * (by_load - by_load.mean(1, keepdim=True)).square().mean()
        parts["loss"] = sum(parts.values(), start=torch.zeros((), dtype=torch.float64))
        return parts

    def beside(self, batch: Batch, predicted: Mapping[str, Tensor]) -> dict[str, Tensor]:
        """Of a parameter estimator, how far its network departs from the law."""
        if self.law_parameters is None:
            return {}
        told = predicted["told"] if "told" in predicted else self.tables()[2]
        return {"consistency": self.weight * told.square().mean()}

    def _through_balance(self, batch: Batch) -> tuple[dict[str, Tensor], Tensor]:
        found = self._along(batch, False, 0.0, False)
        force = found["force"]
        if hasattr(self, "delay"):
            force = force - self.lag() * batch["whole_rate"][:, 0].double()
        off = (force - batch["target"][:, 0].double()).square().mean()
        scale = self.scales["force"] ** 2 if self.loss["force"] == "normalised" else 1.0
        return {"force": off / scale}, found["told"]

    def _through_motion(self, batch: Batch, own: bool) -> tuple[dict[str, Tensor], Tensor]:
        found = self._along(batch, True, 0.0 if own else GAIN, own)
        n, scales = len(batch["v"]), self.scales
        force = found["force"] - found["off"] / scales["mobility"] - batch["seen_F"][:, 0].double()
        parts = {"slip": self._off(batch, found, own).clamp(-FAR, FAR).square().mean() / self.discount}
        if scales["force_noise"] > 0:  # where nothing was smoothed the accelerations are derived, and say nothing more
            parts["force"] = (force / scales["force_noise"]).clamp(-FAR, FAR).square().mean()
        if own and self.errors is not None:
            parts["inputs"] = self.errors.squares() / n
        if own and self.law_parameters is not None:
            parts["beforehand"] = self._beforehand() / n
        return parts, found["told"]

    def _off(self, batch: Batch, found: Mapping[str, Tensor], own: bool) -> Tensor:
        """Slip velocity or slip position of the simulated motion less the measured one, in noises, shape (n,)."""
        scales = self.scales
        if own and scales.get("position_noise", 0.0) > 0:
            return (found["left"] - batch["off_position"][:, 0].double()) / scales["position_noise"]
        return (found["slip"] - batch["seen_v"][:, 0].double()) / scales["slip_noise"]

    @torch.no_grad()
    def residuals(self, batch: Batch) -> list[np.ndarray]:
        """By trial, what a training through the motion leaves of the slip, in noises; ``batch``: it is trained on."""
        off = self._off(batch, self._along(batch, True, 0.0, True), True).cpu().numpy()
        return np.split(off, np.flatnonzero(batch["start"][1:, 0].cpu().numpy() == TRIAL) + 1)

    def _beforehand(self) -> Tensor:
        """Squares of what is known of static friction and Stribeck velocity, see :mod:`..physics.beforehand`."""
        p, free = self.law_parameters(), self.law_parameters.raw  # type: ignore[misc, union-attr]
        off = []
        if "mu_s" in free:
            off.append(torch.log((p["mu_s"] / p["mu_c"] - 1).clamp_min(1e-6) / EXCESS) / SPREADS["mu_s"])
        if "v_s" in free:
            off.append(torch.log(p["v_s"] / (STRIBECK * self.scales["velocity"])) / SPREADS["v_s"])
        return sum((x.double().square() for x in off), start=torch.zeros((), dtype=torch.float64))

    def lag(self) -> Tensor:
        """Time by which the measured force comes early, s."""
        return self.scales["step"] * self.delay

    def physical(self) -> dict[str, float]:
        if self.law_parameters is None:
            return {}
        with torch.no_grad():
            return {name: float(value) for name, value in self.law_parameters().items()}

    # use -----------------------------------------------------------------------------------------------------
    def predict(self, batch: Batch) -> dict[str, Tensor]:
        """Force along the trials of a batch, shape (n, 1), and of a parameter estimator z."""
        found = self._along(batch, self.moving, GAIN, False)
        return {"force": found["force"][:, None]} | ({"z": found["z"]} if self.law_parameters is not None else {})

    def friction(self) -> StateFriction:
        """The trained map as plain numbers."""
        with torch.no_grad():
            tables, elements, _ = self.tables()
        return StateFriction(tables.cpu().numpy(), self.grid, elements.cpu().numpy())
