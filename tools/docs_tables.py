"""Parts of the pages that follow from the program: cog puts them between markers.

``make docs`` writes them, ``make lint`` fails where a page is behind. A page calls one of the
functions below, each of which returns Markdown, in a comment:

    <!-- [[[cog print(docs.family("line")) ]]] -->
    <!-- [[[end]]] -->

Run as a program, this module gives every family of the registry a page in ``docs/families``;
what a page says beside the tables stays.
"""

from __future__ import annotations

import inspect
import math
import os
import re
import shlex
import subprocess
import sys
import textwrap
from collections.abc import Iterable, Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import get_args

from pydantic import BaseModel
from pydantic.fields import FieldInfo

import fluidact_fit as ff
import fluidact_fit.errors
from fluidact_fit.assessment.policy import POLICY
from fluidact_fit.control import controller_file as controllers
from fluidact_fit.demo import load_dataset
from fluidact_fit.export import TARGETS, get_target, make_job
from fluidact_fit.families import family_title
from fluidact_fit.family import Family, FamilyOptions, ParameterSpec, Role, Variant
from fluidact_fit.notices import GROUPS, Code
from fluidact_fit.options import Option, describe
from fluidact_fit.parameters.document import ParameterDocument
from fluidact_fit.units.table import QUANTITIES

ROOT = Path(__file__).parents[1]
FAMILY_PAGES = ROOT / "docs" / "families"

# ------------------------------------------------------------------------------- Markdown


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table; a ``|`` within a cell is escaped."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("|" + "".join(map(_cell, line)) for line in lines)


def _cell(text: str) -> str:
    return " {} |".format(text.replace("|", "\\|")) if text else " |"


def _paragraphs(*parts: str) -> str:
    """Parts with an empty line around each, as comments and tables want it."""
    return "\n" + "\n\n".join(part for part in parts if part) + "\n"


def _code(name: str) -> str:
    return f"`{name}`"


# ------------------------------------------------------------------------------- families


def families() -> str:
    """Every family with its title and its notebook, for the top of a page."""
    rows = []
    for number, name in enumerate(ff.family_names(), 1):
        notebook = f"{number:02}_{name.replace('-', '_')}.ipynb"
        rows.append(
            (
                f"[{name}]({name}.md)",
                family_title(name),
                f"[{notebook}](../../notebooks/{notebook})",
            )
        )
    return _paragraphs(table(("family", "what", "notebook"), rows))


def sketches(folder: str, columns: int = 3) -> str:
    """Every family with the sketch of its machine and what it needs; ``folder`` has their pages."""
    cells = []
    for name in ff.family_names():
        page, what = f"{folder}{name}", family_title(name).partition(": ")[2]
        needed = [r.name for r in ff.get_family(name).variants[0].roles if r.required]
        cells.append(
            f"[![{name}]({page}.svg)]({page}.md)<br>[**{name}**]({page}.md)<br>{what}<br>"
            f"from *{', '.join(r for r in needed if r != 'time')}*"
        )
    rows = [cells[i : i + columns] for i in range(0, len(cells), columns)]
    return _paragraphs(table([" "] * columns, rows))


def remedies() -> str:
    """What to record for every parameter that a log may not determine, by family."""
    rows = []
    for name in ff.family_names():
        named: dict[str, dict[str, None]] = {}  # parameters of each remedy, in order
        for variant in ff.get_family(name).variants:
            for spec in variant.parameters:
                if spec.remedy:
                    named.setdefault(spec.remedy, {})[_code(spec.name)] = None
        rows += [(name, ", ".join(parameters), text) for text, parameters in named.items()]
    return _paragraphs(table(("family", "parameter", "record"), rows))


def equation(name: str) -> str:
    """Title and equation of a family."""
    family = ff.get_family(name)
    lines = [_wrapped(part) for part in family.equation.split("; ")]
    return _paragraphs(f"{family.title}.", "\n".join(["```text", *lines, "```"]))


def _wrapped(text: str) -> str:
    return textwrap.fill(
        text, 80, subsequent_indent="    ", break_long_words=False, break_on_hyphens=False
    )


def family(name: str) -> str:
    """Roles, parameters and options of a family."""
    found = ff.get_family(name)
    parts = []
    for heading, table_of in (("Roles", roles_table), ("Parameters", parameters_table)):
        tables: dict[str, list[str]] = {}  # variants that share one
        for variant in found.variants:
            tables.setdefault(table_of(variant), []).append(f"`{variant.name}`")
        for text, variants in tables.items():
            of = f" (variant {', '.join(variants)})" if len(tables) > 1 else ""
            parts += [f"## {heading}{of}", text]
    if options := options_table(found):
        parts += ["## Options", options]
    return _paragraphs(*parts)


