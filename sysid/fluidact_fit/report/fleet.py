"""The page of a batch: how parameters vary from unit to unit, and what was not fitted."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from math import ceil
from typing import TYPE_CHECKING
from urllib.parse import quote

import numpy as np
import numpy.typing as npt

from ..estimation.random_effects import Spread
from .html import Cell, code, escape, header, pictures, section, whole_page
from .numbers import Scale, choose_scale, count, short, show
from .reading import picture
from .style import FAINT, INK, MEASURED, SIMULATED, SMALL, dress, load_matplotlib

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_COLUMNS = 3
_MOST_PICTURES = 60
_MOST_ROWS = 200
_MOST_JOBS = 5000
_MOST_COLUMNS = 6  # numbers beside each job
_MOST_NAMES = 8


@dataclass(frozen=True)
class FleetQuantity:
    """One number of a family over all jobs that estimated it.

    ``values`` and ``errors`` [SI], shape ``(n,)``, belong to ``jobs``; ``spread`` is what
    follows from them, ``None`` for too few.
    """

    family: str
    name: str
    unit: str
    jobs: Sequence[str]
    values: npt.NDArray[np.float64]
    errors: npt.NDArray[np.float64]
    spread: Spread | None

    @property
    def label(self) -> str:
        """Family and name."""
        return f"{self.family} {self.name}"

    @property
    def scale(self) -> Scale:
        """The unit in which the numbers are shown."""
        return choose_scale(self.unit, float(np.median(np.abs(self.values))))


@dataclass(frozen=True)
class Reason:
    """Reason why jobs ended without a file: status, finding, and the jobs."""

    status: str
    text: str
    jobs: Sequence[str]


@dataclass(frozen=True)
class FleetJob:
    """One job: its family, what came of it, and the files that it wrote, as seen from the page."""

    name: str
    family: str
    status: str
    verdict: str
    warnings: Sequence[str]
    files: Sequence[str]


def fleet_page(
    counts: Mapping[str, int],
    jobs: Sequence[FleetJob],
    quantities: Sequence[FleetQuantity],
    reasons: Sequence[Reason],
    warnings: Mapping[str, Sequence[str]],
    records: str,
) -> str:
    """The page of a batch.

    Parameters
    ----------
    counts
        Jobs by what came of them.
    jobs
        Every job.
    quantities
        Distribution of every number.
    reasons
        Jobs without a file, by reason.
    warnings
        Jobs by code of warning.
    records
        Folder of the records, as seen from the page.
    """
    judged = [q for q in quantities if q.spread is not None]
    total = sum(counts.values())
    shown = judged[:_MOST_PICTURES]
    figures = []
    if shown:
        title = "Distribution of every parameter over the units"
        figures = [picture(_plot(shown), title, _in_words(shown))]
    more = ""
    if len(judged) > len(shown):
        more = (
            f'<p class="faint">The pictures show the first {len(shown)} of {count(len(judged))} '
            "numbers. All of them are in the table below, unit by unit in summary.csv and "
            "summary.parquet.</p>"
        )
    return whole_page(
        f"{total} jobs",
        [header(f"{count(total)} jobs", [f"{name} {count(n)}" for name, n in counts.items()]),
         _reasons(reasons, records), _warnings(warnings, records), _outliers(judged, records),
         pictures(figures), more, _spreads(quantities), _jobs(jobs, quantities, records)],
    )  # fmt: skip


def _in_words(quantities: Sequence[FleetQuantity]) -> str:
    """The histograms in words."""
    said = "; ".join(
        f"{q.label}: mean {short(q.spread.mean * q.scale.factor, 4)}, between units "
        f"{short(q.spread.between * q.scale.factor, 3)} {q.scale.unit}, "
        f"{int(q.spread.outlier.sum())} outliers of {len(q.jobs)}"
        for q in quantities if q.spread is not None
    )  # fmt: skip
    return f"One histogram a parameter, with mean and spread between units. {said}."


def _jobs(jobs: Sequence[FleetJob], quantities: Sequence[FleetQuantity], records: str) -> str:
    """All jobs, with links to their files and, where all are of one family, their numbers."""
    shown, alike = jobs[:_MOST_JOBS], len({job.family for job in jobs}) == 1
    columns = [q for q in quantities if "[" not in q.name][: _MOST_COLUMNS * alike]
    found = [{job: k for k, job in enumerate(q.jobs)} for q in columns]
    rows: list[list[Cell]] = []
    for job in shown:
        numbers = [_number(q, at.get(job.name)) for q, at in zip(columns, found)]
        warned = ", ".join(dict.fromkeys(job.warnings))
        rows.append([_links(job, records), escape(job.family), escape(job.status),
                     escape(job.verdict), escape(warned), *numbers])  # fmt: skip
    heads = ["job", "family", "status", "verdict", "warnings"]
    heads += [q.scale.label(q.name) for q in columns]
    title = "Jobs"
    if len(jobs) > len(shown):
        title += f" (the first {count(len(shown))} of {count(len(jobs))}; all are in summary.csv)"
    numeric = range(len(heads) - len(columns), len(heads))
    table = section(title, heads, rows, numeric, kind="sortable")
    return f'<div class="jobs">{table}</div>' if table else ""


def _number(q: FleetQuantity, k: int | None) -> Cell:
    if k is None:
        return ""
    value, error = (float(x[k]) * q.scale.factor for x in (q.values, q.errors))
    return value, escape(show(value, error))


def _links(job: FleetJob, records: str) -> str:
    """The name of a job, with links to what it wrote and to its record."""
    files = [name for name in job.files if name != f"{records}/{job.name}.txt"]
    links = [f'<a href="{quote(name)}">{escape(name.rpartition(".")[2])}</a>' for name in files]
    return f"{escape(job.name)} ({', '.join([*links, _record(job.name, records)])})"


def _record(job: str, records: str, text: str = "log") -> str:
    """A link to the record of a job."""
    return f'<a href="{quote(f"{records}/{job}.txt")}">{escape(text)}</a>'


def _spreads(quantities: Sequence[FleetQuantity]) -> str:
    rows = [[code(q.label), *_spread_cells(q)] for q in quantities]
    heads = ("parameter", "jobs", "mean", "95 % interval", "between units", "95 % interval",
             "within one", "unit", "outliers")  # fmt: skip
    about = (
        '<p class="faint">Between units: the standard deviation that remains when the uncertainty '
        "of each is taken off (restricted maximum likelihood of a random-effects model, outliers "
        "left out). Within one: the typical standard error of a unit. An outlier lies further "
        "from the mean than both together allow among so many units.</p>"
    )
    table = section("From unit to unit", heads, rows, numeric=(1, 2, 3, 4, 5, 6, 8))
    return table + about if table else ""


def _spread_cells(q: FleetQuantity) -> list[str]:
    found, scale = q.spread, q.scale
    if found is None:
        return [count(len(q.jobs)), "", "", "", "", "", escape(scale.unit), ""]

    def interval(ends: tuple[float, float], digits: int) -> str:
        return " … ".join(short(end * scale.factor, digits) for end in ends)

    return [
        count(len(q.jobs)), short(found.mean * scale.factor, 5), interval(found.mean_ci95, 5),
        short(found.between * scale.factor, 3), interval(found.between_ci95, 3),
        short(found.within * scale.factor, 3), escape(scale.unit), count(int(found.outlier.sum())),
    ]  # fmt: skip


def _outliers(quantities: Sequence[FleetQuantity], records: str) -> str:
    found = [
        (abs(q.spread.deviation[k]), q, k)
        for q in quantities if q.spread is not None
        for k in np.flatnonzero(q.spread.outlier).tolist()
    ]  # fmt: skip
    found.sort(key=lambda entry: (-entry[0], entry[1].name, entry[1].jobs[entry[2]]))
    rows = [
        [f'<a href="{quote(f"{q.jobs[k]}.yaml")}">{escape(q.jobs[k])}</a> '
         f"({_record(q.jobs[k], records)})", code(q.label),
         escape(show(*(float(x[k]) * q.scale.factor for x in (q.values, q.errors)))),
         escape(q.scale.unit),
         short(float(q.spread.deviation[k]), 3) if q.spread else ""]
        for _, q, k in found[:_MOST_ROWS]
    ]  # fmt: skip
    title = "Outliers by their own uncertainty"
    if len(found) > len(rows):
        title += f" (the {len(rows)} furthest of {count(len(found))})"
    heads = ("job", "parameter", "value ± standard error", "unit", "standard deviations off")
    return section(title, heads, rows, numeric=(2, 4))


def _reasons(reasons: Iterable[Reason], records: str) -> str:
    rows = [
        [escape(r.status), escape(r.text), count(len(r.jobs)), _some(r.jobs, records)]
        for r in reasons
    ]
    return section(
        "Not fitted, by reason", ("status", "reason", "jobs", "which"), rows, numeric=(2,)
    )


def _warnings(warnings: Mapping[str, Sequence[str]], records: str) -> str:
    rows = [[code(name), count(len(jobs)), _some(jobs, records)] for name, jobs in warnings.items()]
    return section("Warnings", ("warning", "jobs", "which"), rows, numeric=(1,))


def _some(jobs: Sequence[str], records: str) -> str:
    """The records of the first of many jobs."""
    links = [_record(job, records, job) for job in jobs[:_MOST_NAMES]]
    return ", ".join(links) + (" …" if len(jobs) > _MOST_NAMES else "")


def _plot(quantities: Sequence[FleetQuantity]) -> Figure:
    """One histogram a quantity, with mean and spread between units."""
    load_matplotlib()
    from matplotlib.figure import Figure

    rows = ceil(len(quantities) / _COLUMNS)
    figure = Figure(figsize=(11.0, 2.5 * rows), layout="constrained")
    for k, quantity in enumerate(quantities):
        _panel(figure.add_subplot(rows, _COLUMNS, k + 1), quantity)
    return figure


def _panel(axes: Axes, q: FleetQuantity) -> None:
    found = q.spread
    if found is None:
        return
    scale = q.scale
    inside = q.values[~found.outlier] * scale.factor
    bins = int(np.clip(np.sqrt(inside.size), 5, 60))
    axes.hist(inside, bins=bins, color=MEASURED, alpha=0.75)
    mean, between = found.mean * scale.factor, found.between * scale.factor
    axes.axvline(mean, color=SIMULATED, linewidth=1.4)
    axes.axvspan(mean - between, mean + between, color=SIMULATED, alpha=0.13, linewidth=0)
    outside = q.values[found.outlier] * scale.factor
    if outside.size:
        _mark(axes, outside)
    dress(axes, q.label)
    axes.set_xlabel(scale.unit or "–")
    axes.tick_params(axis="y", labelcolor=FAINT)


def _mark(axes: Axes, outside: npt.NDArray[np.float64]) -> None:
    """Outliers as ticks within the axes; those beyond are counted at the side."""
    low, high = axes.get_xlim()
    width = high - low
    axes.set_xlim(low - 0.5 * width, high + 0.5 * width)
    low, high = axes.get_xlim()
    seen = outside[(outside >= low) & (outside <= high)]
    axes.plot(seen, np.zeros(seen.size), "|", color=INK, markersize=12)
    sides = ((int((outside < low).sum()), 0.01, "left", "← {}"),
             (int((outside > high).sum()), 0.99, "right", "{} →"))  # fmt: skip
    for number, place, align, text in sides:
        if number:
            axes.text(place, 0.5, text.format(number), transform=axes.transAxes, ha=align,
                      fontsize=SMALL, color=INK, in_layout=False)  # fmt: skip
