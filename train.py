"""Train a friction model: ``python train.py model=pe2 system=pob``; every option is a file in conf/."""

from frictionpinn.workflow.commands import run

if __name__ == "__main__":
    run("train")  # a @hydra.main, which is what Hydra's tab completion looks for in this file
