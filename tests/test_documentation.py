"""The documentation: links and contents hold, tutorials run, and what its pages compute covers the package."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest
import yaml
from documented import PAGES, ROOT, block

from frictionpinn.physics import EFFECTS, LAWS, SYSTEMS
from frictionpinn.physics.friction import CONTACT_LAWS

TOOLS = ROOT / "docs" / "tools"
sys.path.insert(0, str(TOOLS))

import gallery  # noqa: E402
import notebook  # noqa: E402
import reference  # noqa: E402
from figures import FIGURES  # noqa: E402

TUTORIALS = sorted((ROOT / "docs" / "tutorials").glob("*.md"))
MADE = {"effects.md": {*EFFECTS}, "reference/laws.md": {*LAWS}, "reference/systems.md": {*SYSTEMS}}  # with anchors
MADE |= {page: set() for page in (*reference.PAGES, "changes.md") if page not in MADE}
LINK = re.compile(r"!?\[[^\]]*\]\(([^)\s]+)\)")


def anchors(text: str) -> set[str]:
    """What the headings of a page can be linked by."""
    headings = re.findall(r"^#+ (.*)$", text, re.M)
    return {re.sub(r"[^\w]+", "-", re.sub(r"[^\w\s-]", "", heading.lower())).strip("-") for heading in headings}


@pytest.mark.parametrize("page", PAGES)
def test_every_link_leads_to_something(page):
    prose = re.sub(r"^```.*?^```|`[^`\n]+`", "", PAGES[page], flags=re.S | re.M)
    for link in LINK.findall(prose):
        if link.startswith(("http://", "https://")):
            continue
        name, _, anchor = link.partition("#")
        target = (ROOT / page).parent / name if name else ROOT / page
        inside = str(target.resolve().relative_to(ROOT))
        made = inside.removeprefix("docs/")
        drawn = Path(made).parent.name == "concepts" and Path(made).name in FIGURES
        assert target.exists() or made in MADE or drawn, f"{page}: {link}"
        known = MADE[made] if made in MADE else anchors(PAGES[inside]) if inside in PAGES else set()
        assert not anchor or anchor in known, f"{page}: {link}"


def test_the_contents_name_every_page_and_only_such_that_there_are():
    def files(entries):
        for entry in entries:
            for value in entry.values():
                yield from files(value) if isinstance(value, list) else [value]

    named = list(files(yaml.safe_load((ROOT / "mkdocs.yml").read_text())["nav"]))
    there = {str(path.relative_to(ROOT / "docs")) for path in (ROOT / "docs").rglob("*.md")}
    assert len(named) == len(set(named)) and set(named) == there | set(MADE)


def test_the_site_builds_without_a_warning_and_no_link_is_broken():
    pytest.importorskip("mkdocs", reason='pip install -e ".[docs]"')
    command = [sys.executable, str(TOOLS / "build_site.py"), "--draft"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "WARNING" not in done.stderr and (ROOT / "build" / "draft" / "reference" / "python.html").is_file()


@pytest.mark.parametrize("path", TUTORIALS, ids=lambda path: path.stem)
def test_a_tutorial_runs_shows_figures_and_is_a_notebook(path, tmp_path):
    (tmp_path / "own").mkdir()
    made = notebook.run(path.read_text(encoding="utf-8"), tmp_path / "own")
    shown = [out.kind for cell in made for out in cell.outputs]
    assert "png" in shown and any(cell.kind == "bash" and cell.outputs for cell in made)
    text = notebook.page(made, path.stem, tmp_path / "made")
    assert str(tmp_path) not in text
    assert text.count("](made/") == len(list((tmp_path / "made").glob("*.png"))) == shown.count("png")
    book = json.loads(notebook.as_ipynb(made))
    assert book["nbformat"] == 4 and sum(cell["cell_type"] == "code" for cell in book["cells"]) > 3


def test_cells_share_their_names_and_a_failing_one_is_told(tmp_path):
    text = "# a\n\n```python\n%%writefile b.py\nc = 2\n```\n\n```python\nfrom b import c\nprint(c)\nc + 1\n```\n"
    outputs = [out for cell in notebook.run(text, tmp_path) for out in cell.outputs]
    assert [(out.kind, out.content) for out in outputs] == [("text", "2"), ("text", "3")]
    with pytest.raises(ZeroDivisionError) as caught:
        notebook.run("```python\n1 / 0\n```\n", tmp_path)
    assert "in the cell:\n1 / 0" in caught.value.__notes__
    with pytest.raises(RuntimeError, match="exit 3 of:\nexit 3"):
        notebook.run("```bash\nexit 3\n```\n", tmp_path)


@pytest.mark.parametrize("name", EFFECTS)
def test_every_effect_has_a_place_in_the_gallery_and_says_where_it_occurs(name):
    bed, law, beside = gallery.place_of(name)
    assert EFFECTS[name]().applies(bed.mechanism(law).system, CONTACT_LAWS[law](), beside)
    assert {"equation", "occurs", "experiment"} <= set(EFFECTS[name].said())


@pytest.mark.parametrize("name", ["position_friction", "sensor_delay"])
def test_what_the_gallery_shows_is_what_the_declared_model_leaves(name):
    shown = gallery.at_work(name)
    section = gallery.section(shown)
    assert f"## {name}" in section and "$$" in section and "**Experiment:**" in section
    left = max(float(abs(residual).max()) for residual in shown.residuals)
    assert left > 5 * shown.sigma
    label, x, _ = gallery.telling(shown)
    assert len(x) == sum(map(len, shown.residuals)) and (name != "position_friction" or label == "position (m)")


def test_the_reference_describes_all_that_the_package_exports():
    import frictionpinn as fp

    text = reference.functions()
    assert all(f".{name}\n" in text for name in fp.__all__)
    assert all(f"## {name} " in reference.systems() for name in SYSTEMS)
    assert all(f"## {name} " in reference.laws() and reference.equations_of(LAWS[name]()) for name in LAWS)
    assert r"\operatorname{exp}{\left(- \left|{\frac{v}{v_{s}}}\right|^{\alpha} \right)}" in reference.laws()


def test_the_plan_of_an_experiment_runs_as_printed(capsys):
    exec(block("python", "fp.bound(drive"), {})
    assert "mu_s" in capsys.readouterr().out


def test_the_page_how_good_says_what_the_results_of_the_benchmarks_say(monkeypatch, tmp_path):
    monkeypatch.syspath_prepend(str(ROOT / "benchmarks"))
    import how_good

    written: dict[str, str] = {}
    monkeypatch.setattr(how_good, "fill_page", written.__setitem__)
    monkeypatch.setattr(how_good, "FIGURE", tmp_path / "how_good.png")
    how_good.main()
    page = (ROOT / "docs" / "accuracy.md").read_text()
    assert {"parameters", "names", "machines"} == written.keys()
    for name, table in written.items():
        assert f"<!-- {name} -->\n{table}\n<!-- /{name} -->" in page, "run python benchmarks/how_good.py"
    assert how_good.FIGURE.stat().st_size > 20_000
