"""An interrupted training goes on from its last checkpoint; checkpoints of anything else are refused."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest
import torch

from frictionpinn.errors import UserError
from frictionpinn.workflow.callbacks import Scalars

EVERY = "trainer.checkpoint_every_n_epochs=10"


@pytest.fixture
def interrupted(quick, tmp_path, monkeypatch):
    """Train until the user presses Ctrl-C in epoch 15; the path of last.ckpt, written after epoch 10."""

    def run(*overrides: str, epochs: int) -> Path:
        write = Scalars.on_train_batch_end

        def press(self, trainer, *arguments):
            if trainer.current_epoch == 14:
                raise KeyboardInterrupt
            write(self, trainer, *arguments)

        with monkeypatch.context() as patch:
            patch.setattr(Scalars, "on_train_batch_end", press)
            with pytest.raises((KeyboardInterrupt, SystemExit)):
                quick(tmp_path / "first", *overrides, EVERY, epochs=epochs)
        assert not (tmp_path / "first" / "result.json").exists()
        return tmp_path / "first" / "checkpoints" / "last.ckpt"

    return run


@pytest.mark.parametrize("optimizer", ["adam", "adam_plateau", "adam_lbfgs", "adam_onecycle"])
def test_resumed_training_ends_like_an_uninterrupted_one(quick, interrupted, tmp_path, optimizer):
    options = ["model=pe2", f"optimizer={optimizer}", EVERY]
    last = interrupted(*options[:2], epochs=30)
    assert torch.load(last, weights_only=True)["epoch"] == 9
    resumed = quick(tmp_path / "second", *options, f"ckpt_path={last}", epochs=30)
    whole = quick(tmp_path / "whole", *options, epochs=30)
    assert resumed["training"]["epochs"] == whole["training"]["epochs"] == 30
    for name, entry in whole["parameters"].items():
        assert resumed["parameters"][name]["value"] == pytest.approx(entry["value"], rel=1e-4), name
        assert resumed["parameters"][name]["start"] == entry["start"]
    assert resumed["force_error"]["model"]["mse"] == pytest.approx(whole["force_error"]["model"]["mse"], rel=1e-3)


@pytest.mark.parametrize("optimizer", ["adam", "adam_onecycle"])
def test_a_finished_training_can_be_prolonged(quick, tmp_path, optimizer):
    options = ["model=pe1", f"optimizer={optimizer}", EVERY]
    first = quick(tmp_path / "first", *options, epochs=20)
    last = tmp_path / "first" / "checkpoints" / "last.ckpt"
    more = quick(tmp_path / "second", *options, f"ckpt_path={last}", epochs=40)
    assert more["training"]["epochs"] == 40
    assert more["training"]["loss"]["loss"] < first["training"]["loss"]["loss"]
    assert (tmp_path / "second" / "checkpoints" / "last.ckpt").is_file()
    assert json.loads((tmp_path / "second" / "result.json").read_text())["config"]["ckpt_path"] == str(last)


def test_resuming_does_not_need_the_folder_of_the_first_run(quick, tmp_path):
    quick(tmp_path / "first", "model=bb1", EVERY, epochs=10)
    moved = shutil.move(tmp_path / "first" / "checkpoints" / "last.ckpt", tmp_path / "moved.ckpt")
    shutil.rmtree(tmp_path / "first")
    result = quick(tmp_path / "second", "model=bb1", EVERY, f"ckpt_path={moved}", epochs=20)
    assert result["training"]["epochs"] == 20 and result["force_error"]["model"]["rmse"] > 0


def test_nothing_left_to_train_is_said_in_one_line(quick, tmp_path):
    quick(tmp_path / "first", "model=bb1", epochs=4)
    last = tmp_path / "first" / "checkpoints" / "last.ckpt"
    with pytest.raises(UserError, match=r"nothing left to train: trainer.max_epochs is 4; allowed: more than 4"):
        quick(tmp_path / "second", "model=bb1", f"ckpt_path={last}", epochs=4)


@pytest.fixture(scope="module")
def last(quick, tmp_path_factory) -> Path:
    """The last checkpoint of a short pe2 on the pendulum-on-a-box."""
    folder = tmp_path_factory.mktemp("trained")
    quick(folder, "model=pe2", "optimizer=adam")
    return folder / "checkpoints" / "last.ckpt"


@pytest.mark.parametrize(
    ("overrides", "message"),
    [
        (["model=bb2"], "checkpoint of another model: ckpt_path is name = pe2; allowed: name = bb2; .*model=pe2"),
        (["model=pe1"], "another model: ckpt_path is name = pe2; allowed: name = pe1"),
        (
            ["model=pe2", "model.network.width=8"],
            "another model: ckpt_path is network.width = 16; allowed: network.width = 8",
        ),
        (
            ["model=pe2", "friction=dahl"],
            "another model: ckpt_path is friction.name = lugre; allowed: friction.name = dahl",
        ),
        (
            ["model=pe2", "system=drive", "data.trials=[{duration: 1.0, force: 4*t}]"],
            "another model: ckpt_path is system = pob; allowed: system = drive",
        ),
        (["model=pe2", "optimizer=adam_lbfgs"], "ckpt_path is optimizer = adam; allowed: optimizer = adam_lbfgs"),
    ],
    ids=["black box", "other inputs", "other network", "other law", "other system", "other optimizer"],
)
def test_a_checkpoint_of_something_else_is_refused(quick, last, tmp_path, overrides, message):
    held = ["data.held_out=[]"] if "system=drive" in overrides else []
    options = ["optimizer=adam", *overrides, *held, f"ckpt_path={last}"]
    if "optimizer=adam_lbfgs" in overrides:
        options.remove("optimizer=adam")
    with pytest.raises(UserError, match=message) as caught:
        quick(tmp_path, *options, epochs=5)
    assert "\n" not in str(caught.value)


class Bomb:
    """Unpickling it would write a file."""

    def __init__(self, target: Path):
        self.target = target

    def __reduce__(self):
        return (Path.write_text, (self.target, "executed"))


def test_a_checkpoint_with_code_in_it_is_refused_and_never_run(quick, tmp_path):
    target, path = tmp_path / "executed", tmp_path / "bomb.ckpt"
    torch.save({"state_dict": {}, "hyper_parameters": {"name": "bb1"}, "epoch": Bomb(target)}, path)
    with pytest.raises(UserError, match=r"unreadable checkpoint: ckpt_path is .*bomb.ckpt; allowed: .*train.py"):
        quick(tmp_path / "run", "model=bb1", f"ckpt_path={path}")
    assert not target.exists()


def test_truncated_missing_and_foreign_checkpoints_are_refused(quick, last, tmp_path):
    cut = tmp_path / "cut.ckpt"
    cut.write_bytes(last.read_bytes()[: last.stat().st_size // 2])
    foreign = tmp_path / "foreign.ckpt"
    torch.save({"epoch": 3}, foreign)
    empty = tmp_path / "empty.ckpt"
    empty.touch()
    cases = {cut: "unreadable checkpoint", empty: "unreadable checkpoint", foreign: "not a checkpoint of frictionpinn"}
    cases[tmp_path / "fotreign.ckpt"] = "no such checkpoint: .*did you mean '.*foreign.ckpt'"
    for path, message in cases.items():
        with pytest.raises(UserError, match=message) as caught:
            quick(tmp_path / "run", "model=pe2", f"ckpt_path={path}")
        assert "\n" not in str(caught.value)
