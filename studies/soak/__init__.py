"""An attack on the reader, the files and the processes: whatever is given, it ends well.

Every case is damage of one kind, drawn with a seed: to logs, to parameter files, to options,
to the processes and the disk beneath them. A case ends well when what came of it is right or is
refused with a message and the documented exit status; never with a traceback, with exit status
1, with rows or numbers lost in silence, or not at all. ``make soak``.
"""
