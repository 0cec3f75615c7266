"""Speed, measured: commands of the product."""
