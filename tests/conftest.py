"""Shapes are checked during tests only; one thread for torch, so that the suite can run in parallel."""

import os

os.environ.setdefault("OMP_WAIT_POLICY", "passive")

from jaxtyping import install_import_hook

install_import_hook("ringlight", "beartype.beartype")
