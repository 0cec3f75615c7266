"""Field pieces that know nothing of colour: encodings, tables, tensor rings."""
