"""How :class:`EvaluationPool` works, and what runs on a worker."""
