"""Socket: changes to a model's structure while it trains."""
