"""Ball-screw (or any) drive: inertia, viscous friction and four Coulomb levels."""
