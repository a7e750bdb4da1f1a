"""What a dataset consists of, and how it is written down: logs, truth, README."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
TRIALS = 3


@dataclass(frozen=True)
class Truth:
    """A true value in SI; ``origin`` is where it was published, empty when invented."""

    value: float | list[float]
    unit: str
    origin: str = ""
    note: str = ""


@dataclass(frozen=True)
class Column:
    """A column of a log: header, meaning, digits after the point."""

    header: str
    meaning: str
    digits: int


@dataclass(frozen=True)
class Dataset:
    """One directory: how to simulate a trial and everything its README says.

    Attributes
    ----------
    family
        Name of the family, and of the directory.
    title, source, conditions
        For the README: what it is, whose rig it imitates, and how the logs were made.
    seed
        Of the random numbers; that of a trial has its number appended.
    simulate
        ``simulate(rng, trial)`` returns the columns of a log, shape ``(n,)`` each.
    columns, roles, options
        Of the logs; role to header; family options as in Python.
    truth, physics
        Parameters by name that the fit should find, and what made the logs of a family whose
        parameters mean nothing by themselves.
    tolerance
        For a curve: how far it may lie from the true one, value and unit.
    delimiter, decimal
        Of the logs.
    """

    family: str
    title: str
    source: str
    seed: tuple[int, int]
    simulate: Callable[[np.random.Generator, int], list[Array]]
    columns: tuple[Column, ...]
    roles: Mapping[str, str]
    truth: Mapping[str, Truth]
    conditions: tuple[str, ...]
    options: Mapping[str, float | str] = field(default_factory=dict)
    physics: Mapping[str, Truth] = field(default_factory=dict)
    tolerance: tuple[float, str] | None = None
    delimiter: str = ","
    decimal: str = "."


def scalar(truth: Mapping[str, Truth], name: str) -> float:
    """A true value as a number."""
    value = truth[name].value
    assert isinstance(value, float)
    return value


def name_logs() -> list[str]:
    """File names of the logs."""
    return [f"trial{i + 1}.csv" for i in range(TRIALS)]


def format_log(data: Dataset, columns: Sequence[Array]) -> str:
    """The text of a log; a zero never has a sign, which would depend on the machine's sine."""
    lines = [data.delimiter.join(c.header for c in data.columns)]
    digits = [c.digits for c in data.columns]
    for row in zip(*(c.tolist() for c in columns)):
        cells = (f"{v:.{d}f}" for v, d in zip(row, digits))
        cells = (c[1:] if c[0] == "-" and float(c) == 0.0 else c for c in cells)
        lines.append(data.delimiter.join(c.replace(".", data.decimal) for c in cells))
    return "\n".join(lines) + "\n"


def make_arguments(data: Dataset) -> list[str]:
    """Columns and family options for the command line; what it finds itself is left out."""
    out = []
    for role, header in data.roles.items():
        if header.split(" ")[0] not in (role, "t" if role == "time" else role):
            out += ["--column", f"{role}={header}"]
    for name, value in data.options.items():
        shown = value if isinstance(value, str) else format_number(value)
        out += [f"--{name.replace('_', '-')}", shown]
    return out


def format_command(data: Dataset) -> str:
    """The command that fits the dataset, for a shell in the root of the repository."""
    arguments = make_arguments(data)
    lines = [
        f"fluidact-fit {data.family}",
        " ".join(f"datasets/{data.family}/{n}" for n in name_logs()),
    ]
    lines += [f"{a} {_quote(b)}" for a, b in zip(arguments[::2], arguments[1::2])]
    return " \\\n    ".join([*lines, f"-o {data.family}.yaml"])


def _quote(text: str) -> str:
    return f'"{text}"' if any(c in text for c in " ()[]") else text


def format_number(value: float) -> str:
    """A number that every YAML reader takes as a float."""
    if value != 0.0 and not 1e-3 <= abs(value) < 1e6:
        short = next(s for d in range(1, 18) if float(s := f"{value:.{d}e}") == value)
        mantissa, exponent = short.split("e")
        return f"{mantissa}e{int(exponent):+03d}"
    return repr(float(value))


def _format_value(value: float | list[float]) -> str:
    if isinstance(value, list):
        return "[" + ", ".join(format_number(v) for v in value) + "]"
    return format_number(value)


