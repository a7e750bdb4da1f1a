"""Fit the datasets that come with the package and compare the results with the truth."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

from .errors import ExistingFileError, OutputError
from .experiment import Experiment, Signal
from .families import family_names, get_family
from .family import Plant
from .fitting import fit
from .logs import Log, read_log
from .result import FitResult
from .tables import Table, percent_text
from .units import after_number

ALLOWED = 4.0  # standard errors between estimate and truth
_MISSED = "<- missed"
Row = tuple[str, ...]  # cells of the table, the last one empty where the truth was recovered
_HEADER = ("family", "parameter", "truth", "estimate", "deviation", "fit", "")


@dataclass(frozen=True)
class Dataset:
    """Logs of one family with the values that made them.

    ``columns`` are headers by role, ``options`` the family's own. ``truth`` maps parameters to
    ``{"value": ..., "unit": ...}`` [SI]. ``curve`` says, for a map, how far its curve may lie from
    the true one, ``{"tolerance": ..., "unit": ...}`` [SI]; it is empty for all others.
    """

    family: str
    logs: tuple[Path, ...]
    columns: Mapping[str, str]
    options: Mapping[str, Any]
    truth: Mapping[str, Mapping[str, Any]]
    curve: Mapping[str, Any]

    def read(self) -> list[Log]:
        """Read the logs."""
        return [read_log(path, columns=dict(self.columns)) for path in self.logs]


def find_datasets() -> Path:
    """The directory of the datasets: in the package, or beside it in a checkout."""
    packaged = Path(str(files("fluidact_fit"))) / "_datasets"
    for place in (packaged, Path(__file__).parents[2] / "datasets"):
        if (place / "SHA256SUMS").is_file():
            return place
    raise OutputError(
        "the datasets of the demo are not part of this installation",
        where=str(packaged),
        remedy="Install the wheel, or run the demo from a checkout of the repository.",
    )


def load_dataset(family: str) -> Dataset:
    """Return the dataset of a family with its truth."""
    from .parameters import read_yaml

    folder = find_datasets() / family
    truth = read_yaml(folder / "truth.yaml").data
    return Dataset(
        family,
        tuple(folder / name for name in truth["logs"]),
        truth["columns"],
        truth["options"],
        truth["parameters"],
        truth.get("curve", {}),
    )


def run_demo(
    directory: str | Path,
    echo: Callable[[str], None],
    *,
    overwrite: bool = False,
    progress: Callable[[str], None] | None = None,
    table: Callable[[Table], object] | None = None,
) -> int:
    """Fit all families and write a parameter file and a picture of each into a directory.

    Returns 0 when every true value lies within four standard errors of its estimate, else 1.
    ``echo`` takes one line of text at a time; ``overwrite`` allows files to be replaced. Where
    ``progress`` is given it takes the messages of the fits, and ``table`` the result.

    Raises
    ------
    OutputError
        When the directory cannot be written, or holds results already.
    """
    from .report import plot_result, save_figure

    directory = Path(directory)
    _check_directory(directory, overwrite)
    rows: list[Row] = []
    for name in family_names():
        dataset = load_dataset(name)
        (progress or echo)(f"fitting {name} ({len(dataset.logs)} logs)")
        result = fit(name, dataset.read(), **dataset.options)
        result.save(directory / f"{name}.yaml", overwrite=overwrite)
        save_figure(plot_result(result), directory / f"{name}.png")
        rows += compare(dataset, result)
    missed, number = sum(bool(row[-1]) for row in rows), len(rows)
    if missed:
        found = (
            f"{missed} of {number} true values were missed (by over {ALLOWED:g} standard errors)"
        )
    else:
        found = f"all {number} true values lie within {ALLOWED:g} standard errors"
    echo("")
    (table or (lambda shown: echo(repr(shown))))(Table(_HEADER, tuple(rows), drop=(5, 2)))
    for line in ("", f"parameter files and pictures: {directory}", found):
        echo(line)
    return int(missed > 0)


def compare(dataset: Dataset, result: FitResult) -> list[Row]:
    """Compare a result with the truth, one row per parameter."""
    fit_percent = percent_text(result.document.fit.fit_percent)
    if dataset.curve:
        return [_compare_curve(dataset, result, fit_percent)]
    return list(_compare_numbers(dataset, result, fit_percent))


def _compare_numbers(dataset: Dataset, result: FitResult, fit_percent: str) -> Iterator[Row]:
    """Deviation of every number in standard errors."""
    for name, truth in dataset.truth.items():
        found = result.parameters[name]
        unit = after_number(truth["unit"])
        head = (dataset.family, name, f"{truth['value']:.6g}{unit}")
        if not isinstance(found.value, float) or not isinstance(found.std_error, float):
            yield (*head, found.status.replace("_", " "), "-", fit_percent, _MISSED)
            continue
        deviation = (found.value - truth["value"]) / found.std_error
        estimate = f"{found.value:.6g} ± {found.std_error:.2g}"
        missed = "" if abs(deviation) <= ALLOWED else _MISSED
        yield (*head, estimate, f"{deviation:+.2f}", fit_percent, missed)


def _compare_curve(dataset: Dataset, result: FitResult, fit_percent: str) -> Row:
    """Largest distance of two curves over the range of the logs."""
    family, variant = get_family(dataset.family), result.variant
    role = next(r for r in variant.roles if r.required and not r.output and r.name != "time")
    covered = result.document.validity[role.name]
    points = np.linspace(covered.low, covered.high, 1001)
    signal = Signal(role.name, np.zeros(0), points, covered.unit)
    run = Experiment("points", 0, np.zeros(0), {role.name: signal}, 0.0, False)
    truth = {name: entry["value"] for name, entry in dataset.truth.items()}
    curves = [
        family.simulate(Plant(variant, values, result.solution.options), [run])[0].output
        for values in (truth, result.solution.values)
    ]
    distance = float(np.max(np.abs(curves[0] - curves[1])))
    tolerance, unit = dataset.curve["tolerance"], dataset.curve["unit"]
    stated, estimate = f"± {tolerance:g} {unit}", f"off by {distance:.3g} {unit} at most"
    missed = "" if distance <= tolerance else _MISSED
    return (dataset.family, "curve", stated, estimate, "-", fit_percent, missed)


def _check_directory(directory: Path, overwrite: bool) -> None:
    try:
        directory.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(
            f"the directory cannot be created: {error.strerror or error}",
            where=str(directory),
            remedy="Give a directory that can be written.",
        ) from error
    if overwrite:
        return
    names = (f"{family}{end}" for family in family_names() for end in (".yaml", ".png"))
    present = [name for name in names if (directory / name).exists()]
    if present:
        raise ExistingFileError(
            f"{present[0]} already exists",
            where=str(directory),
            remedy="Give another directory, or remove the files of the earlier run.",
        )
