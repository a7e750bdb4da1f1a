"""The version, once: the package, the files it writes and the wheel take it from here."""

__version__ = "0.1.0"
