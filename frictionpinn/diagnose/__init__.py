"""Diagnosis of a declared model: what it lacks."""

import sys

from .. import Function

sys.modules[__name__].__class__ = Function  # called, this is frictionpinn.diagnose(...)
