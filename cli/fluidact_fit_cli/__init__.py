"""Command line of fluidact-fit."""

INTERRUPTED = 130  # exit status: 128 + SIGINT, as shells have it
