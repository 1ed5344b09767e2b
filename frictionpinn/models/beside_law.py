"""A network beside a law says only what no parameter of the law could say in its place.

Left free, the network takes up a tenth of viscous friction for a departure of a few thousandths, which no sensible
weight forbids: the parameters are then told by that weight and not by the data. It is therefore projected onto what is
orthogonal to the law over the training samples (Gyorok et al., Orthogonal projection-based regularization for
efficient model augmentation, 2025).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping

import torch
from torch import Tensor

NUDGE = 1e-4  # relative, of a derivative by differences
RIDGE = 1e-9  # of the normal equations: parameters that do not show in sliding, or not apart from another


def beside_law(
    told: Tensor, capacity: Callable, free: Iterable[str], p: Mapping[str, Tensor], knots: Tensor, met: Tensor
) -> Tensor:
    """The network's departure, the logarithm of what a bristle carries over the law's, less what the law could say.

    Args:
        told: departure at the knots, shape (knots, 1).
        capacity: of the law, (v, N, parameters) -> N, what the bristle carries in sliding.
        free: parameters that are estimated.
        p: all parameters in the law's order.
        knots: slip velocity and load, shape (knots, 2).
        met: weight of every knot, shape (knots,), see :func:`met_at`.
    """
    with torch.no_grad():
        v, N = knots[:, 0], knots[:, 1]
        now, D = capacity(v, N, *p.values()), []
        for name in free:
            more = capacity(v, N, *({**p, name: p[name] * (1 + NUDGE)}).values())
            D.append(v.abs() / now if name == "sigma_2" else (more - now) / (NUDGE * now))
        law = torch.stack(D, dim=1)
        law = law / law.square().sum(0).sqrt().clamp_min(1e-12)
        weighted = (met[:, None] * law).T
        normal = weighted @ law + RIDGE * torch.eye(law.shape[1], dtype=law.dtype, device=law.device)
        fit = torch.linalg.solve(normal, weighted)
    return told - law @ (fit @ told)


def met_at(cells: tuple[Tensor, Tensor, Tensor, Tensor], weight: Tensor, shape: tuple[int, int]) -> Tensor:
    """Share of the samples' weight at every knot, flat; ``cells``: shares and cells of the samples, shape (n,) each."""
    x, y, i, j = cells
    met = torch.zeros(shape, dtype=torch.float64, device=weight.device)
    for a in (0, 1):
        for b in (0, 1):
            part = weight * (x if a else 1 - x) * (y if b else 1 - y)
            met.index_put_((i + a, j + b), part, accumulate=True)
    return met.flatten() / weight.sum()