def roles_table(variant: Variant) -> str:
    """Roles: name, units, hold, what they are."""
    rows = [
        (_code(role.name), _units(role), _code(role.hold) if role.hold else "", _role_text(role))
        for role in variant.roles
    ]
    return table(("role", "unit", "hold", "what"), rows)


def _units(role: Role) -> str:
    return " or ".join((role.unit, *role.alternatives))


def _role_text(role: Role) -> str:
    remarks = ("" if role.required else " (optional)") + (
        " (compared with the model)" if role.output else ""
    )
    return role.description + remarks


def parameters_table(variant: Variant) -> str:
    """Parameters: name, unit, neutral value, what they are."""
    return table(("parameter", "unit", "neutral", "what"), map(_parameter, variant.parameters))


def _parameter(spec: ParameterSpec) -> tuple[str, ...]:
    neutral = "" if spec.neutral is None else f"{spec.neutral:g}"
    text = spec.description + (" (optional)" if spec.optional else "")
    return _code(spec.name), spec.unit, neutral, text


def options_table(family: Family[FamilyOptions]) -> str:
    """Options: name, values with the default, what they do; empty without options.

    What the fit alone settles stands below: a reader of files meets it there.
    """
    every = describe(family.options_type, every=True)
    given = [(_flags(o), _values(o), o.help) for o in every if not o.settled]
    found = [(_code(o.name), _values(o), o.help) for o in every if o.settled]
    parts = [table(("option", "values", "what"), given)] if given else []
    if found:
        parts.append(table(("settled by the fit", "values", "what"), found))
    return "\n\n".join(parts)


_KINDS = {"float": "number", "int": "whole number", "text": "text", "range": "LOW:HIGH"}


def _flags(option: Option) -> str:
    name = f"`--{option.name}`"
    return f"{name} / `--no-{option.name}`" if option.kind == "flag" else name


def _values(option: Option) -> str:
    if option.kind == "flag":
        return ""
    values = " or ".join(map(_code, option.choices)) or _KINDS[option.kind]
    unit = f" [{option.unit}]" if option.unit else ""
    default = "" if option.default is None else f", default `{option.default}`"
    return f"{values}{unit}{default}"


def units() -> str:
    """Units that are read, by what they measure, the SI unit first."""
    rows = [
        (what.partition(" ")[2], ", ".join(map(_code, names))) for what, names in QUANTITIES.items()
    ]
    return _paragraphs(table(("quantity", "units"), rows))


# ------------------------------------------------------------------------------- commands


def example(name: str) -> str:
    """The command that fits the dataset of a family, as its README has it."""
    text = (ROOT / "datasets" / name / "README.md").read_text(encoding="utf-8")
    (command,) = re.findall(r"```sh\n.*?```", text, re.DOTALL)
    return _paragraphs(command)


def controller_file() -> str:
    """Keys of the controller file, section by section."""
    parts = []
    for kind, keys in controllers.KINDS.items():
        parts += [f"**`controller`**, `kind: {kind}`", _section_keys(keys)]
    for name, section in (
        ("machine", controllers.MachineKeys), ("tissue", controllers.TissueKeys),
        ("reference", controllers.ReferenceKeys), ("limits", controllers.LimitKeys),
    ):  # fmt: skip
        parts += [f"**`{name}`**", _section_keys(section)]
    return _paragraphs(*parts)


def _section_keys(section: type[FamilyOptions]) -> str:
    rows = [
        (_code(o.name.replace("-", "_")), o.expected, "" if o.default is None else str(o.default),
         o.help)
        for o in describe(section)
    ]  # fmt: skip
    return table(("key", "expected", "default", "what"), rows)


def exit_statuses() -> str:
    """Exit statuses, each with the errors that end in it."""
    meanings: dict[int, list[str]] = {0: ["done"], 1: ["a bug in the program"]}
    for error in vars(fluidact_fit.errors).values():  # in the order of the module
        if not isinstance(error, type) or not issubclass(error, ff.FluidactError):
            continue
        if error is not ff.FluidactError:
            meanings.setdefault(error.exit_status, []).append(_error_text(error))
    rows = [(str(status), "; ".join(meanings[status])) for status in sorted(meanings)]
    return _paragraphs(table(("status", "meaning"), rows))


