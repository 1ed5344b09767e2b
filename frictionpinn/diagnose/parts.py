"""Simulators of the declared mechanism with only the effects that a fit needs: what is switched off costs time too."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from threading import Lock

import numpy as np

from ..errors import UserError
from ..numerics.simulate import Simulator, Values
from ..physics.effect import Effect
from ..physics.mechanism import Mechanism


class Part(Simulator):
    """A simulator that takes the parameters of a wider mechanism too, and leaves out what it lacks."""

    def parameters(self, p: Values) -> np.ndarray:
        """See :meth:`Simulator.parameters`; names of other parameters are passed over."""
        return self._vector(p) if isinstance(p, Mapping) else super().parameters(p)

    def __reduce__(self):
        return Part, (self.mechanism,)


class Parts:
    """Simulators by the effects that are switched on, made and compiled on first use.

    Args:
        declared: the mechanism as declared: its effects are part of all.
        tested: that with every candidate effect. Those that bring a bristle are part of all, too: with one a trial has
            one unknown more.
    """

    def __init__(self, declared: Mechanism, tested: Mechanism):
        self.tested, self.whole = tested, Simulator(tested)
        self._always = {e.name for e in tested.effects if e.name in {d.name for d in declared.effects} or e.memory}
        self._own = {e.name: e.parameters_on(tested.system, tested.law) for e in tested.effects}
        self._made: dict[tuple[str, ...], Simulator] = {}
        self._making = Lock()

    def of(self, names: Iterable[str], values: Mapping[str, float]) -> Simulator:
        """The simulator for these free parameters, with the others at these values.

        The whole mechanism where an effect cannot act without others that are switched off.
        """
        free = set(names)
        effects = tuple(e for e in self.tested.effects if e.name in self._always or self._acts(e, free, values))
        key = tuple(e.name for e in effects)
        with self._making:
            if key not in self._made:
                try:
                    self._made[key] = Part(Mechanism(self.tested.system, self.tested.law, effects))
                except UserError:
                    self._made[key] = self.whole
            return self._made[key]

    def _acts(self, effect: Effect, free: set[str], values: Mapping[str, float]) -> bool:
        own = [par for par in self._own[effect.name] if par.neutral is not None]
        return any(par.name in free or values.get(par.name, par.neutral) != par.neutral for par in own)
