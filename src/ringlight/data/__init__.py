"""From disk to Scene, from Scene to batches."""