def _error_text(error: type) -> str:
    """First sentence of an error's docstring without its exit status."""
    first = (inspect.getdoc(error) or "").partition("\n\n")[0]
    text = re.sub(r"\s*\(exit status \d\)", "", " ".join(first.split())).rstrip(".")
    return _lower(text).replace("``", "`")


def _lower(text: str) -> str:
    """A sentence as part of another one."""
    return text[:1].lower() + text[1:]


# ------------------------------------------------------------------------------- warnings


def warnings() -> str:
    """Every warning code, by the part of the work that finds it."""
    parts = []
    for title, codes in GROUPS.items():
        parts += [f"## {title}", _codes_table(codes)]
    return _paragraphs(*parts)


def _codes_table(codes: Mapping[str, Code]) -> str:
    rows = [(_code(name), code.severity, code.meaning, code.remedy) for name, code in codes.items()]
    return table(("code", "severity", "what it means", "what to do"), rows)


def thresholds() -> str:
    """Every threshold of the examination."""
    rows = [(_code(n), f"{t:g}", t.meaning, t.evidence) for n, t in POLICY.items()]
    return _paragraphs(table(("threshold", "value", "what it is", "study or test behind it"), rows))


# ------------------------------------------------------------------------------- the file

# What the document's own types do not say: parts that are text, or free in form.
_PARTS = {
    "format": "always `fluidact-parameters`",
    "format_version": "version of the layout",
    "family": "the model family",
    "variant": "which of the family's variants",
    "options": "the family's options as the fit settled them",
    "accepted_failed": "`true` when the verdict was `fail` and the file was written anyway",
    "model": "what a controller runs: transfer functions with falling powers of `s` and of `z`, "
    "curves, dead zones",
    "validation": "logs given with `--validate`: simulated, never fitted; a miss is warned of",
}


def parts() -> str:
    """Every key of a parameter file with the keys it holds."""
    rows = [
        (_code(name), _keys(field), _part_text(name, field))
        for name, field in ParameterDocument.model_fields.items()
    ]
    return _paragraphs(table(("part", "keys", "what it holds"), rows))


