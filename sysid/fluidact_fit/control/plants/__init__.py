"""Machines made from parameter files, followed exactly from sample to sample."""

from __future__ import annotations
