"""Volumes: density and colour of space, shown by marching along rays."""
