"""Parts of the ``cylinder-friction`` family, which alone uses them."""