def _truth_lines(truth: Mapping[str, Truth]) -> list[str]:
    out = []
    for name, t in truth.items():
        origin = "published" if t.origin else "invented"
        extra = f', source: "{t.origin}"' if t.origin else ""
        extra += f', note: "{t.note}"' if t.note else ""
        value = _format_value(t.value)
        out.append(f'  {name}: {{value: {value}, unit: "{t.unit}", origin: {origin}{extra}}}')
    return out


def format_truth(data: Dataset) -> str:
    """The text of ``truth.yaml``."""
    quoted = ", ".join(f'"{a}"' for a in make_arguments(data))
    lines = [
        "# Written by datasets/generate.py. The logs are synthetic; these values made them.",
        f"family: {data.family}",
        "synthetic: true",
        f"seed: {list(data.seed)}",
        f"logs: [{', '.join(name_logs())}]",
        "columns:",
        *(f'  {role}: "{header}"' for role, header in data.roles.items()),
        f"arguments: [{quoted}]",
        "options:" if data.options else "options: {}",
    ]
    for name, option in data.options.items():
        lines.append(f"  {name}: {option if isinstance(option, str) else format_number(option)}")
    if data.tolerance:
        value, unit = data.tolerance
        lines += [
            "# The curve counts, not the numbers that draw it: degrees may differ.",
            f"curve: {{tolerance: {format_number(value)}, unit: {unit}}}",
        ]
    lines += ["parameters:" if data.truth else "parameters: {}", *_truth_lines(data.truth)]
    if data.physics:
        lines += ["# The parameters have no true values. What made the logs:", "physics:"]
        lines += _truth_lines(data.physics)
    return "\n".join(lines) + "\n"


def format_readme(data: Dataset) -> str:
    """The text of a directory's README."""
    rows = []
    for name, t in (data.truth or data.physics).items():
        origin = f"published ({t.origin})" if t.origin else "**invented**"
        note = f"; {t.note}" if t.note else ""
        rows.append(f"| `{name}` | {_format_value(t.value)} {t.unit} | {origin}{note} |")
    seed = ", ".join(str(n) for n in data.seed)
    numbers = {n: v for n, v in data.options.items() if not isinstance(v, str)}
    given = [f"| `--{n.replace('_', '-')}` | {format_number(v)} |" for n, v in numbers.items()]
    head = ["## Given by options", "", "| option | value (SI) |", "|---|---|", *given, ""]
    return "\n".join(
        [
            f"# {data.title}",
            "",
            f"**Synthetic**: nobody measured these logs. They imitate {data.source}, with the "
            "numbers it published",
            "where they are known. `datasets/generate.py` writes this directory; seed "
            f"`[{seed}, trial]`.",
            "",
            "## Conditions",
            "",
            *(f"- {c}" for c in data.conditions),
            "",
            "## Columns",
            "",
            "| header | meaning |",
            "|---|---|",
            *(f"| `{c.header}` | {c.meaning} |" for c in data.columns),
            "",
            f"Separator `{data.delimiter}`, decimal `{data.decimal}`, UTF-8, one header line.",
            "",
            *(head if given else []),
            "## True parameters" if data.truth else "## What made the logs",
            "",
            "| parameter | value | origin |",
            "|---|---|---|",
            *rows,
            "",
            "The same, for programs: `truth.yaml`.",
            "",
            "## Fit",
            "",
            "```sh",
            format_command(data),
            "```",
            "",
        ]
    )


def write_dataset(data: Dataset, directory: Path) -> None:
    """Write one dataset below ``directory``."""
    folder = directory / data.family
    folder.mkdir(parents=True, exist_ok=True)
    texts = {"README.md": format_readme(data), "truth.yaml": format_truth(data)}
    for trial, name in enumerate(name_logs()):
        rng = np.random.default_rng([*data.seed, trial])
        texts[name] = format_log(data, data.simulate(rng, trial))
    for name, text in sorted(texts.items()):
        (folder / name).write_bytes(text.encode("utf-8"))


def write_checksums(directory: Path) -> None:
    """Write the checksums of all datasets."""
    sums = [
        f"{hashlib.sha256(p.read_bytes()).hexdigest()}  {p.relative_to(directory).as_posix()}\n"
        for p in sorted(directory.glob("*/*.*"))
        if p.suffix in (".csv", ".md", ".yaml")
    ]
    (directory / "SHA256SUMS").write_bytes("".join(sums).encode("utf-8"))
