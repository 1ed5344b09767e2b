"""Check a recording before anything is learned from it: ``python check.py system=pob data.path=run.csv``."""

from frictionpinn.workflow.commands import run

if __name__ == "__main__":
    run("check")  # a @hydra.main, which is what Hydra's tab completion looks for in this file
