"""Models that are trained, evaluated and handed on: each has a folder, as those of the commands."""

from __future__ import annotations

import os
import re
import shutil
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..data.recording import Recording
from ..errors import Interrupted, UserError
from ..physics import extensions
from ..physics.mechanism import Mechanism
from ..progress import clock
from ..show import Shown, Table, estimated, folder_at, interval, readable_unit
from ..workflow import evaluate as evaluation
from ..workflow import export as handing_on
from ..workflow.configs import CONF, Configs, quote, with_extensions, written
from ..workflow.contact_options import options_of
from ..workflow.manifest import check_free
from ..workflow.options import composed
from ..workflow.train import train as run_training
from .arguments import mechanism_given, names_given, recording_given

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, repr=False)
class InFolder(Shown):
    """What stands in a folder: ``result.json`` as ``result``, and figures."""

    folder: Path
    result: dict[str, Any]

    def figures(self) -> dict[str, Figure]:
        """The folder's figures, as they were drawn."""
        return {path.stem: _picture(path) for path in sorted((self.folder / "figures").glob("*.png"))}

    def to_dict(self) -> dict[str, Any]:
        """What stands in ``result.json``."""
        return self.result

    def save(self, folder: str | Path) -> Path:
        """Copy everything to another folder; returns it."""
        return Path(shutil.copytree(self.folder, folder, dirs_exist_ok=True))


@dataclass(frozen=True, repr=False)
class Run(InFolder):
    """A trained model."""

    @property
    def parameters(self) -> dict[str, float]:
        """Name -> value of the law's parameters, SI units; refined ones where they were refined."""
        refined = (self.result.get("refined") or {}).get("parameters", {})
        return {name: entry["value"] for name, entry in (self.result["parameters"] | refined).items()}

    def tables(self) -> list[Table]:
        """Parameters, and the error of the force on trials that the training did not see."""
        error = self.result["force_error"]
        unit = readable_unit(error["unit"]["rmse"])
        models = (("model", self.result["model"]), ("coulomb_viscous", "Coulomb + viscous fit"))
        rows = [(text, error[key]["rmse"], f"{100 * error[key]['relative']:.3g} %") for key, text in models]
        title = f"{self.result['model']} on {self.result['system']}, in {self.folder}"
        found = [Table((f"force error on {error['on']}", f"rms ({unit})", "of the force"), tuple(rows), title)]
        if self.result["parameters"]:
            refined = (self.result.get("refined") or {}).get("parameters", {})
            cells = []
            for name, entry in self.result["parameters"].items():
                better = refined.get(name, {})
                value, ends = better.get("value", entry["value"]), better.get("ci95", (None, None))
                told = (estimated(value, ends), readable_unit(entry["unit"]), interval(ends))
                cells.append((name, *told, entry["start"], entry.get("truth")))
            columns = ("parameter", "value", "unit", "95 % interval", "start", "truth")
            found.append(Table(columns, tuple(cells)))
        return found


@dataclass(frozen=True, repr=False)
class Evaluation(InFolder):
    """A trained model beside its yardsticks, online and in simulation; ``report`` is its page."""

    @property
    def report(self) -> Path:
        """The self-contained page."""
        return self.folder / "report.html"

    def tables(self) -> list[Table]:
        """Mean square errors of the force, a table for each trajectory."""
        return [
            Table(("method", "online", "in simulation", "unit"), tuple(_row(*item) for item in methods.items()), name)
            for name, methods in self.result["errors"].items()
        ]


def _row(method: str, entry: Mapping[str, Any]) -> tuple[object, ...]:
    told = [entry.get(kind, {}).get("force_mse") for kind in ("online", "in_simulation")]
    unit = next((item["unit"] for item in told if item), "")
    return (entry.get("label", method), *(item["value"] if item else None for item in told), readable_unit(unit))


