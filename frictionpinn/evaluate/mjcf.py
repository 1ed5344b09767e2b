"""The pendulum on a box as a MuJoCo model (MJCF)."""

from __future__ import annotations

from collections.abc import Mapping

from ..errors import UserError, choose

SUPPORTS = {
    "rail": ("", "", "the box moves along x alone; the rail's reaction is the normal force, exactly"),
    "plane": (
        '<geom name="ground" type="plane" size="0 0 0.1" rgba="0.8 0.8 0.8 1"/>',
        '<joint name="z" type="slide" axis="0 0 1"/>',
        "the box stands on a plane; MuJoCo's contact is compliant",
    ),
}

_MJCF = """<mujoco model="pendulum on a box">
  <!-- {comment}. Units: m, rad, kg, s, N. -->
  <compiler angle="radian"/>
  <option timestep="{timestep!r}" gravity="0 0 {fall!r}" cone="{cone}"/>
  <default>
    <geom condim="{condim}" friction="{friction!r} 0 0" solref="{softness!r} 1" solimp="0.95 0.9999 0.0001"/>
  </default>
  <worldbody>
    {ground}
    <body name="box" pos="0 0 0.05">
      <joint name="x" type="slide" axis="1 0 0"/>
      {rise}
      <geom name="box" type="box" size="0.1 0.1 0.05" mass="{m_b!r}" rgba="0.55 0.6 0.68 1"/>
      <body name="link">
        <joint name="theta" type="hinge" axis="0 1 0"/>
        <inertial pos="0 0 {d!r}" mass="{m_L!r}" diaginertia="{J_L!r} {J_L!r} {J_L!r}"/>
        <geom name="link" type="capsule" fromto="0 0 0 0 0 {length!r}" size="0.01" contype="0" conaffinity="0"
              mass="0" rgba="0.82 0.29 0.36 1"/>
      </body>
    </body>
  </worldbody>
  {contact}<actuator>
    <motor name="tau" joint="theta"/>
  </actuator>
</mujoco>
"""


_PAIR = """<contact>
    <pair geom1="box" geom2="ground" condim="3" friction="{friction!r} {friction!r} 0 0 0" solref="{softness!r} 1"
          solreffriction="{creep!r} 1" solimp="0.95 0.9999 0.0001"/>
  </contact>
  """


def pob_mjcf(
    values: Mapping[str, float],
    *,
    timestep: float = 1e-4,
    support: str = "rail",
    friction: float | None = None,
    creep: float | None = None,
) -> str:
    """Text of an MJCF model: joints ``x`` (slide, m) and ``theta`` (hinge, rad, from upright), motor ``tau`` (N m).

    Args:
        values: m_b, m_L, d, J_L, g in SI units (:class:`~frictionpinn.physics.PendulumOnBox`'s ``values``).
        timestep: s.
        support: "rail" (no vertical motion at all) or "plane" (a further joint ``z``, contact of geom ``box`` with geom
            ``ground``, as stiff as the timestep allows).
        friction: coefficient of MuJoCo's own friction cone in that contact; None leaves the contact frictionless.
        creep: time constant, s, with which that friction brings slip to rest; None takes the contact's own.

    Raises:
        UserError: an unknown support, MuJoCo's friction without a contact.
    """
    ground, rise, comment = choose(support, SUPPORTS, "support")
    if friction is not None and support != "plane":
        raise UserError("no contact to rub", where="friction", received=friction, allowed="support='plane'")
    softness = 2.5 * float(timestep)  # MuJoCo wants at least two steps in a contact's time constant
    pair = "" if creep is None else _PAIR.format(friction=float(friction or 0.0), softness=softness, creep=float(creep))
    return _MJCF.format(
        **{name: float(values[name]) for name in ("m_b", "m_L", "d", "J_L")},
        fall=-float(values["g"]),
        timestep=float(timestep),
        softness=softness,
        contact=pair,
        length=2 * float(values["d"]),
        condim=1 if friction is None else 3,
        friction=float(friction or 0.0),
        cone="pyramidal" if friction is None else "elliptic",
        ground=ground,
        rise=rise,
        comment=comment[0].upper() + comment[1:],
    )
