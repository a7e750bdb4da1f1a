"""``fluidact-fit batch``."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from fluidact_fit.errors import StrictError, UsageError

from ..messages import tell_message
from ..options import VERBOSITY, Command, Option, family_option, flag
from ..outputs import check_folder, note_written
from ..progress import Progress
from ..show import echo, echo_table, echo_text

if TYPE_CHECKING:
    from fluidact_fit.batch import Job
    from fluidact_fit.batch.outcome import JobResult
    from fluidact_fit.batch.pools import Pool

_ALIKE = "Instead of JOBS: logs found by their names"
_WHERE = "Where it runs"
_TOLD = 5  # reasons of failed jobs that the terminal shows
# What every fit of a worker needs, imported once for all of them.
_PRELOAD = ("fluidact_fit_cli.commands.batch_job", "fluidact_fit.fitting",
            "fluidact_fit.logs.reader", "pandas", "scipy.signal", "scipy.optimize")  # fmt: skip


@click.command(
    "batch",
    cls=Command,
    params=[
        click.Argument(["jobs_file"], metavar="[JOBS]", required=False),
        Option(["--output", "-o", "folder"], metavar="FOLDER", required=True, group="Output",
               help="Folder for the results; created if it does not exist."),
        flag("--force", "-f", group="Output",
             help="Run finished jobs again, and replace files that no earlier run wrote."),
        family_option("Family of all jobs.", _ALIKE),
        Option(["--logs"], metavar="PATTERN", multiple=True, group=_ALIKE,
               help="Which logs, for example 'fleet/**/*.csv'. Repeatable."),
        Option(["--group-by"], metavar="file|folder|PATTERN", group=_ALIKE,
               help="Which logs make a job: each one (default), those of a folder, or those whose "
               "names agree at {job}: 'unit{job}_*.csv'."),
        Option(["--options"], metavar="'OPTIONS'", group=_ALIKE,
               help="Options of every fit, in quotes: --options '--unit inlet=bar'."),
        Option(["--workers"], type=click.IntRange(1, 10_000), metavar="N", group=_WHERE,
               help="Number of processes (default: one for each processor)."),
        Option(["--scheduler"], metavar="tcp://HOST:PORT", group=_WHERE,
               help="Run on the workers of this Dask scheduler, which need access to the files."),
        Option(["--cluster"], type=click.Choice(["local", "slurm", "kubernetes"]), group=_WHERE,
               help="Start Dask workers on a cluster, as dask's configuration files describe it, "
               "and stop them afterwards."),
        flag("--strict", group="Verdict",
             help="A job without a parameter file ends the command with exit status 4."),
        *VERBOSITY,
    ],
)  # fmt: skip
def command(jobs_file: str | None, folder: str, **params: Any) -> None:
    """Run the fits that the table JOBS lists, each as one command line.

    \b
    JOBS is CSV, or YAML with the same keys, one row per parameter file FOLDER/JOB.yaml:
      job      its name
      family   valve, line, ...
      logs     paths or patterns, separated by ; and relative to the folder of JOBS
      options  as on the command line, without -o

    FOLDER/summary.csv and summary.parquet have one row per job (status, exit status, verdict,
    every number with its standard error, message), FOLDER/index.html shows them, FOLDER/logs
    keeps the messages of every job. Run the same command again to resume: finished
    jobs with the same logs, options and version are not repeated. A job that fails does not stop
    the others, and the exit status is 0 when every job has an outcome.

    \b
    Examples:
      fluidact-fit batch jobs.csv -o fleet --workers 8
      fluidact-fit batch --family valve --logs 'units/*/*.csv' --group-by folder -o fleet
      fluidact-fit batch jobs.csv -o fleet --scheduler tcp://node1:8786
    """
    from fluidact_fit.batch import run_batch, write_summary

    from .batch_job import asked_by, execute

    check_folder(folder)
    target = Path(folder)
    jobs, base = _jobs(jobs_file, target, params)
    _check_folder(target, params["force"])
    with (
        Progress(params["quiet"], params["verbose"], lines=True) as progress,
        _pool(params, progress) as pool,
    ):
        if not target.exists() or target.is_dir():
            note_written([folder])  # an interrupted batch keeps what it has, and resumes from there
        outcomes = run_batch(
            jobs, base, target, execute, pool, again=params["force"], progress=progress,
            source=Path(jobs_file) if jobs_file else None, asked_by=asked_by,
            warn=partial(_warn, progress),
        )  # fmt: skip
    written = [str(path) for path in write_summary(jobs, outcomes, target)]
    failed = sum(outcome.exit != 0 for outcome in outcomes)
    if not params["quiet"]:
        _show([outcome.status for outcome in outcomes])
        _tell_failures(outcomes, target)
        echo_text("written to " + ", ".join(written))
    if failed and params["strict"]:
        raise StrictError(
            f"{failed} of {len(jobs)} jobs have no parameter file.",
            remedy=f"See {target / 'index.html'}, or what each said in {target / 'logs'}.",
        )


def _tell_failures(outcomes: Sequence[JobResult], target: Path) -> None:
    """Say once for each reason why jobs have no parameter file."""
    from fluidact_fit.batch.summary import by_reason
    from fluidact_fit.batch.targets import SUMMARY

    alike = by_reason(outcomes)
    for first, *others in alike[:_TOLD]:
        more = f" and {len(others)} more" if others else ""
        tell_message("error", f"job {first.job}{more}: {first.message}")
    if len(alike) > _TOLD:
        tell_message("note", f"and {len(alike) - _TOLD} more: see {target / SUMMARY[0]}.")


def _warn(progress: Progress, text: str) -> None:
    progress.clear()
    tell_message("warning", text)


def _jobs(jobs_file: str | None, folder: Path, params: Any) -> tuple[list[Job], Path]:
    """Jobs, and the folder from which their logs are seen."""
    from fluidact_fit.batch import group_logs, read_jobs
    from fluidact_fit.batch.journal import own_files

    alike = [f"--{name.replace('_', '-')}" for name in ("family", "logs", "group_by", "options")
             if params[name]]  # fmt: skip
    if jobs_file is not None:
        if alike:
            raise UsageError(f"{alike[0]} defines jobs, and JOBS lists them already.",
                             remedy="Give only one of them.")  # fmt: skip
        return read_jobs(jobs_file), Path(jobs_file).parent
    if not (params["family"] and params["logs"]):
        raise UsageError(
            "there are no jobs.", expected="Expected a table JOBS, or --family and --logs.",
            remedy="See --help for both.",
        )  # fmt: skip
    here = Path()
    jobs = group_logs(params["family"], params["logs"], params["group_by"] or "file",
                      params["options"] or "", here, own_files(folder))  # fmt: skip
    return jobs, here


def _check_folder(folder: Path, force: bool) -> None:
    """Refuse a folder whose files would be replaced and are of no earlier batch."""
    from fluidact_fit.batch.journal import NAME
    from fluidact_fit.batch.targets import SUMMARY

    if force or (folder / NAME).exists():
        return
    for name in SUMMARY:
        if (folder / name).exists():
            raise UsageError(
                f"{folder / name} already exists and is not from a batch; not overwritten.",
                remedy="Give another folder with -o, or --force to replace it.",
            )


@contextmanager
def _pool(params: Any, progress: Progress) -> Iterator[Pool]:
    """Pool in which the jobs run."""
    from fluidact_fit.batch.cluster import dask_pool
    from fluidact_fit.batch.pools import LocalPool

    scheduler, cluster = params["scheduler"], params["cluster"]
    if scheduler and (cluster or params["workers"]):
        other = "--cluster" if cluster else "--workers"
        raise UsageError(f"--scheduler brings its own workers; {other} cannot be combined with it.",
                         remedy="Give only one of them.")  # fmt: skip
    workers = params["workers"] or os.cpu_count() or 1
    if scheduler is not None or cluster:
        with dask_pool(scheduler, cluster, workers, progress) as pool:
            yield pool
    else:
        yield LocalPool(workers, _PRELOAD)


def _show(statuses: Sequence[str]) -> None:
    names = list(dict.fromkeys(sorted(statuses, key=statuses.count, reverse=True)))
    echo_table([["jobs", ""], *([str(statuses.count(n)), n] for n in names)], right=(0,))
    echo()
