"""An installed package, away from the repository: what the README shows for Python and for the terminal."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import sysconfig
from pathlib import Path

import pytest
from documented import ROOT, block

import frictionpinn as fp

SOURCES = ("frictionpinn", "hydra_plugins", "conf", "pyproject.toml", "setup.py", "README.md", "LICENSE")
SIGNALS = {"mu_c": 3.0, "sigma_2": 2.0, "constant_force": 0.5}


@pytest.fixture(scope="module")
def installed(tmp_path_factory) -> Path:
    """The folder of the programs of a fresh environment, in which a wheel was installed; what it needs is shared."""
    folder = tmp_path_factory.mktemp("wheel")
    (folder / "source").mkdir()
    for name in SOURCES:
        copy = shutil.copytree if (ROOT / name).is_dir() else shutil.copy
        copy(ROOT / name, folder / "source" / name)
    pip = [sys.executable, "-m", "pip", "--disable-pip-version-check"]
    if subprocess.run([*pip, "--version"], capture_output=True).returncode:
        pytest.skip("no pip here to build a wheel with")
    build = [*pip, "wheel", "-q", "--no-build-isolation", "--no-deps", "--no-index", "-w", "dist", "./source"]
    subprocess.run(build, cwd=folder, check=True, env=clean())
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", "fresh"], cwd=folder, check=True)
    (wheel,) = (folder / "dist").glob("*.whl")
    programs = folder / "fresh" / "bin"
    told = [*pip, "--python", str(programs / "python"), "install", "-q", "--no-deps", "--no-index", str(wheel)]
    subprocess.run(told, cwd=folder, check=True, env=clean())
    (own,) = (folder / "fresh" / "lib").glob("python*/site-packages")
    (own / "shared.pth").write_text(sysconfig.get_paths()["purelib"] + "\n")
    share_compiled(own / "frictionpinn")
    return programs


def share_compiled(package: Path) -> None:
    """Give an installed package what numba compiled of the same files here, which is half of what its tests took."""
    for path in package.rglob("*.py"):
        ours = ROOT / "frictionpinn" / path.relative_to(package)
        if ours.is_file() and ours.read_bytes() == path.read_bytes():
            os.utime(path, ns=(ours.stat().st_atime_ns, ours.stat().st_mtime_ns))  # by which numba knows a file
            for compiled in (ours.parent / "__pycache__").glob(f"{ours.stem}.*.nb[ic]"):
                path.parent.joinpath("__pycache__").mkdir(exist_ok=True)
                shutil.copy2(compiled, path.parent / "__pycache__" / compiled.name)


def clean() -> dict[str, str]:
    """The environment without the paths by which the repository would be found."""
    return {key: value for key, value in os.environ.items() if not key.startswith(("PYTHON", "HYDRA"))}


@pytest.fixture
def empty(tmp_path) -> Path:
    """A folder that holds a log alone: a drive that a constant force pulls aside."""
    truth = fp.mechanism(fp.system("drive", M=2.0), "coulomb_viscous", ["constant_force"])
    trials = [{"duration": 1.0, "force": f"{size}*sin({rate}*pi*t)"} for size, rate in ((8, 2), (9, 3), (7, 2.5))]
    log = fp.simulate(truth, SIGNALS, trials, rate_hz=200, noise=0.01)
    log.save(tmp_path / "run.csv")
    return tmp_path


def test_twelve_lines_of_python_read_check_fit_diagnose_and_plot_a_log(installed, empty):
    code = block("python", "missing.save(")
    assert len([line for line in code.splitlines() if line.strip()]) <= 12
    done = subprocess.run([installed / "python", "-c", code], cwd=empty, env=clean(), capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert "maximum_likelihood: " in done.stdout and "effect found: Missing: constant_force" in done.stdout
    assert (empty / "fit.png").read_bytes().startswith(b"\x89PNG")
    result = json.loads((empty / "missing" / "result.json").read_text())
    low, high = result["effects"][0]["parameters"]["constant_force"]["ci95"]
    assert low < SIGNALS["constant_force"] < high
    found = subprocess.run(
        [installed / "python", "-c", "import frictionpinn; print(frictionpinn.__file__)"],
        cwd=empty, env=clean(), capture_output=True, text=True,
    )  # fmt: skip
    assert str(ROOT) not in found.stdout and str(installed.parent) in found.stdout


def test_the_console_commands_do_the_same(installed, empty):
    for line in block("bash", "frictionpinn identify").replace("\\\n", " ").splitlines():
        done = subprocess.run(
            line, shell=True, cwd=empty, capture_output=True, text=True,
            env=clean() | {"PATH": f"{installed}{os.pathsep}{os.environ['PATH']}"},
        )  # fmt: skip
        assert done.returncode == 0, f"{line}: {done.stderr}"
    (diagnosis,) = empty.glob("outputs/drive/diagnosis/*/result.json")
    assert [effect["name"] for effect in json.loads(diagnosis.read_text())["effects"]] == ["constant_force"]
    (identified,) = empty.glob("outputs/drive/identify/*/result.json")
    (estimate,) = json.loads(identified.read_text())["methods"]["maximum_likelihood"]
    assert estimate["values"]["sigma_2"] == pytest.approx(SIGNALS["sigma_2"], rel=0.2)


def test_a_wheel_holds_configurations_types_and_licence_and_no_tests(installed):
    (own,) = (installed.parent / "lib").glob("python*/site-packages")
    shipped = {str(path.relative_to(ROOT)) for path in (ROOT / "conf").rglob("*.yaml")}
    found = {str(path.relative_to(own / "frictionpinn")) for path in (own / "frictionpinn" / "conf").rglob("*.yaml")}
    assert found == shipped and (own / "frictionpinn" / "py.typed").is_file() and not (own / "tests").exists()
    assert any(own.glob("frictionpinn-*.dist-info/licenses/LICENSE"))
