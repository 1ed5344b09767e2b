"""The functions of ``import frictionpinn as fp``; what they return shows itself, see :mod:`frictionpinn.show`."""
