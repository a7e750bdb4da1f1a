"""Single-acting cylinder with a return spring, as a gray box."""
