"""The commands as one program: help, version, Hydra's own flags, tab completion, starts that fail."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
import torch
from commands import ROOT, call
from documented import block

from frictionpinn import __version__
from frictionpinn.workflow.commands import COMMANDS

PROGRAM = "frictionpinn/__main__.py"


def one_line(process) -> str:
    """The error of a command that was refused, and nothing else."""
    assert process.returncode == 2 and process.stdout == ""
    (line,) = process.stderr.splitlines()
    return line


@pytest.mark.parametrize("name", COMMANDS)
def test_help_fits_a_screen_names_what_there_is_and_is_that_of_the_script(name, tmp_path):
    process = call(PROGRAM, name, "--help", cwd=tmp_path)
    lines = process.stdout.splitlines()
    assert process.returncode == 0 and len(lines) <= 40 and max(map(len, lines)) <= 120
    text = process.stdout
    assert text.count(f"  frictionpinn {name}") >= 1 and "\nexamples" in text and "\noptions" in text
    for group in re.findall(r"^  - (\w+): ", (ROOT / "conf" / f"{name}.yaml").read_text(), re.M):
        shown = re.search(rf"^  {group}=\S+ +(.*(?:\n {{20,}}.*)*)", text, re.M).group(1)
        assert set(re.split(r",\s+", shown)) == {path.stem for path in (ROOT / "conf" / group).glob("*.yaml")}
    script = call(f"{name}.py", "--help", cwd=tmp_path).stdout
    assert script.replace(f"python {name}.py", f"frictionpinn {name}") == text
    assert not (tmp_path / "outputs").exists()


def test_without_a_command_all_are_listed_and_a_wrong_one_is_refused(tmp_path):
    listed = call(PROGRAM, cwd=tmp_path).stdout
    assert all(f"\n  {name} " in listed for name in COMMANDS)
    assert "did you mean 'train'" in one_line(call(PROGRAM, "trian", cwd=tmp_path))


@pytest.mark.parametrize("arguments", [("--version",), ("train", "--version")])
def test_the_version_is_that_of_the_package(arguments, tmp_path):
    assert call(PROGRAM, *arguments, cwd=tmp_path).stdout == f"frictionpinn {__version__}\n"


def test_hydra_shows_a_configuration_and_where_it_looks(tmp_path):
    shown = call("train.py", "model=bb1", "--cfg", "job", "seed=7", cwd=tmp_path).stdout
    assert "\nseed: 7\n" in shown and "name: bb1" in shown
    assert f"file://{ROOT / 'conf'}" in call("train.py", "--info", "searchpath", cwd=tmp_path).stdout
    assert "seed is 'x'" in one_line(call("train.py", "--cfg", "job", "seed=x", cwd=tmp_path))
    assert "--nonsense" in one_line(call("train.py", "--nonsense", cwd=tmp_path))
    assert not (tmp_path / "outputs").exists()


@pytest.mark.parametrize(
    ("line", "offered"),
    [
        ("frictionpinn ", set(COMMANDS)),
        ("frictionpinn train model=", {"model=bb1", "model=bb2", "model=pe1", "model=pe2"}),
        ("frictionpinn evaluate system=p", {"system=pob", "system=pob_hinge", "system=pendulum"}),
        ("frictionpinn trian mod", set()),
    ],
)
def test_tab_completes_commands_and_their_options(line, offered, tmp_path):
    process = call(PROGRAM, "-sc", "query=bash", cwd=tmp_path, COMP_LINE=line, COMP_POINT=str(len(line)))
    assert set(process.stdout.split()) == offered, process.stderr


def test_the_shell_gets_its_function_and_scripts_hold_the_word_by_which_the_shell_completes_them(tmp_path):
    assert "hydra_bash_completion" in call(PROGRAM, "-sc", "install=bash", cwd=tmp_path).stdout
    assert all("@hydra.main" in (ROOT / f"{name}.py").read_text() for name in COMMANDS)


@pytest.mark.parametrize("name", ["evaluate", "diagnose"])
def test_a_bare_path_is_refused_with_the_option_that_takes_it(name, tmp_path):
    (tmp_path / "found").mkdir()
    line = one_line(call(f"{name}.py", "found", cwd=tmp_path))
    assert ("say run=found" if name == "evaluate" else "say data=csv data.path=found") in line


@pytest.mark.skipif(torch.cuda.is_available(), reason="this machine has a GPU")
def test_a_gpu_that_there_is_not_is_told_in_a_line_and_leaves_no_folder(tmp_path):
    process = call("train.py", "trainer.accelerator=gpu", "data.rate_hz=100", cwd=tmp_path)
    assert process.returncode == 2 and "allowed: cpu, auto" in process.stderr
    assert process.stderr.count("\n") == 1 and not list(tmp_path.iterdir())


def test_a_start_that_fails_leaves_other_runs_alone(tmp_path):
    kept = tmp_path / "outputs" / "pob" / "pe2" / "earlier"
    kept.mkdir(parents=True)
    process = call("train.py", "system.parameters.m_b=-1", cwd=tmp_path)
    assert process.returncode == 2 and list(kept.parent.iterdir()) == [kept]


# ---- what users bring themselves


@pytest.fixture
def own(tmp_path) -> Path:
    """A folder with the documentation's system in a file, and its configuration."""
    (tmp_path / "tilt.py").write_text(block("python", "class TiltingTable"))
    (tmp_path / "mine" / "system").mkdir(parents=True)
    (tmp_path / "mine" / "system" / "tilt.yaml").write_text(block("yaml", "name: tilt"))
    return tmp_path


