"""Many fits: a table of jobs in, a parameter file each, a summary and a page of all."""

from __future__ import annotations

from .jobs import Job, group_logs, read_jobs
from .run import run_batch
from .summary import summary_table, write_summary

__all__ = ["Job", "group_logs", "read_jobs", "run_batch", "summary_table", "write_summary"]
