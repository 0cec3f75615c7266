"""From scene to model."""
