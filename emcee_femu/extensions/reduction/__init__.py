"""A cheap stand-in for a large model: a reduced one."""
