"""One file per paper: recipe, presets, citation."""
