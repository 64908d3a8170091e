"""Terms: the response of a model to log-likelihoods."""
