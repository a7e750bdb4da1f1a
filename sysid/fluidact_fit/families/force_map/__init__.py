"""Force maps of a cylinder with hysteresis: small networks of command and force."""
