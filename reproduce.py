"""Reproduce the paper: ``python reproduce.py`` writes docs/paper.md; options: conf/reproduce.yaml."""

from frictionpinn.workflow.commands import run

if __name__ == "__main__":
    run("reproduce")  # a @hydra.main, which is what Hydra's tab completion looks for in this file
