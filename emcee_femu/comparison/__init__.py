"""Of moves, on one posterior."""
