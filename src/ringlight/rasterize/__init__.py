"""Socket: Gaussians and channels to an image."""
