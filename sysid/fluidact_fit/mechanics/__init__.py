"""Motion with dry friction: one law, a single mass in closed form, coupled systems by events."""
