"""Floor 0: the nouns. Imports torch and nothing of ours."""
