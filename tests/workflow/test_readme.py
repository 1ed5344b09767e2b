"""What the README and the documentation print works as it is printed there."""

import os
import re
import shutil
import subprocess
import sys

from documented import PAGES, ROOT, block, blocks

from frictionpinn.physics import SYSTEMS


def test_a_system_of_ones_own_is_one_file_one_yaml_and_one_line(tmp_path):
    for name in ("frictionpinn", "conf"):
        # With what is compiled already: the integrator is the same for every mechanism.
        shutil.copytree(ROOT / name, tmp_path / name, ignore=shutil.ignore_patterns("*.pyc*", "*.tmp*"))
    shutil.copy(ROOT / "train.py", tmp_path)
    systems = tmp_path / "frictionpinn" / "physics" / "systems"
    (systems / "tilt.py").write_text(block("python", "class TiltingTable"))
    (tmp_path / "conf" / "system" / "tilt.yaml").write_text(block("yaml", "name: tilt"))
    listing = (systems / "__init__.py").read_text()
    listing = listing.replace("from .sdob", "from .tilt import TiltingTable\nfrom .sdob").replace(
        "Damper)}", "Damper, TiltingTable)}"
    )
    (systems / "__init__.py").write_text(listing)
    command = [sys.executable, "train.py", "model=pe2", "system=tilt", "trainer.max_epochs=2", "hydra.run.dir=run"]
    done = subprocess.run(
        command,
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=300,
        env={**os.environ, "PYTHONPATH": str(tmp_path)},
    )
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "run" / "result.json").is_file()
    assert "mu_c" in done.stdout


def test_every_option_that_the_documentation_names_exists():
    for group in ("system", "model", "friction", "data", "noise", "smoothing", "optimizer", "experiment"):
        row = re.search(rf"\| `{group}` \| (.*?) \|", PAGES["docs/guide/training.md"]).group(1)
        named = set(re.findall(r"`(\w+)`", row))
        present = {path.stem for path in (ROOT / "conf" / group).glob("*.yaml")}
        assert named <= present, group
        assert group != "system" or present - named <= set(SYSTEMS), group


def test_the_example_of_maximum_likelihood_runs_as_printed(capsys):
    exec(block("python", "print(estimate)"), {})
    shown = capsys.readouterr().out
    assert "maximum_likelihood: converged" in shown and "mu_c" in shown


def test_the_example_of_online_use_runs_as_printed(capsys):
    exec(block("python", "OnlineEstimator"), {})
    shown = re.search(r"(\S+) N, (\S+) to (\S+); mu_c (\S+)", capsys.readouterr().out)
    force, low, high, mu_c = (float(number) for number in shown.groups())
    assert low <= force <= high and abs(mu_c / 3.0 - 1) < 0.05


def test_the_example_of_online_use_with_two_contacts_runs_as_printed(capsys):
    exec(block("python", 'reading.at("load")'), {})
    shown = re.search(r"(\S+) N m, (\S+) to (\S+)", capsys.readouterr().out)
    force, low, high = (float(number) for number in shown.groups())
    assert low <= force <= high and abs(force / -0.4022 - 1) < 0.02


def test_the_example_of_two_contacts_runs_as_printed(capsys):
    space = {}
    for text in blocks("python", "TwoBoxes"):
        exec(text, space)
    fitted, truth, shown = space["fitted"], space["truth"], capsys.readouterr().out
    assert fitted.outcome == "converged" and "back.asymmetry" in shown and "least standard errors" in shown
    assert all(fitted.ci95[name][0] < value < fitted.ci95[name][1] for name, value in truth.items())
