"""Random tables of every dialect, unit and format, read back and compared with what was written.

The writers share no code with the reader: units and their sizes, numbers as text, stamps and files
are made here, from the definitions.
"""
