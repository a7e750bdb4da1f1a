"""``make acceptance``: every headline figure again, beside the committed ones.

    python -m studies.acceptance [--write] [--only GROUP ...] [--data DIRECTORY]

Only the installed ``fluidact-fit`` is run, as a process with a time limit, and only the
parameter files that it writes are read: what is measured does not depend on how the library
is built inside.
"""