def train(
    mechanism: Mechanism | None = None,
    recording: Recording | None = None,
    *,
    model: str = "pe2",
    folder: str | Path | None = None,
    config_dir: str | Path | None = None,
    check: str = "refuse",
    **options: Any,
) -> Run:
    """Train a friction model through the equation of motion.

    Args:
        mechanism: system and friction law; None: as configured (``system="pob"``).
        recording: what was measured; None: simulated as configured.
        model: "bb1", "bb2" the force itself; "pe1", "pe2" bristle state and the law's parameters.
        folder: of the run; None: under outputs/, as the command.
        config_dir: a folder of your own with further configurations.
        check: "refuse" a recording that :func:`frictionpinn.check` finds wrong, or "warn" and go on.
        options: as on the command line: ``seed=1``, ``noise="none"``, ``trainer={"max_epochs": 300}``, ``refine=True``,
            ``data={"held_out": ["3"]}``; a key with dots as ``**{"model.network.width": 64}``.

    Returns:
        Parameters, SI units, and the error of the friction force, N or N m, on trials that the training did not see.

    Raises:
        UserError: what the command would refuse, in the same line.

    Examples:
        >>> import frictionpinn as fp
        >>> model = fp.mechanism("drive", "lugre")
        >>> truth = {"sigma_0": 2e4, "sigma_1": 150.0, "sigma_2": 2.0, "mu_c": 3.0, "mu_s": 4.0, "v_s": 5e-3}
        >>> trials = [{"duration": 1.0, "force": f"{size}*sin(2*pi*t)"} for size in (6, 8)]
        >>> log = fp.simulate(model, truth, trials, rate_hz=100, noise=0.02)
        >>> run = fp.train(model, log, model="pe1", trainer={"max_epochs": 2})
        >>> sorted(run.parameters)
        ['alpha', 'mu_c', 'mu_s', 'sigma_0', 'sigma_1', 'sigma_2', 'v_s']
    """
    extensions.load(options.get("extensions", ()))
    overrides = [f"model={model}", *_overrides(options)]
    if mechanism is not None:
        _said_once(overrides)
    if mechanism is not None or recording is not None:
        overrides = [*_declared(mechanism_given(mechanism)), *overrides]
    if recording is not None:
        recording = recording_given(recording)
        overrides = ["data=csv", "data.path=recording", f"data.check={check}", *overrides]
    cfg = with_extensions(composed("train", overrides, config_dir))
    folder = _folder(folder) if folder is not None else _new_folder(overrides, config_dir)
    folder_at(folder)
    check_free(folder, cfg.get("ckpt_path"))  # before a recording takes the place of a finished run's
    if recording is not None:  # the run's evaluations read it again
        cfg["data"]["path"] = str(recording.save(folder / "recording.parquet").absolute())
    try:
        return Run(folder, run_training(cfg, folder))
    except Interrupted as stop:
        raise KeyboardInterrupt(str(stop)) from None


def evaluate(run: Run | str | Path, *, system: str | None = None, **options: Any) -> Evaluation:
    """Evaluate a trained model online and in simulation, beside fitted friction laws and observers.

    Args:
        run: from :func:`train`, or the folder of a training.
        system: another system, for runs on simulated data.
        options: as in conf/evaluate.yaml: ``seeds``, ``identify``, ``simulators``, ``grid``, ...

    Returns:
        Mean square errors of the force, N^2 or (N m)^2, by trajectory and method; figures and a page in its folder.

    Raises:
        UserError: a folder that is no run; options that there are not.

    Examples:
        >>> import frictionpinn as fp
        >>> model = fp.mechanism("drive", "lugre")
        >>> truth = {"sigma_0": 2e4, "sigma_1": 150.0, "sigma_2": 2.0, "mu_c": 3.0, "mu_s": 4.0, "v_s": 5e-3}
        >>> trials = [{"duration": 1.0, "force": f"{size}*sin(2*pi*t)"} for size in (6, 8)]
        >>> log = fp.simulate(model, truth, trials, rate_hz=100, noise=0.02)
        >>> run = fp.train(model, log, model="bb1", trainer={"max_epochs": 2})
        >>> fp.evaluate(run, identify=False, grid=5).report.name
        'report.html'
    """
    chosen = [] if system is None else [f"system={system}"]
    cfg = composed("evaluate", [f"run={quote(_folder(run))}", *chosen, *_overrides(options)])
    extensions.load(cfg["extensions"])
    with clock():
        result = evaluation.evaluate(cfg)
    other = result["system"] != result["trained_on"]
    return Evaluation(_folder(run) / (f"evaluation_{result['system']}" if other else "evaluation"), result)


