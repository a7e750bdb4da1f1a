"""Predictions of a parameter file, for a log or for inputs that step."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Unpack
from warnings import warn

import numpy as np

from .block import ValidRange
from .errors import ExtrapolationWarning, LogError, Notice, UsageError, check_names
from .estimation.inputs import settle_holds
from .experiment import Experiment
from .families import get_family
from .family import Variant
from .logs import Log, LogLike, Reading, StepInput, require_agreement
from .logs import experiments as experiments_of
from .logs.columns import in_unit
from .logs.experiments import step_signal
from .outcome import Simulation, pair
from .parameters.document import ParameterDocument
from .recall import name_lost_columns, open_as_fitted, recall_logs
from .units import dimension_name, pressure_reference, same_dimension

_MOST_SAMPLES = 5_000_000


def variant_of(document: ParameterDocument) -> Variant:
    """The variant of a document's family."""
    return get_family(document.family).variant(document.variant)


def prepare_logs(
    document: ParameterDocument, logs: Sequence[Log], *, output: bool = False
) -> tuple[list[Experiment], list[Notice]]:
    """Turn logs whose columns are bound (:func:`recall_logs`) into runs, holds as in the file.

    Without ``output`` that of the model may be missing. Returned with the warnings; a log that
    lacks what the model needs is refused (``UsageError``, ``LogError``).
    """
    variant = variant_of(document)
    if not output:
        roles = tuple(replace(r, required=r.required and not r.output) for r in variant.roles)
        variant = replace(variant, roles=roles)
    logs = [name_lost_columns(document, log, variant.roles) for log in logs]
    require_agreement(logs, variant, _units_of_file(document))
    runs: list[Experiment] = []
    notices: list[Notice] = []
    for index, log in enumerate(logs):
        some, said = experiments_of(log, variant, index=index)
        runs += some
        notices += said
    return settle_holds(runs), [*notices, *beyond_validity(document, runs)]


def beyond_validity(document: ParameterDocument, runs: Sequence[Experiment]) -> list[Notice]:
    """Name the inputs that leave the range of the data which the file was fitted to."""
    found = []
    for role in variant_of(document).roles:
        covered = document.validity.get(role.name)
        if covered is None or role.output:
            continue
        known = ValidRange(covered.low, covered.high, covered.unit)
        for run in (r for r in runs if role.name in r):
            signal = run.signals[role.name]
            ends = [signal.values.min(), signal.values.max()]
            if signal.values.size == 1:  # of a step
                ends.append(signal.before)
            shown = partial(signal.text, form=".6g")
            if text := known.departure(role.name, np.array(ends, dtype=float), shown):
                found.append(Notice("beyond-validity", f"{run.name}: {text}."))
                break
    return found


def _units_of_file(document: ParameterDocument) -> dict[str, str]:
    """Units in which the fit took the roles: what they are counted from is in the provenance."""
    units = {role: covered.unit for role, covered in document.validity.items()}
    for source in document.provenance.logs:
        for role, column in source.columns.items():
            if role in units and pressure_reference(column.unit):
                units[role] = column.unit
    return units


def simulate_runs(document: ParameterDocument, runs: Sequence[Experiment]) -> list[Simulation]:
    """Simulate a document's model for runs that have been prepared.

    ``LogError`` where the numbers of the file and of the runs have no finite motion.
    """
    family = get_family(document.family)
    plant = document.plant(family)
    try:
        found = family.simulate(plant, runs, document.model.get("output_offset"))
    except (np.linalg.LinAlgError, ArithmeticError) as error:
        raise LogError(
            f"the model of the file cannot be simulated with these inputs: {error}.",
            where=", ".join(run.name for run in runs),
            expected="Expected values and options of the file, and inputs, of one machine.",
            remedy="Check the options of the file, and --unit and --scale of the log.",
        ) from error
    level = document.fit.level
    return pair(runs, found, plant.variant, level.value if level else None)


