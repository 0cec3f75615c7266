"""Six plugs that the product does not have: each is a file or two, one line in a table, and inherits the contracts."""
