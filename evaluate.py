"""Evaluate a trained friction model: ``python evaluate.py run=outputs/pob/pe1/...``; options: conf/evaluate.yaml."""

from frictionpinn.workflow.commands import run

if __name__ == "__main__":
    run("evaluate")  # a @hydra.main, which is what Hydra's tab completion looks for in this file
