"""Parts of the ``potentiometer`` family, which alone uses them."""
