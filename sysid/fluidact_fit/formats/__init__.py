"""Readers of binary recordings, which run in a process of their own.

Their libraries are native code, and a damaged file can end the process that reads it. ``worker``
is that process; it imports only what one format needs, and leaves what it found in files:
numbers as they lie in memory, and a description in JSON. ``fluidact_fit.logs`` starts it.
"""
