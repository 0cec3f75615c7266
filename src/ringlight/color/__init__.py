"""Socket: what each Gaussian emits."""
