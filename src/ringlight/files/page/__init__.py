"""A model as one HTML file: what the page shows of it, its numbers as text, and the source that is joined."""
