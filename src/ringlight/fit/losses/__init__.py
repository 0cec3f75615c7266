"""Socket: what a prediction is compared with."""
