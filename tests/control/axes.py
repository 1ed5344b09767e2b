"""Axes and compensators that the tests of control share."""

from __future__ import annotations

from frictionpinn.control import Compensator, Gains, Plant, tuned
from frictionpinn.control.pid import loop_dead_time
from frictionpinn.physics import LAWS, SYSTEMS
from frictionpinn.physics.mechanism import Mechanism

DRIVE = Mechanism(SYSTEMS["drive"](), LAWS["lugre"]())
TRUTH = {"M": 1.0, "sigma_0": 1e5, "sigma_1": 300.0, "sigma_2": 2.0, "mu_c": 3.0, "mu_s": 4.5, "v_s": 2e-3}
WRONG = {name: value * (0.8 if k % 2 else 1.2) for k, (name, value) in enumerate(TRUTH.items())} | {"M": 1.0}
RESOLUTION, DELAY, LIMIT = 1e-6, 1.5e-3, 30.0
ADAPTS = {"adapt": {"mu_c": 0.1, "mu_s": 0.1}, "spread": {"mu_c": 0.3, "mu_s": 0.3}, "disturbance": 9.0,
          "bandwidth": 45.0, "delay": DELAY, "resolution": RESOLUTION, "limit": 18.0}  # fmt: skip


def plant(*effects: str, **values: float) -> Plant:
    """A drive with the true friction and these effects."""
    mechanism = Mechanism(SYSTEMS["drive"](), LAWS["lugre"](), effects) if effects else DRIVE
    return Plant(mechanism, TRUTH | values, RESOLUTION, DELAY, LIMIT)


def gains() -> Gains:
    return tuned(1.0, loop_dead_time(DELAY, 1e-3), limit=LIMIT, dead=2 * RESOLUTION)


def estimator(parameters: dict[str, float] | None = None, **options: object) -> Compensator:
    return Compensator(DRIVE, parameters or WRONG, **{**ADAPTS, **options})  # type: ignore[arg-type]