def test_a_system_of_ones_own_is_trained_and_evaluated_without_touching_the_package(own):
    quick = ["trainer.max_epochs=2", "trainer.threads=1", "data.rate_hz=100", "model=bb1", "hydra.run.dir=run"]
    with_own = ["--config-dir", "mine", "system=tilt", "extensions=[tilt.py]"]
    trained = call(PROGRAM, "train", *with_own, *quick, cwd=own)
    assert trained.returncode == 0, trained.stderr
    (own / "elsewhere").mkdir()
    fast = ["identify=false", "simulators=[]", "grid=5"]
    done = call(PROGRAM, "evaluate", f"run={own / 'run'}", *fast, cwd=own / "elsewhere")
    assert done.returncode == 0, done.stderr
    assert "system is tilt" in one_line(call(PROGRAM, "train", "system=tilt", cwd=own))


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (None, "no such file: extensions is .*tilt.py; name a"),
        ("x = (", "cannot be imported: extensions is .*tilt.py; SyntaxError"),
        ("x = 1", "no system, friction law or effect: .*tilt.py"),
        ("from frictionpinn.physics import Effect\nclass A(Effect):\n    name = 'drag'", "name that is taken: .*drag"),
    ],
)
def test_a_bad_extension_is_refused_in_a_line(tmp_path, content, said):
    if content is not None:
        (tmp_path / "tilt.py").write_text(content)
    line = one_line(call(PROGRAM, "train", "extensions=[tilt.py]", cwd=tmp_path))
    assert re.search(said, line) and "Traceback" not in line


def test_an_installed_package_brings_its_effects_by_an_entry_point(tmp_path):
    (tmp_path / "stiction.py").write_text(
        "from frictionpinn.physics import Effect\n\nclass Glue(Effect):\n    name = 'glue'\n"
    )
    (tmp_path / "stiction-1.dist-info").mkdir()
    (tmp_path / "stiction-1.dist-info" / "METADATA").write_text("Name: stiction\nVersion: 1\n")
    (tmp_path / "stiction-1.dist-info" / "entry_points.txt").write_text("[frictionpinn]\nglue = stiction\n")
    path = os.pathsep.join([str(ROOT), str(tmp_path)])  # of an interpreter that has not loaded the package yet
    command = [sys.executable, str(ROOT / "diagnose.py"), "data=simulated", "diagnose.effects=[gleu]"]
    process = subprocess.run(
        command, cwd=tmp_path, env=os.environ | {"PYTHONPATH": path}, capture_output=True, text=True
    )
    assert "did you mean 'glue'" in process.stderr
