"""3D Gaussian scenes lit by one shared neural tensor-ring light field."""

__version__ = "0.1.0"
