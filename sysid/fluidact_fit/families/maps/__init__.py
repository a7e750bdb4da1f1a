"""Parts of the ``force-map`` family, which alone uses them."""
