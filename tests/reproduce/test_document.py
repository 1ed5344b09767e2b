"""The document: every number of it comes from the result files, and claims are decided by them."""

from __future__ import annotations

import copy
import json
import re
from pathlib import Path

import pytest

from frictionpinn.evaluate.published import published
from frictionpinn.reproduce.claims import FAILS, HOLDS, claims
from frictionpinn.reproduce.document import PARTS, SECTIONS, document, number, spread

DOCS = Path(__file__).resolve().parents[2] / "docs"


@pytest.fixture(scope="module")
def committed() -> dict[str, dict]:
    return {path.stem: json.loads(path.read_text()) for path in (DOCS / "paper").glob("*.json")}


def test_the_committed_document_is_what_its_result_files_say():
    assert (DOCS / "paper.md").read_text(encoding="utf-8") == document(DOCS / "paper")


def test_every_part_was_run_and_every_figure_is_there(committed):
    assert set(committed) == set(PARTS) == set(SECTIONS)
    figures = re.findall(r"!\[[^\]]+\]\(paper/([\w.]+)\)", (DOCS / "paper.md").read_text(encoding="utf-8"))
    assert len(figures) >= 6 and all((DOCS / "paper" / name).stat().st_size > 10_000 for name in figures)


def test_a_changed_result_changes_the_document(committed, tmp_path):
    changed = copy.deepcopy(committed["fidelity"])
    cell = changed["errors"]["Traj. 1"]["pe1"]["in_simulation"]
    cell["value"], cell["by_seed"] = 123.4, dict.fromkeys(cell["by_seed"], 123.4)
    for name, result in (committed | {"fidelity": changed}).items():
        (tmp_path / f"{name}.json").write_text(json.dumps(result))
    made = document(tmp_path)
    assert "123" in next(line for line in made.splitlines() if line.startswith("| PE1 |"))
    claim = "In simulation PE1 is better than BB1"
    assert claim in made and f"| {claim} | {HOLDS} |" not in made


def test_parts_that_are_missing_are_named(committed, tmp_path):
    (tmp_path / "transfer.json").write_text(json.dumps(committed["transfer"]))
    made = document(tmp_path)
    assert "Not run yet: fidelity, equations, identification, ablation." in made and "## Transfer" in made


def test_the_published_figures_stand_beside_ours():
    made = document(DOCS / "paper")
    for values in published()["force_mse"]["Traj. 2"].values():
        assert all(number(value) in made for value in values.values())
    assert number(published()["identification"]["pe1"]["minutes"]) in made


def test_a_median_is_told_with_its_range_and_its_failures():
    assert spread({"value": 2.0, "by_seed": {"0": 1.0, "1": 2.0, "2": 3.0, "3": None}, "failed": 1}) == (
        "2 [1, 3] (1 failed)"
    )
    assert spread(None) == "-" and number(None) == "-" and number(0.00123456) == "0.00123"


@pytest.mark.parametrize(("ratio", "verdict"), [(1.4, HOLDS), (1.6, FAILS)])
def test_a_claim_is_decided_by_its_figure(ratio, verdict):
    found = {"transfer": {"ratios": {"pe1": {"pob > sdob": {"in_simulation": ratio, "online": None}}}}}
    ((_, told, measured),) = claims(found)
    assert told == verdict and f"{ratio:.3g}" in measured
