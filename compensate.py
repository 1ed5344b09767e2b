"""Record, diagnose, identify, compensate, record again: ``python compensate.py``; options: conf/compensate.yaml."""

from frictionpinn.workflow.commands import run

if __name__ == "__main__":
    run("compensate")  # a @hydra.main, which is what Hydra's tab completion looks for in this file
