"""Calibration of a potentiometer by a rational Bezier curve."""
