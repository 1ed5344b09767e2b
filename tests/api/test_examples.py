"""Every function of ``import frictionpinn as fp`` is documented, and its examples run as they are printed."""

from __future__ import annotations

import doctest
import inspect
import subprocess
import sys

import pytest

import frictionpinn as fp

FUNCTIONS = [name for name in fp.__all__ if name != "UserError"]


def function(name: str):
    """The function itself, also where a folder of the package has its name."""
    return inspect.unwrap(getattr(fp, name))


@pytest.mark.parametrize("name", FUNCTIONS)
def test_the_examples_of_a_function_run_as_printed(name, workdir):
    (example,) = doctest.DocTestFinder(recurse=False).find(function(name), name, globs={})
    assert example.examples
    told: list[str] = []
    runner = doctest.DocTestRunner(optionflags=doctest.NORMALIZE_WHITESPACE)
    assert runner.run(example, out=told.append).failed == 0, "".join(told)


@pytest.mark.parametrize("name", FUNCTIONS)
def test_every_argument_is_documented_and_where_it_may_fail(name):
    text = inspect.getdoc(function(name))
    arguments = inspect.signature(getattr(fp, name)).parameters
    documented = text.partition("Examples:")[0]
    assert all(argument in documented for argument in arguments)
    assert not arguments or name in ("check", "effects") or "Raises:" in documented


def test_the_package_is_imported_in_half_a_second_and_without_torch():
    code = (
        "import sys, time; t = time.perf_counter(); import frictionpinn; print(time.perf_counter() - t, *sys.modules)"
    )
    told = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    assert float(told[0]) < 0.5 and not {"torch", "numpy", "sympy", "numba"} & set(told[1:])


@pytest.mark.parametrize(("given", "kept"), [(None, "10000"), ("7", "7")])
def test_threads_that_wait_sleep_soon_unless_the_user_has_said_how(monkeypatch, given, kept):
    monkeypatch.delenv("GOMP_SPINCOUNT", raising=False)
    if given:
        monkeypatch.setenv("GOMP_SPINCOUNT", given)
    code = "import frictionpinn, os; print(os.environ['GOMP_SPINCOUNT'])"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True).stdout.strip() == kept


def test_a_folder_of_the_package_is_the_function_of_its_name_too():
    import frictionpinn.diagnose.diagnosis

    assert frictionpinn.diagnose.diagnosis.Diagnosis.__name__ == "Diagnosis"
    assert "held_out" in inspect.signature(fp.diagnose).parameters
    assert set(fp.__all__) <= set(dir(fp)) and not hasattr(fp, "nonsense")
