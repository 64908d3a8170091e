"""A cheap stand-in for a model, with a certificate."""
