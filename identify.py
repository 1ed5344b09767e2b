"""Compare estimators of friction parameters: ``python identify.py system=pob``; options: conf/identify.yaml."""

from frictionpinn.workflow.commands import run

if __name__ == "__main__":
    run("identify")  # a @hydra.main, which is what Hydra's tab completion looks for in this file
