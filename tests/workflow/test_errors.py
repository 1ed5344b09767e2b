"""Mistakes of a user end with one line: what, where, the value received, what is allowed, what to do next."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from frictionpinn.errors import UserError
from frictionpinn.workflow.build import build_system
from frictionpinn.workflow.cli import check_command_line

CONF = Path(__file__).resolve().parents[2] / "conf"


def refused(check, folder, message, *overrides):
    """The training is refused with one line that matches."""
    with pytest.raises(UserError, match=message) as caught:
        check(folder, *overrides)
    assert "\n" not in str(caught.value) and len(str(caught.value)) < 600


def put(column, rows, value):
    """A change of the table: a value in some rows of a column."""

    def change(table):
        table.loc[rows, column] = value

    return change


TABLES = {
    "NaN": (
        put("v", 17, np.nan),
        r"missing value: .*run.csv, column 'v', data row 18 is empty or NaN; allowed: finite",
    ),
    "infinity": (put("a", 3, np.inf), r"infinite value: .*column 'a', data row 4"),
    "text": (lambda table: table.astype({"x": object}).assign(x=["lost", *table.x[1:]]), r"column 'x'.*lost"),
    "time goes backwards": (put("t", 30, 0.01), r"time goes backwards at row 31: .*0.01 s after .*strictly increasing"),
    "time repeats": (lambda table: table.assign(t=table.t.round(1)), r"time repeats at row .*more digits"),
    "short trial": (
        lambda table: table[(table.trial == 1) | (table.t < 0.02)],
        r"too few samples: .*trial '2' is \d samples long; allowed: at least 10; record longer",
    ),
    "constant signal": (put("v", slice(None), 0.2), r"signal never changes: .*signal 'v' is 0.2 in every row"),
    "no rows": (lambda table: table[:0], r"empty"),
    "no slip coordinate": (lambda table: table.drop(columns=["x", "v", "a"]), r"no signal of coordinate x .*x, v, a"),
}


@pytest.mark.parametrize("case", TABLES)
def test_a_bad_recording_is_refused(check, csv, tmp_path, case):
    change, message = TABLES[case]
    refused(check, tmp_path, message, "data=csv", f"data.path={csv(change)}")


COLUMNS = {
    "unknown column": (
        "data.columns={t: t, x: xpos, theta: theta}",
        r"unknown column: columns.x in .* is 'xpos'; allowed: trial, t, x",
    ),
    "near column": ("data.columns={t: t, x: x, theta: thetta}", r"columns.theta.*did you mean 'theta'"),
    "unknown signal": ("data.columns={t: t, x: x, thetta: theta}", r"data.columns is 'thetta'.*did you mean 'theta'"),
    "unknown unit": (
        "data.units={default: SI, x: millimetr}",
        r"unknown unit: units.x is 'millimetr'; allowed: m, .*did you mean",
    ),
    "wrong dimension": ("data.units={default: SI, x: kg}", r"wrong dimension: .*units.x is 'kg'; allowed: m, cm, mm"),
    "missing unit": (
        "data.units={t: s, x: m, v: m/s}",
        r"missing unit: units.a; allowed: the unit of its column",
    ),
    "unit of no signal": ("data.units={xx: mm}", r"unknown signal: units is 'xx'"),
    "unknown held-out trial": ("data.held_out=[3]", r"no such trial: data.held_out is 3; allowed: 1, 2"),
    "all held out": ("data.held_out=[1, 2]", r"splits overlap or leave nothing to train on"),
    "trial in two splits": ("data.validation=[2]", r"splits overlap"),
}


@pytest.mark.parametrize("case", COLUMNS)
def test_a_wrong_mapping_is_refused(check, csv, tmp_path, case):
    override, message = COLUMNS[case]
    refused(check, tmp_path, message, "data=csv", f"data.path={csv()}", override)


def test_a_mapping_without_a_time_is_refused_where_the_file_has_no_t(check, csv, tmp_path):
    path = csv(lambda table: table.rename(columns={"t": "clock"}))
    refused(check, tmp_path, r"no time", "data=csv", f"data.path={path}", "data.columns={x: x, theta: theta}")


def test_an_unknown_file_is_refused_with_the_nearest_one(check, csv, tmp_path):
    csv()
    message = r"unknown file: data\.path is .*runn.csv; allowed: in .* are run.csv; did you mean 'run.csv'"
    refused(check, tmp_path, message, "data=csv", f"data.path={tmp_path}/runn.csv")
    refused(check, tmp_path, r"data.path is nothing; allowed: a file, a folder .*; add data.path=", "data=csv")


OPTIONS = {
    "model=pe3": r"unknown option: model is pe3; allowed: bb1, bb2, pe1, pe2; did you mean 'pe\d'",
    "system=pop": r"system is pop; .*did you mean 'pob'",
    "system=belt": r"system is belt; .*one of your own is FOLDER/system/belt.yaml .*extensions=\[FILE.py\]",
    "extensions=belt.py": r"not a list: extensions is 'belt.py'; allowed: a list such as \[belt.py\]",
    "friction=lugree": r"friction is lugree; .*did you mean 'lugre'",
    "optimizer=adan": r"optimizer is adan; .*did you mean 'adam'",
    "noise=gausian": r"noise is gausian; .*did you mean 'gaussian'",
    "smoothing=kalmann": r"smoothing is kalmann; .*did you mean 'kalman'",
    "data=simulate": r"data is simulate; .*did you mean 'simulated'",
    "experiment=papers": r"experiment is papers; .*did you mean 'paper'",
    "preset=emps": r"no option of this command: .*preset.*diagnose",
    "modell=pe1": r"unknown key: .*modell.*did you mean 'model'",
    "model.network.widht=3": r"unknown key: .*model.network.widht; allowed: width.*did you mean 'model.network.width'",
    "trainer.sede=3": r"unknown key: .*trainer.sede; allowed: max_epochs.*see conf/",
    "trainer.seed=3": r"unknown key: .*trainer.seed; .*did you mean 'seed'",
    "trainer.max_epochs=many": r"not a number: trainer.max_epochs is 'many'; allowed: a number such as",
    "model.network.odd=3": r"not a switch: model.network.odd is 3; allowed: true or false",
    "pe1": r"not an option: command line is 'pe1'; allowed: key=value",
    "model.network.width=[1": r"not an override",
    "trainer.checkpoint_every_n_epochs=0": r"impossible interval: trainer.checkpoint_every_n_epochs is 0",
    "trainer.max_epochs=0": r"nothing to train: trainer.max_epochs is 0; allowed: at least 1",
    "trainer.accelerator=abacus": r"trainer refuses its options: .*abacus",
    "seed=-1": r"impossible seed: seed is -1",
    "system.parameters.m_b=-0.5": r"mass.* out of its physical range: system.parameters.m_b is -0.5 kg; allowed: .*kg",
    "system.parameters.m_L=0": r"system.parameters.m_L is 0 kg; allowed: .*not 0",
    "system.equations=lagrang": r"unknown equations: .*did you mean 'lagrange'",
    "system.simulate.truth.mu_s=0.1": r"static below Coulomb friction: .*mu_s is 0.1; allowed: at least mu_c = 0.3",
    "data.truth.mu_s=0.1": r"data.truth.mu_s; allowed: system.simulate.truth.mu_s; data.truth is a copy",
    "system.simulate.truth.mu_c=-0.3": r"Coulomb.*data.truth.mu_c is -0.3; allowed: ",
    "data.friction=dahl": r"unknown parameter of friction law dahl: data.truth.sigma_1",
    "data.rate_hz=0": r"impossible sampling rate: data.rate_hz is 0",
    "friction.start={mu_c: 0.4, mu_s: 0.3}": r"friction.start.mu_s is 0.3; allowed: at least mu_c = 0.4",
    "friction.bounds.mu_c=[0.5,0.1]": r"impossible bounds: friction.bounds.mu_c is \[0.5, 0.1\]",
    "friction.start.mu_c=-1": r"friction.start.mu_c is -1",
    "friction=coulomb": r"needs a friction law with a bristle state: friction is coulomb; .*lugre",
    "data.trials=[{duration: 1.0, theta: 'cos(tt)'}]": r"tt",
    "data.trials=[{duration: 1.0, thetta: 't'}]": r"thetta.*did you mean 'theta'",
    "data.trials=[{duration: 1.0, theta: '85*deg*sin(9*t)'}]": r"contact.*at t = ",
    "model.network.width=0": r"model.network.width is 0; allowed: ",
    "model.network.depth=-1": r"model.network.depth is -1; allowed: ",
    "model.loss.force=normalized": r"model.loss.force is 'normalized'; .*did you mean 'normalised'",
    "model.loss.consistency=relativ": r"model.loss.consistency is 'relativ'; .*did you mean 'relative'",
    "data.steps_per_epoch=0": r"data.steps_per_epoch is 0; allowed: at least 1",
    "model.loss.weight=-1": r"model.loss.weight is -1; allowed: a number above 0",
    "+noise.levle=0.1": r"options that do not fit: noise is .*levle",
    "+smoothing.online.foo=1": r"options that do not fit: smoothing.online is .*foo",
    "model.inputs=[]": r"no inputs: model.inputs is \[\]; allowed: a list of v_slip",
    "model.windows.v_slip=[6, 1]": r"impossible window: model.windows.v_slip is 6; allowed: a list of \[samples",
    "model.windows.v_slip=null": r"no windows: model.windows.v_slip is None; allowed: a list such as",
    "optimizer.lr=null": r"step size must be positive: optimizer.lr is None",
    "friction.start.mu_c=low": r"not a number: friction.start.mu_c is 'low'",
    "friction.bounds.mu_c=[0.1]": r"impossible bounds: friction.bounds.mu_c is \[0.1\]; allowed: \[low, high\]",
    "friction.start=5": r"not a table: friction.start is 5; allowed: a table",
    "data.trials=[3]": r"no trials to simulate: data.trials is \[3\]; allowed: a list of tables",
    "data.held_out=7": r"data.held_out is 7; allowed: (1, 2, 3, 4, 5, 6|a list)",
    "~model": r"cannot be left out: model; allowed: bb1, bb2, pe1, pe2",
    "trainer=null": r"unknown option: trainer is None; allowed: default",
    "noise.level=-0.1": r"noise.*-0.1; allowed",
}


@pytest.mark.parametrize("override", OPTIONS)
def test_a_wrong_option_is_refused(check, tmp_path, override):
    refused(check, tmp_path, OPTIONS[override], override)


def test_a_system_whose_values_are_there_without_its_file_is_told_where_that_goes():
    with pytest.raises(UserError, match=r"system is 'belt'; .*name the file that defines it, extensions=\[FILE.py\]"):
        build_system({"name": "belt", "parameters": {}})


def test_a_public_set_with_another_system_is_refused(check, tmp_path):
    refused(check, tmp_path, r"data of another system: .*allowed: system=drive; add system=drive", "data=emps")


def test_every_value_of_a_sweep_is_checked_before_any_is_trained():
    for wrong, told in {"seed=0,x": "seed is 'x'", "data.trials=[],3": "data.trials is 3"}.items():
        with pytest.raises(UserError, match=told):
            check_command_line(CONF, "train", ["-m", wrong])
    fine = ["model=bb1,pe1", "seed=0,1"]
    fine += ["data.trials=[{duration: 1.0}],[{duration: 2.0}]", "optimizer.lr=1e-3,2", "refine=true,false"]
    check_command_line(CONF, "train", ["-m", *fine])
