"""Command line of fluidact-fit."""
