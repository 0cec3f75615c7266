"""A run: a recipe, a scene, and the folder that holds what came of them."""
