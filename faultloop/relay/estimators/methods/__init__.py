"""One module per estimator; the registry finds them here by their file names."""