def export(run: Run | str | Path, form: str | Iterable[str] = "c") -> dict[str, Path]:
    """Hand the model of a run on: files that need neither this package nor torch.

    Args:
        run: from :func:`train`, or the folder of a training.
        form: "onnx", "c", "mujoco", or several of them.

    Returns:
        Form -> the folder with its files.

    Raises:
        UserError: an unknown form, an extra that is not installed, a folder that is no run.

    Examples:
        >>> import frictionpinn as fp
        >>> quick = {"rate_hz": 100}
        >>> run = fp.train(model="bb1", system="drive", data=quick, trainer={"max_epochs": 1})
        >>> sorted(path.name for path in fp.export(run, "c")["c"].iterdir())
        ['export.json', 'friction.c', 'friction.h', 'simulate.c']
    """
    forms = [form] if isinstance(form, str) else names_given(form, "form")
    handing_on.export(composed("evaluate", [f"run={quote(_folder(run))}", f"export={written(forms)}"]))
    return {name: _folder(run) / "export" / name for name in forms}


def _folder(run: Run | str | Path) -> Path:
    if not isinstance(run, Run | str | Path):
        raise UserError("no run", where="run", received=repr(run), allowed="what fp.train returns, or its folder")
    return run.folder if isinstance(run, Run) else Path(run)


def _overrides(options: Mapping[str, Any]) -> list[str]:
    """Options as the command line has them; a table gives options of its section."""
    told = []
    for key, value in options.items():
        table = {f"{key}.{name}": item for name, item in value.items()} if isinstance(value, Mapping) else {key: value}
        told += [f"{name}={os.fspath(v) if isinstance(v, Path) else written(v)}" for name, v in table.items()]
    return told


def _declared(mechanism: Mechanism) -> list[str]:
    if mechanism.effects:
        raise UserError("a training learns the law, not effects", where="mechanism", received=mechanism.name,
                        allowed="a system and a friction law", fix="diagnose(...).save(folder), then train on "
                        "its augmented.yaml: frictionpinn train friction=folder/augmented.yaml")  # fmt: skip
    system = mechanism.system
    values = [f"system.parameters.{name}={value!r}" for name, value in system.values.items()]
    imposed = ["++system.imposed=true"] if system.imposed else []
    driven = [f"system.driven={list(system.driven)}"] if system.driven != type(system).driven else []
    return [f"system={system.name}", *options_of(mechanism.law), f"system.equations={system.equations}",
            *values, *imposed, *driven]  # fmt: skip


def _said_once(overrides: Iterable[str]) -> None:
    """Raise :class:`UserError` for an option that says of system and law something else than the mechanism."""
    said = re.compile(r"(friction|system|system\.(parameters|equations|imposed|driven)(\.\w+)?)=")
    for override in overrides:
        if found := said.match(override):
            raise UserError("system and law are those of the mechanism", where=found[0][:-1],
                            received=override[found.end() :], allowed="left out beside a mechanism",
                            fix="make the mechanism so, fp.mechanism(system, law)")  # fmt: skip


def _new_folder(overrides: list[str], config_dir: str | Path | None) -> Path:
    with Configs(CONF, "train", config_dir).opened() as configs:
        return Path(str(configs.compose(overrides, hydra=True).hydra.run.dir))


def _picture(path: Path) -> Figure:
    """A PNG file as a figure of the same size."""
    from matplotlib.figure import Figure
    from matplotlib.image import imread

    pixels = imread(path)
    figure = Figure(figsize=(pixels.shape[1] / 100, pixels.shape[0] / 100))
    axes = figure.add_axes((0, 0, 1, 1))
    axes.imshow(pixels, aspect="auto", interpolation="none")
    axes.set_axis_off()
    return figure