def _models(annotation: object) -> list[type[BaseModel]]:
    """Models within an annotation: that of ``list[Part] | None``."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [model for part in get_args(annotation) for model in _models(part)]


def _keys(field: FieldInfo) -> str:
    named = [", ".join(map(_code, model.model_fields)) for model in _models(field.annotation)]
    container = str(field.annotation).partition("[")[0]
    each = {"dict": "by name: ", "list": "each: "}.get(container, "") if named else ""
    return each + "; ".join(named)


def _part_text(name: str, field: FieldInfo) -> str:
    models = [_lower(inspect.getdoc(model) or "") for model in _models(field.annotation)]
    text = field.description or _PARTS.get(name) or " ".join(models)
    return " ".join(text.split()).rstrip(".")


# --------------------------------------------------------------------- a fit of today


def fitted_file(name: str, *parts: str) -> str:
    """The parameter file that the dataset of a family gives today: its head, and some parts.

    Fitting takes seconds, and a number typed by hand is out of date tomorrow.
    """
    document = _fit(name).document.to_dict()
    heads = [f"{key}: {document[key]}" for key in ("format", "format_version", "family")]
    entries = document["parameters"]
    width = max(map(len, entries)) + 1
    heads.append("parameters:")
    heads += [f"  {n + ':':{width}} {_flow(_shortened(p))}" for n, p in entries.items()]
    for part in parts:
        heads.append(f"{part}:")
        heads += [f"  {key}: {_flow(_brief(value))}" for key, value in document[part].items()]
    return "\n".join(["", "```yaml", *heads, "```", ""])


def search_cost(name: str) -> str:
    """What the search of that fit has cost, as the file says it."""
    details = _fit(name).document.to_dict()["fit"]["details"]
    return _paragraphs(f"```yaml\nsearch: {_flow(details['search'])}\n```")


@lru_cache
def _fit(name: str) -> ff.FitResult:
    data = load_dataset(name)
    return ff.fit(name, data.read(), **data.options)


def _shortened(entry: Mapping[str, object]) -> dict[str, object]:
    """A parameter to two digits of its standard error."""
    error = float(str(entry["std_error"]))
    digits = max(0, 1 - math.floor(math.log10(error)))
    out: dict[str, object] = {}
    for key in ("value", "unit", "std_error", "ci95", "status"):
        value = entry[key]
        numbers = value if isinstance(value, list) else [value]
        texts = [_flow(v) if isinstance(v, str) else f"{v:.{digits}f}" for v in numbers]
        out[key] = texts if isinstance(value, list) else texts[0]
    return out


def _brief(value: object) -> object:
    """Numbers to five digits, long texts and nested parts left out."""
    if isinstance(value, float):
        return float(f"{value:.5g}")
    if isinstance(value, list):
        return [_brief(v) for v in value] if all(isinstance(v, float) for v in value) else "[...]"
    return {k: _brief(v) for k, v in value.items()} if isinstance(value, dict) else value


def _flow(value: object) -> str:
    """YAML on one line; texts stand as they are."""
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{k}: {_flow(v)}" for k, v in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(_flow, value)) + "]"
    return '"1"' if value == "1" else str(value)


# ------------------------------------------------------------------ what the program prints


def run(arguments: str) -> str:
    """A command of the program and what it prints today."""
    printed = _printed(f"fluidact-fit {arguments}")
    return _paragraphs(f"```sh\nfluidact-fit {arguments}\n```", f"```text\n{printed}\n```")


def session(*commands: str) -> str:
    """Commands as they are typed, each with what it prints today."""
    lines = [f"$ {command}\n{_printed(command)}" for command in commands]
    return "\n".join(["```console", *lines, "```"])


def _printed(command: str) -> str:
    """What a command prints on either stream without its progress, and its end unless with 0.

    It runs in an empty folder, beside which ``datasets`` and ``tests`` are those of the repository.
    """
    with TemporaryDirectory() as folder:
        for name in ("datasets", "tests"):
            (Path(folder) / name).symlink_to(ROOT / name)
        programs = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
        done = subprocess.run(
            shlex.split(command), cwd=folder, text=True, check=False,
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
            env={**os.environ, "COLUMNS": "80", "PATH": programs},
        )  # fmt: skip
    status = f"\n(exit status {done.returncode})" if done.returncode else ""
    printed = re.sub(r"^.* \.\.\. \(\d+ s\)\n", "", done.stdout, flags=re.MULTILINE)
    return f"{printed.rstrip()}{status}"


def benchmark(problem: str, tools: Sequence[str]) -> str:
    """Rows of a problem's table in the committed benchmark, as they stand there."""
    text = (ROOT / "docs" / "evidence" / "benchmark.md").read_text(encoding="utf-8")
    section = text.partition(f"### {problem}: ")[2].partition("###")[0]
    lines = [line for line in section.splitlines() if line.startswith("|")]
    rows = {line.split("|")[1].strip().strip("*"): line for line in lines[2:]}
    return _paragraphs("\n".join([*lines[:2], *(rows[tool] for tool in tools)]))


# ------------------------------------------------------------------------------- exports


def targets() -> str:
    """Every export target with what it gives."""
    rows = [(_code(name), entry.title) for name, entry in TARGETS.items()]
    return _paragraphs(table(("`--to`", "what"), rows))


def exported(name: str, to: str, suffix: str, language: str, most: int = 40) -> str:
    """A file of the export of a family's golden parameter file, or its first lines."""
    path = ROOT / "tests" / "golden" / ff.__version__ / f"{name}.yaml"
    job = make_job(path, ff.load(path))
    lines = get_target(to)(job)[f"{job.name}{suffix}"].decode().splitlines()
    more = ["..."] if len(lines) > most else []
    return "\n".join(["", f"```{language}", *lines[:most], *more, "```", ""])


# ------------------------------------------------------------------------ pages of families


def new_page(name: str) -> str:
    """The page of a family that has none: its docstring between the generated blocks."""
    prose = inspect.getdoc(type(ff.get_family(name))) or ""
    return textwrap.dedent(
        f"""\
        # {name}

        ![The machine]({name}.svg)

        <!-- [[[cog print(docs.equation("{name}")) ]]] -->
        <!-- [[[end]]] -->

        @

        <!-- [[[cog print(docs.family("{name}")) ]]] -->
        <!-- [[[end]]] -->

        ## Example

        <!-- [[[cog print(docs.example("{name}")) ]]] -->
        <!-- [[[end]]] -->
        """
    ).replace("@", prose)


def arrange_pages(folder: Path) -> None:
    """Give every family its page; a page without a family is removed."""
    names = ff.family_names()
    for page in folder.glob("*.md"):
        if page.stem not in (*names, "index"):
            page.unlink()
    for name in names:
        if not (page := folder / f"{name}.md").exists():
            page.write_text(new_page(name), encoding="utf-8", newline="\n")


if __name__ == "__main__":
    arrange_pages(FAMILY_PAGES)
