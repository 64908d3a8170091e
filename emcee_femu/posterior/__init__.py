"""What is sampled: model, likelihood terms and prior as one log-posterior."""
