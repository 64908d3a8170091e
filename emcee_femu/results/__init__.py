"""What was learned: ArviZ objects, diagnostics, tables."""
