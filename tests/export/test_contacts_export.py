"""Several contacts handed on: each in C and MuJoCo gives what the package gives, all of them in one program."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
import sys

import numpy as np
import pytest

from frictionpinn.evaluate.yardsticks import simulated_law
from frictionpinn.numerics.paths import InputPath
from frictionpinn.physics import LAWS, SYSTEMS
from frictionpinn.physics.mechanism import Mechanism
from frictionpinn.workflow.experiment import build_data
from frictionpinn.workflow.export import export
from frictionpinn.workflow.load import load_run
from frictionpinn.workflow.options import composed
from frictionpinn.workflow.train import train

CARTPOLE = """
<mujoco><option timestep="{step}" gravity="0 0 -9.81" integrator="implicitfast"/><worldbody><body name="cart">
<joint name="x" type="slide" axis="1 0 0"/><inertial pos="0 0 0" mass="1.0" diaginertia="1 1 1"/>
<body name="pole"><joint name="theta" type="hinge" axis="0 1 0"/>
<inertial pos="0 0 0.3" mass="0.3" diaginertia="0.009 0.009 0.009"/></body></body></worldbody>
<actuator><motor joint="x"/></actuator></mujoco>
"""


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """Folder of a short training on the cart-pole, exported."""
    folder = tmp_path_factory.mktemp("contacts")
    options = ["model=pe1", "system=cartpole", "trainer.max_epochs=2", "trainer.threads=1", "data.rate_hz=100"]
    options += ["model.network.width=8", "trainer.progress_bar=false", "data.training_trials=2"]
    train(composed("train", options), folder)
    export({"run": str(folder), "export": ["c", "mujoco"]})
    return folder


@pytest.mark.skipif(shutil.which("cc") is None, reason="needs a C compiler, cc")
def test_the_networks_of_all_contacts_fit_into_one_c_program_and_equal_the_models(run):
    trained, system, model = load_run(run)
    sources = [f"{name}/{name}_friction.c" for name in model.contacts]
    flags = ["-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic", "-O2", "-shared", "-fPIC", "-o", "both.so"]
    done = subprocess.run(["cc", *flags, *sources, "-lm"], cwd=run / "export" / "c", capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    library = ctypes.CDLL(str(run / "export" / "c" / "both.so"))
    trial = build_data(trained, system).select("held_out")[0]
    for contact in model.contacts:
        own, memory = trial.at(contact), ctypes.create_string_buffer(1 << 16)
        getattr(library, f"{contact}_friction_network_reset")(memory)
        step = getattr(library, f"{contact}_friction_network_step")
        step.restype = ctypes.c_double
        rows = [own.online["v_slip"], own.online["normal_force"], own.rates["v_slip"], own.rates["normal_force"]]
        force = [step(memory, (ctypes.c_double * 4)(*row)) for row in np.array(rows).T]
        ours = model.map_of(contact).predict_trial(own)["force"]
        np.testing.assert_allclose(force[1:], ours[1:], atol=1e-4 * np.abs(ours).max())


def test_mujoco_with_the_laws_of_two_contacts_reproduces_our_simulation(run, monkeypatch):
    mujoco = pytest.importorskip("mujoco", reason="needs the extra: pip install -e '.[mujoco]'")
    for name in ("friction_mujoco", "friction_model", "friction_law"):
        sys.modules.pop(name, None)
    monkeypatch.syspath_prepend(str(run / "export" / "mujoco"))
    import friction_mujoco as module

    system, (_, _, model) = SYSTEMS["cartpole"](), load_run(run)
    t = np.arange(101) / 100
    pushed = {"force": 4 * np.sin(6 * t) + 2 * np.sin(17 * t)}
    path = InputPath.from_signals(Mechanism(system, LAWS["coulomb"]()), t, pushed)
    ours = simulated_law(system, {"rail": "lugre", "bearing": "lugre"}, model.physical())(path, {"theta": np.pi})
    stride = 20
    mj = mujoco.MjModel.from_xml_string(CARTPOLE.format(step=0.01 / stride))
    data = mujoco.MjData(mj)
    data.joint("theta").qpos[0] = np.pi  # hangs at rest: no bristle is bent at the start
    frictions = [module.Friction(mj, "law", contact="rail", joint="x", normal=module.Reaction("cart")),
                 module.Friction(mj, "law", contact="bearing", joint="theta", normal=module.Preload(1.0))]  # fmt: skip
    found = []
    for k in range(100 * stride):
        data.ctrl[0] = float(path(data.time + 0.5 * mj.opt.timestep)[0])
        forces = module.step(frictions, data)
        if (k + 1) % stride == 0:
            found.append(forces)
    for place, contact in enumerate(ours.contacts):
        force, known = np.array(found)[:, place], ours.at(contact).F[1:]
        assert np.sqrt(np.mean((force - known) ** 2)) < 0.02 * np.sqrt(np.mean(known**2)), contact
    with pytest.raises(ValueError, match="no such contact was exported: 'wheel'"):
        module.Friction(mj, "law", contact="wheel", joint="x", normal=module.Preload(1.0))
    for name in ("friction_mujoco", "friction_model", "friction_law"):
        sys.modules.pop(name, None)
