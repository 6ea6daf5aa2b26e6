"""One posterior over what may be missing in a model."""
