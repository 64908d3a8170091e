"""What evaluates a posterior: failures, pools, and the file of a run."""
