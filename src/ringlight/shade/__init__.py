"""Socket: blended channels to colour, per pixel."""
