"""Trainable parameters of a friction law, physical at every step of the training."""

from __future__ import annotations

from collections.abc import Mapping

import torch
from torch import Tensor, nn

from ..errors import UserError, nearest
from ..physics import FrictionLaw


class LawParameters(nn.Module):
    """Each parameter lies between its bounds: low (high / low)^s with s = sigmoid(u) and u trained.

    So all stay positive, and steps are relative whatever the unit. The static coefficient is mu_c or its own lower
    bound, whichever is larger, plus a share of what is left below its upper bound: mu_s >= mu_c always.

    Args:
        law: names and physical limits.
        start: parameter name -> start value.
        bounds: parameter name -> (low, high), within the physical limits.
        fixed: parameter name -> value that is not trained.
        tie_sigma1: sigma_1 = sqrt(sigma_0), as the published table suggests.

    Raises:
        UserError: unknown names, values out of bounds, mu_s < mu_c.
    """

    def __init__(
        self,
        law: FrictionLaw,
        start: Mapping[str, float],
        bounds: Mapping[str, tuple[float, float]],
        fixed: Mapping[str, float] | None = None,
        tie_sigma1: bool = False,
    ):
        super().__init__()
        self.names = [par.name for par in law.parameters]
        self.fixed = {par.name: par.value for par in law.parameters if par.name not in start and par.value is not None}
        self.fixed |= dict(fixed or {})
        self.tied = bool(tie_sigma1) and "sigma_1" in self.names
        self.bounds = {name: (float(low), float(high)) for name, (low, high) in bounds.items()}
        _check(law, start, self.bounds, self.fixed)
        self.raw = nn.ParameterDict()
        for name in self.names:
            if name not in self.fixed and not (self.tied and name == "sigma_1"):
                low, high = self._range(name, torch.tensor(float(start.get("mu_c", self.fixed.get("mu_c", 0.0)))))
                self.raw[name] = nn.Parameter(_inverse(float(start[name]), low, high))

    def _range(self, name: str, mu_c: Tensor) -> tuple[Tensor, Tensor]:
        low, high = (torch.as_tensor(bound, device=mu_c.device) for bound in self.bounds[name])
        if name != "mu_s":
            return low, high
        low = torch.maximum(mu_c, low)
        return low, torch.maximum(low * (1 + 1e-4), high)

    @torch.no_grad()
    def place(self, values: Mapping[str, float]) -> None:
        """Go on from values, SI units, each moved inside its bounds."""
        mu_c = torch.tensor(float(self.fixed.get("mu_c", values.get("mu_c", 0.0))))
        for name, raw in self.raw.items():
            raw.copy_(_inverse(float(values[name]), *(bound.cpu() for bound in self._range(name, mu_c))))

    def forward(self) -> dict[str, Tensor]:
        """Parameter name -> tensor of shape (), SI units, in the law's order."""
        device = next(iter(self.raw.values())).device
        values = {name: torch.tensor(float(value), device=device) for name, value in self.fixed.items()}
        for name, raw in self.raw.items():
            low, high = self._range(name, values.get("mu_c", torch.zeros((), device=device)))
            values[name] = low * (high / low) ** torch.sigmoid(raw)
        if self.tied:
            values["sigma_1"] = values["sigma_0"].sqrt()
        return {name: values[name] for name in self.names}


def _inverse(value: float, low: Tensor, high: Tensor) -> Tensor:
    share = torch.log(value / low) / torch.log(high / low)
    share = share.clamp(0.01, 0.99)  # a start on a bound would have no gradient
    return torch.log(share / (1 - share))


def _check(law: FrictionLaw, start: Mapping, bounds: Mapping, fixed: Mapping) -> None:
    names = [par.name for par in law.parameters]
    if all(name in fixed for name in names):
        raise UserError(
            "no parameter left to estimate",
            where="friction.fixed",
            received=", ".join(names),
            allowed="at least one parameter that is not fixed",
            fix="set one of them to null",
        )
    for table, where in ((start, "start"), (bounds, "bounds"), (fixed, "fixed")):
        for name in table:
            if name not in names:
                raise UserError(
                    f"unknown parameter of friction law {law.name}",
                    where=f"friction.{where}.{name}",
                    received=table[name],
                    allowed=", ".join(names),
                    fix=nearest(name, names),
                )
    for par in law.parameters:
        if par.name in fixed:
            _check_value(par, float(fixed[par.name]), (par.low, par.high), "fixed")
            continue
        if not 0 < float(start[par.name]) < float("inf"):
            raise UserError(
                f"{par.text} must be positive",
                where=f"friction.start.{par.name}",
                received=start[par.name],
                allowed="above 0",
                fix="give its value in SI units, or null for a start from the scale of the data",
            )
        low, high = bounds[par.name]
        if not 0 < low < high:
            raise UserError(
                "impossible bounds",
                where=f"friction.bounds.{par.name}",
                received=[low, high],
                allowed="0 < low < high",
                fix="give the lower bound first",
            )
        _check_value(par, float(start[par.name]), (low, high), "start")
    merged = {**start, **fixed}
    law.check_order(merged, "friction.start")


def _check_value(par, value: float, bounds: tuple[float, float], where: str) -> None:
    if not bounds[0] <= value <= bounds[1]:
        raise UserError(
            f"{par.text} out of bounds",
            where=f"friction.{where}.{par.name}",
            received=value,
            allowed=f"{bounds[0]:g} to {bounds[1]:g}",
            fix="move the value or widen friction.bounds",
        )
