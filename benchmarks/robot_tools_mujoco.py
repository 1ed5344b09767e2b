"""mujoco.sysid on motions of an arm; run by benchmarks/robot_tools.py in an environment that has mujoco[sysid].

    python robot_tools_mujoco.py FOLDER    robot.urdf, motions.npz and task.json stand there; writes predicted.npz

mujoco.sysid compares sensors of a rollout with a log. Rolled out from its torques an arm leaves its log within seconds
(gravity pulls where the model is a few per cent off), so its ``custom_rollout`` puts MuJoCo's inverse dynamics along
the logged motion in the rollout's place: torques are compared with torques. Parameters are its own: pseudo-inertia of
each body, damping, frictionloss and armature of each joint, and an offset. Of mujoco 3.17 and 4.0 a body with
pseudo-inertia does not compile ("mass and inertia of moving bodies must be larger than mjMINVAL"); 3.8.1 does it.
Between the marks stands what a user writes.
"""

import json
import sys
import time
from pathlib import Path

import numpy as np

if len(sys.argv) < 2:
    print("run by benchmarks/robot_tools.py")
    sys.exit()
folder = Path(sys.argv[1])
task = json.loads((folder / "task.json").read_text())
motions = np.load(folder / "motions.npz")

# what a user writes: begin
import mujoco  # noqa: E402
from mujoco import sysid  # noqa: E402
from scipy.signal import butter, sosfiltfilt  # noqa: E402

JOINTS, RATE = task["joints"], task["rate"]
LOWPASS = butter(4, task["cutoff_hz"], fs=RATE, output="sos")


def smooth(values):
    return sosfiltfilt(LOWPASS, values, axis=0)


def motion(name, every=1):
    q = smooth(motions[f"{name}_q"])
    v = np.gradient(q, 1 / RATE, axis=0)
    return q[::every], v[::every], np.gradient(v, 1 / RATE, axis=0)[::every]


EVERY = task["thinned"]
FITTED = [motion(name, EVERY) for name in task["fitted"]]
TIMES = [1e3 * k + np.arange(len(q)) * EVERY / RATE for k, (q, _, _) in enumerate(FITTED)]  # the start tells which
EDGE = int(task["edge_s"] * RATE / EVERY)
KEPT = slice(EDGE, -EDGE)


def arm():
    urdf = mujoco.MjSpec.from_file(str(folder / "robot.urdf"))
    urdf.compile()
    spec = mujoco.MjSpec.from_string(urdf.to_xml())  # as MJCF: of a URDF's bodies it cannot set inertias
    spec.option.timestep = 1 / RATE
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_LIMIT
    for joint in JOINTS:
        motor = spec.add_actuator(name=joint, target=joint, trntype=mujoco.mjtTrn.mjTRN_JOINT)
        motor.gainprm[0] = 1
        spec.add_sensor(name=f"torque_{joint}", type=mujoco.mjtSensor.mjSENS_JOINTACTFRC,
                        objtype=mujoco.mjtObj.mjOBJ_JOINT, objname=joint)  # fmt: skip
    return spec


def parameters(spec):
    params, model = sysid.ParameterDict(), spec.compile()
    for joint in JOINTS:
        body = model.body(int(model.joint(joint).bodyid[0])).name
        params.add(sysid.body_inertia_param(spec, model, body, inertia_type=sysid.InertiaType.Pseudo))
        for kind, start, most in (("damping", 5.0, 500.0), ("frictionloss", 5.0, 100.0), ("armature", 1.0, 50.0)):

            def modifier(s, p, joint=joint, kind=kind):
                value = float(p.value[0])
                setattr(s.joint(joint), kind, [value, 0, 0] if kind == "damping" else value)

            params.add(sysid.Parameter(f"{joint}_{kind}", start, 1e-3, most, modifier=modifier))
        params.add(sysid.Parameter(f"{joint}_offset", 0.0, -50.0, 50.0))
    return params


def torques(model, params, q, v, a):
    data, made = mujoco.MjData(model), np.empty_like(q)
    for k in range(len(q)):
        data.qpos[:], data.qvel[:], data.qacc[:] = q[k], v[k], a[k]
        mujoco.mj_inverse(model, data)
        made[k] = data.qfrc_inverse
    return made + [params[f"{joint}_offset"].value[0] for joint in JOINTS]


def inverse(models, control_signal, param_dicts, rollout_signal_mapping, **_):
    answers = []
    for model, control, params in zip(models, control_signal, param_dicts, strict=True):
        q, v, a = FITTED[int(control.times[0] // 1e3)]
        t, predicted = control.times[KEPT][1:], torques(model, params, q[KEPT], v[KEPT], a[KEPT])[1:]  # a rollout's
        state = np.column_stack([t, q[KEPT][1:], v[KEPT][1:]])  # first answer is that after its first step
        answers.append(sysid.SystemTrajectory(
            model=model, control=control, initial_state=state[0], state=sysid.TimeSeries(t, state),
            sensordata=sysid.TimeSeries(t, predicted, rollout_signal_mapping),
        ))  # fmt: skip
    return answers


def fit():
    spec = arm()
    model, params = spec.compile(), parameters(spec)
    states, controls, sensors = [], [], []
    for name, t, (q, v, _) in zip(task["fitted"], TIMES, FITTED, strict=True):
        tau = smooth(motions[f"{name}_tau"])[::EVERY]
        states.append(sysid.create_initial_state(model, q[0], v[0]))
        controls.append(sysid.TimeSeries(t, tau))
        sensors.append(sysid.TimeSeries.from_names(t[KEPT], tau[KEPT], model))
    log = sysid.ModelSequences("arm", spec, task["fitted"], states, controls, sensors)
    residual = sysid.build_residual_fn(models_sequences=[log], custom_rollout=inverse, resample_true=False)
    params, _ = sysid.optimize(params, residual, optimizer="mujoco", max_iters=task["iterations"], verbose=False)
    return sysid.apply_param_modifiers(params, spec), params


# what a user writes: end


began = time.process_time()
model, params = fit()
seconds = time.process_time() - began
predicted = {name: torques(model, params, *motion(name)) for name in task["predicted"]}
np.savez(folder / "predicted.npz", seconds=seconds, parameters=params.size, **predicted)
