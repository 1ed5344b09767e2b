"""How good a model is: force errors on held-out trials, fitted baselines, figures."""
