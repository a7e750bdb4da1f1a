"""Parts of the ``ball-screw`` family, which alone uses them."""
