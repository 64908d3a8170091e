"""Modal models: a batch of parameter sets to natural frequencies and mode shapes."""
