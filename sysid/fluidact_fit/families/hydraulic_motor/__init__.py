"""Hydraulic motor behind a proportional valve."""
