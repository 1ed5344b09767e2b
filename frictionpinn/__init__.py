"""frictionpinn: learn friction from state data through the equation of motion.

    >>> import frictionpinn as fp
    >>> model = fp.mechanism(fp.system("drive", M=2.0), "coulomb_viscous")

``read``, ``simulate`` and ``check`` a recording; ``fit`` a model to it, ``bound`` what it can tell, ``diagnose`` what
the model lacks; ``train`` a network, ``evaluate`` and ``export`` it, estimate ``online``, ``compensate`` beside a
controller. Results print as tables, show in a notebook with their figures, and have ``plot()``, ``to_dict()`` and
``save()``. What goes on inside is logged:
``logging.basicConfig(level="INFO", format="%(message)s")`` shows it.
"""

from __future__ import annotations

import os
from importlib import import_module
from types import ModuleType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .api.compensation import compensate
    from .api.estimates import bound, diagnose, fit, online
    from .api.models import effects, laws, mechanism, system, systems
    from .api.recordings import check, read, simulate
    from .api.training import evaluate, export, train
    from .errors import UserError

__version__ = "0.1.0"
__all__ = [
    "UserError",
    "bound",
    "check",
    "compensate",
    "diagnose",
    "effects",
    "evaluate",
    "export",
    "fit",
    "laws",
    "mechanism",
    "online",
    "read",
    "simulate",
    "system",
    "systems",
    "train",
]

# Rounds, some tens of microseconds, after which threads of torch (GNU OpenMP) that wait for one another go to sleep.
# Where others keep the machine busy they would hold for milliseconds the core that the other thread needs: two threads
# took 24 times what they take so, and 20 times what one takes. To be set before torch is loaded.
os.environ.setdefault("GOMP_SPINCOUNT", "10000")

# Name -> module, imported on first use: torch alone takes seconds.
_PLACES = {
    **dict.fromkeys(("bound", "diagnose", "fit", "online"), "api.estimates"),
    **dict.fromkeys(("effects", "laws", "mechanism", "system", "systems"), "api.models"),
    **dict.fromkeys(("check", "read", "simulate"), "api.recordings"),
    **dict.fromkeys(("evaluate", "export", "train"), "api.training"),
    "compensate": "api.compensation",
    "UserError": "errors",
}


def __getattr__(name: str) -> Any:
    if name not in _PLACES:
        raise AttributeError(f"module 'frictionpinn' has no attribute '{name}'")
    return getattr(import_module(f"{__name__}.{_PLACES[name]}"), name)


def __dir__() -> list[str]:
    return sorted([*globals(), *__all__])


class Function(ModuleType):
    """A folder of the package that has the name of a function, and is called as that: ``frictionpinn.diagnose``."""

    def __call__(self, *args: Any, **options: Any) -> Any:
        return self.__wrapped__(*args, **options)

    @property
    def __wrapped__(self) -> Any:  # where help, notebooks and inspect.signature look
        name = self.__name__.rpartition(".")[2]
        return getattr(import_module(f"{__package__}.{_PLACES[name]}"), name)
