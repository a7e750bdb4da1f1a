"""Parts of the ``hydraulic-cylinder`` family, which alone uses them."""
