"""Attacks on the numbers: machines, noise and mistakes that the estimators were not built for.

Every attack simulates its own logs with a simulator that shares nothing with the estimators,
fits them through the public interface, and compares what is written with the truth. A verdict
of ``pass`` with a wrong number is what must never happen. ``make red-team``.
"""
