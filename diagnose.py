"""What a declared model lacks: ``python diagnose.py system=pob data=csv data.path=run.csv``; see conf/diagnose.yaml."""

from frictionpinn.workflow.commands import run

if __name__ == "__main__":
    run("diagnose")  # a @hydra.main, which is what Hydra's tab completion looks for in this file
