"""What evaluates a posterior and counts the solves, on pools and in files."""
