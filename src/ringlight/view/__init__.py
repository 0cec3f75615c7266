"""A live viewer: what a model shows, drawn while somebody looks, by the product's own rasterizer.

``viewer.py`` is the whole of it; ``viser_page.py`` alone knows of viser.
"""
