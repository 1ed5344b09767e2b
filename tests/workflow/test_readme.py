"""The README's example of a mechanism of one's own works as it is printed there."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

from frictionpinn.physics import SYSTEMS

ROOT = Path(__file__).resolve().parents[2]


def blocks(language: str) -> list[str]:
    """Code blocks of the README in a language."""
    return re.findall(rf"```{language}\n(.*?)```", (ROOT / "README.md").read_text(encoding="utf-8"), re.S)


def test_a_system_of_ones_own_is_one_file_one_yaml_and_one_line(tmp_path):
    for name in ("frictionpinn", "conf"):
        # With what is compiled already: the integrator is the same for every mechanism.
        shutil.copytree(ROOT / name, tmp_path / name, ignore=shutil.ignore_patterns("*.pyc*", "*.tmp*"))
    shutil.copy(ROOT / "train.py", tmp_path)
    systems = tmp_path / "frictionpinn" / "physics" / "systems"
    (systems / "tilt.py").write_text(next(text for text in blocks("python") if "class TiltingTable" in text))
    (tmp_path / "conf" / "system" / "tilt.yaml").write_text(blocks("yaml")[0])
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


def test_every_option_that_the_readme_names_exists():
    for group in ("system", "model", "friction", "data", "noise", "smoothing", "optimizer", "experiment"):
        row = re.search(rf"\| `{group}` \| (.*?) \|", (ROOT / "README.md").read_text(encoding="utf-8")).group(1)
        named = set(re.findall(r"`(\w+)`", row))
        present = {path.stem for path in (ROOT / "conf" / group).glob("*.yaml")}
        assert named <= present, group
        assert group != "system" or present - named <= set(SYSTEMS), group


def test_the_example_of_maximum_likelihood_runs_as_printed(capsys):
    exec(next(text for text in blocks("python") if "maximum_likelihood" in text), {})
    shown = capsys.readouterr().out
    assert "maximum_likelihood: converged" in shown and "mu_c" in shown


def test_the_example_of_online_use_runs_as_printed(capsys):
    exec(next(text for text in blocks("python") if "OnlineEstimator" in text), {})
    shown = re.search(r"(\S+) N, (\S+) to (\S+); mu_c (\S+)", capsys.readouterr().out)
    force, low, high, mu_c = (float(number) for number in shown.groups())
    assert low <= force <= high and abs(mu_c / 3.0 - 1) < 0.05


def test_the_example_of_two_contacts_runs_as_printed(capsys):
    space = {}
    for text in (text for text in blocks("python") if "TwoBoxes" in text):
        exec(text, space)
    fitted, truth, shown = space["fitted"], space["truth"], capsys.readouterr().out
    assert fitted.outcome == "converged" and "back.asymmetry" in shown and "least standard errors" in shown
    assert all(fitted.ci95[name][0] < value < fitted.ci95[name][1] for name, value in truth.items())
