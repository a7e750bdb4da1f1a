"""Linear dynamics behind an optional dead zone: line, valve and hydrostatic transmission."""
