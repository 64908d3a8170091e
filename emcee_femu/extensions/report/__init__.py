"""What was done and what was learned, in one file to hand over."""
