# make run      train the PE2 model on the pendulum-on-a-box (installs everything first)
# make install  virtual environment in .venv with the pinned packages
# make check    lint, format and types
# make test     make check, then the test suite
# make paper    every table and figure of the paper, ours beside theirs: docs/paper.md (about half an hour on two cores)
# make docs     the documentation, strictly: a broken link is an error; build/site/index.html (three minutes at first)
# make bench    every benchmark, one after another
# make clean    remove .venv and the caches; outputs/ stays

MAKEFLAGS += --no-print-directory
.DEFAULT_GOAL := run
.PHONY: run install check test paper docs bench clean

VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed
PIP := $(BIN)/python -m pip install -qq --disable-pip-version-check -c constraints.txt
TORCH = $(shell sed -n 's/^torch==//p' constraints.txt)

# Asking each candidate to run, since a name on PATH may be a launcher without an interpreter behind it.
IN_RANGE := import ensurepip, sys, venv; sys.exit(not (3, 11) <= sys.version_info[:2] <= (3, 13))
PYTHON ?= $(shell for p in python3 python3.13 python3.12 python3.11; do \
	$$p -c '$(IN_RANGE)' >/dev/null 2>&1 && echo $$p && break; done)

run: $(STAMP)
	$(BIN)/python train.py model=pe2 system=pob

install: $(STAMP)

$(BIN)/python:
	@"$(PYTHON)" -c '$(IN_RANGE)' 2>/dev/null || { echo "no Python 3.11 to 3.13 with venv found on PATH:" \
		"install one (python3.12 and its venv package), or say make PYTHON=/path/to/python3.12" >&2; exit 1; }
	$(PYTHON) -m venv $(VENV)

# torch goes first and by its exact version, so that pip takes a CPU build of it where one is at hand.
$(STAMP): pyproject.toml constraints.txt | $(BIN)/python
	$(PIP) "torch==$(TORCH)"
	$(PIP) -e ".[dev]"
	@touch $@

check: $(STAMP)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

test: check
	$(BIN)/python -m pytest -n 2 --dist worksteal

paper: $(STAMP)
	$(BIN)/python reproduce.py

docs: $(STAMP)
	$(BIN)/python docs/tools/build_site.py

bench: $(STAMP)
	@set -e; for file in benchmarks/*.py; do echo "== $$file"; $(BIN)/python "$$file"; done

clean:
	rm -rf $(VENV) *.egg-info build dist .pytest_cache .hypothesis .ruff_cache .mypy_cache
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