def simulate_logs(document: ParameterDocument, logs: Sequence[Log]) -> list[Simulation]:
    """Simulate a document's model with the inputs of logs, one entry per run.

    Everything that the fit settled is read from the file; nothing is settled here. The logs may
    lack the output role; ``measured`` is then NaN. See :func:`prepare_logs` for what is refused.
    An input beyond ``validity`` gives an ``ExtrapolationWarning``.
    """
    runs, notices = prepare_logs(document, recall_logs(document, logs))
    for notice in notices:
        if notice.code == "beyond-validity":
            warn(notice.message, ExtrapolationWarning, stacklevel=4)
    return simulate_runs(document, runs)


def simulate_given(
    document: ParameterDocument, logs: Sequence[LogLike] | LogLike, **reading: Unpack[Reading]
) -> list[Simulation]:
    """Open logs and simulate a document's model with their inputs; see :func:`simulate_logs`."""
    return simulate_logs(document, open_as_fitted(document, logs, **reading))


def simulate_steps(
    document: ParameterDocument,
    inputs: Mapping[str, StepInput],
    units: Mapping[str, str],
    duration: float,
    sample_time: float,
) -> list[Simulation]:
    """Simulate a document's model with inputs that step, without any log.

    ``inputs`` are steps by role [SI, or in ``units``], ``duration`` and ``sample_time`` in seconds.
    ``UsageError`` when an input is missing or there would be too many samples.
    """
    roles = [r for r in variant_of(document).roles if r.name != "time" and not r.output]
    check_names("--input", "input", inputs, [role.name for role in roles])
    for role in roles:
        if role.required and role.name not in inputs:
            raise UsageError(
                f"the input '{role.name}' is missing.",
                remedy=f"Give --input {role.name}=FROM:TO@T, or a LOG.",
            )
    samples = duration / sample_time
    if not 2 <= samples <= _MOST_SAMPLES:
        raise UsageError(
            f"{duration:g} s in steps of {sample_time:g} s are {samples:.3g} samples.",
            expected=f"Expected 2 to {_MOST_SAMPLES}.",
            remedy="Change --duration or --sample-time.",
        )
    for name, step in inputs.items():
        if step.at >= duration and step.start != step.end:
            raise UsageError(
                f"--input {name}: the step at {step.at:g} s comes after the end, {duration:g} s.",
                remedy="Give an earlier @T, or a longer --duration.",
            )
    time = sample_time * np.arange(round(samples) + 1, dtype=np.float64)
    signals = {}
    for role in roles:
        if role.name in inputs:
            covered = document.validity.get(role.name)
            step = inputs[role.name]
            known = covered.unit if covered else role.unit
            unit = step.unit or units.get(role.name) or known
            if step.unit and known != "1" and not same_dimension(step.unit, known):
                raise UsageError(
                    f"--input {role.name}: {step.unit} is {dimension_name(step.unit)}.",
                    expected=f"Expected numbers in {known}, or with a unit of the same quantity.",
                )
            where = f"--unit {role.name}={unit}"
            wanted = replace(in_unit(role, known), alternatives=())
            signals[role.name] = step_signal(wanted, step, where, unit)
    run = Experiment("inputs", 0, time, signals, sample_time, True)
    return simulate_runs(document, [run])


def to_csv(document: ParameterDocument, simulations: Sequence[Simulation]) -> str:
    """Return simulations as CSV: time, signals, simulated output; all in SI."""
    import pandas as pd  # slow to load

    units = {role: covered.unit for role, covered in document.validity.items()}
    output = variant_of(document).measured_in(units).output
    tables = []
    for simulation in simulations:
        run = simulation.experiment
        columns = {"time [s]": run.time} if run.time.size else {}
        for role, signal in run.signals.items():
            columns[f"{role} [{signal.unit}]"] = run.sampled(role)
        columns[f"{output.name}_simulated [{output.unit}]"] = simulation.simulated
        if any(0 < s.left_out < s.measured.size for s in simulations):
            columns["used"] = np.isfinite(simulation.measured).astype(float)
        tables.append(pd.DataFrame(columns))
    if len(tables) > 1:
        for number, table in enumerate(tables, start=1):
            table.insert(0, "run", number)
    text: str = pd.concat(tables).to_csv(
        index=False, float_format="%.12g", na_rep="nan", lineterminator="\n"
    )
    return text
