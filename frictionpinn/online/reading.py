"""What the online estimator says of one instant."""

from __future__ import annotations

from typing import Any, NamedTuple

from ..physics.base import place_of


class Reading(NamedTuple):
    """Friction force at one instant; with several contacts force, low and high have the shape (contacts,).

    Attributes:
        t: time, s.
        force: in the unit of force of its contact.
        low, high: 95 % interval.
        status: "ok", "contact lost" (a normal force is not positive), "no solution", "restarted" (after a gap of
            twenty usual intervals nothing is left of what was known), or "inconsistent": over the last
            fifth of a second the samples are further from what the filter expected than its interval allows, see
            :class:`.consistency.Consistency`. Parameters or noise levels are wrong, a sensor failed, the surface
            changed: neither force nor interval can be relied on.
        contacts: names of the contacts.
    """

    t: float
    force: Any
    low: Any
    high: Any
    status: str
    contacts: tuple[str, ...] = ("",)

    def at(self, contact: str) -> Reading:
        """The reading of one contact: force, low and high are numbers.

        Raises:
            UserError: there is no such contact.
        """
        k = place_of(contact, self.contacts)
        if len(self.contacts) == 1:
            return self
        force, low, high = (float(values[k]) for values in (self.force, self.low, self.high))
        return Reading(self.t, force, low, high, self.status, (contact,))
