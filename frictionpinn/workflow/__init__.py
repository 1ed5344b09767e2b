"""From a configuration to results: building the parts, training, reporting; errors in one line."""
