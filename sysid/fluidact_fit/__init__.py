"""System identification for fluid-powered actuators."""
