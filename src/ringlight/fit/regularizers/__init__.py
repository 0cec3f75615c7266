"""Socket: terms of the loss that look at the model, or at what was blended, instead of at colours."""
