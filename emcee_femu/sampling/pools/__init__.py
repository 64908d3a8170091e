"""What stands behind :class:`emcee_femu.EvaluationPool`, and what runs on a worker."""
