"""How good a model is: force errors on held-out trials, fitted baselines, figures."""

import sys

from .. import Function

sys.modules[__name__].__class__ = Function  # called, this is frictionpinn.evaluate(...)
