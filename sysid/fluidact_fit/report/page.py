"""One self-contained HTML page per result: nothing is loaded from elsewhere."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ..arguments import require
from ..comparison import Comparison
from ..families import get_family
from ..files import check_suffix
from ..notices import is_note
from ..outcome import Outcome
from ..parameter_table import recorded_units
from ..parameters import ParameterDocument, dump_yaml, write_atomically
from ..parameters.document import Derived
from ..tables import format_interval, probability_text
from .compared import plot_comparison
from .equation import typeset
from .figure import plot_result, plot_validation
from .html import (
    Picture,
    code,
    escape,
    folded,
    header,
    pictures,
    scrolling,
    section,
    table,
    whole_page,
)
from .numbers import (
    choose_scale,
    count,
    flatten,
    in_print,
    in_scale,
    percent,
    pretty_unit,
    scaled,
    short,
    show,
)
from .reading import picture
from .responses import responses_picture
from .words import describe_fit, describe_validation

_MOST_CORRELATED = 24
_FAR = 2.0  # standard errors
_QUANTITY = ("name", "value ± standard error", "unit", "95 % interval")


def write_html(result: Outcome, path: str | os.PathLike[str], *, overwrite: bool = False) -> Path:
    """Write the report of a fit as one HTML file with its pictures inside.

    Parameters
    ----------
    result
        A finished fit.
    path
        Ends with ``.html`` or ``.htm``.
    overwrite
        Whether an existing file may be replaced.

    Raises
    ------
    UsageError
        When the suffix is another.
    OutputError
        When the file exists and may not be replaced, or cannot be written.
    """
    require("path", path=path)
    check_suffix(os.fspath(path), path, (".html", ".htm"))
    page = result_page(result)
    return write_atomically(path, page, overwrite=overwrite, inputs=result.inputs)


def write_document_html(
    document: ParameterDocument,
    path: str | os.PathLike[str],
    *,
    comparison: Comparison | None = None,
    overwrite: bool = False,
) -> Path:
    """Write the report of a parameter file alone; see :func:`write_html`.

    With a ``comparison``, of which the document is the first file, the others stand beside it.
    """
    require("path", path=path)
    check_suffix(os.fspath(path), path, (".html", ".htm"))
    return write_atomically(path, document_page(document, (), comparison), overwrite=overwrite)


def result_page(result: Outcome) -> str:
    """The page of a fit, pictures included."""
    title = "The model against the data it was fitted to"
    shown = [picture(plot_result(result), title, describe_fit(result))]
    if (responses := responses_picture(result)) is not None:
        shown.append(responses)
    judged = plot_validation(result)
    if judged is not None:
        title = "The model against logs that were not fitted"
        shown.append(picture(judged, title, describe_validation(result)))
    return document_page(result.document, shown)


def document_page(
    document: ParameterDocument,
    shown: Sequence[Picture] = (),
    comparison: Comparison | None = None,
) -> str:
    """The page of a parameter document, with pictures and a comparison where there are any."""
    sections = (
        _equation, _parameters, _derived, _comparisons, _logs, _validity, _notes, _correlation,
        _model, _provenance,
    )  # fmt: skip
    beside = "" if comparison is None else _beside(comparison)
    parts = [_header(document), _warnings(document), pictures(shown), beside,
             *(part(document) for part in sections)]  # fmt: skip
    return whole_page(f"{document.family}: {document.fit.verdict}", parts)


def _beside(comparison: Comparison) -> str:
    """Other files beside the first: a table, what it says, and a picture of the differences."""
    found = comparison.table()
    rows = [
        [code(name), escape(pretty_unit(unit)), *(escape(in_print(cell)) for cell in cells)]
        for name, unit, *cells in found.rows
    ]
    said = "".join(f"<li>{escape(text)}</li>" for text in comparison.conclusions)
    figure, title = plot_comparison(comparison), "Differences, and their 95 % intervals"
    shown = [] if figure is None else [picture(figure, title, _compared(comparison))]
    heads, numeric = found.head, range(2, len(found.head))
    numbers = section("Comparison with other files", heads, rows, numeric=numeric)
    return f"{numbers}<ul>{said}</ul>{pictures(shown)}"


def _compared(comparison: Comparison) -> str:
    """The picture of the differences in words."""
    first, *others = comparison.files
    said = []
    for k, name in enumerate(others):
        far = [p.name for p in comparison.parameters if abs(p.deviations[k] or 0.0) > _FAR]
        said.append(f"{name}: " + (", ".join(far) if far else "none"))
    return (
        f"Every parameter of the other files less that of {first}, in per cent of it, with 95 % "
        f"intervals. Parameters that differ by more than 2 standard errors: {'; '.join(said)}."
    )


def _header(document: ParameterDocument) -> str:
    fit, logs = document.fit, len(document.provenance.logs)
    facts = [
        f"fit {percent(fit.fit_percent)}",
        f"rmse {scaled(fit.rmse.value, fit.rmse.unit, recorded_units(document))}",
        f"{count(fit.samples)} samples",
        f"{logs} log{'s' * (logs != 1)}",
    ]
    accepted = "This fit failed and was accepted by the user (--accept-failed)."
    title, remark = get_family(document.family).title, accepted if document.accepted_failed else ""
    return header(title, facts, fit.verdict, remark)


def _warnings(document: ParameterDocument) -> str:
    return _listed("Warnings, and what to do", document, notes=False)


def _notes(document: ParameterDocument) -> str:
    return _listed("Notes: what was done with the logs", document, notes=True)


def _listed(title: str, document: ParameterDocument, *, notes: bool) -> str:
    """Notices that change the verdict, or those that leave it as it is."""
    items = "".join(
        f"<li>{code(w.code)}: {escape(w.message)}</li>"
        for w in document.warnings
        if is_note(w.code) == notes
    )
    return f"<h2>{escape(title)}</h2><ul>{items}</ul>" if items else ""


def _equation(document: ParameterDocument) -> str:
    family = get_family(document.family)
    variant = family.variant(document.variant)
    absent = {p.name for p in variant.parameters} - document.parameters.keys()
    equation = typeset(variant.equation or family.equation, absent)
    return f"<h2>Equation</h2>{scrolling('Equation', equation, 'equation')}"


def _parameters(document: ParameterDocument) -> str:
    specs = {p.name: p for p in get_family(document.family).variant(document.variant).parameters}
    rows, units = [], recorded_units(document)
    for name, q in document.parameters.items():
        shown, text = escape(q.status.replace("_", " ")), escape(specs[name].description)
        if q.status == "not_identified":
            shown = f'<span class="bad">{shown}</span>'
            remedy = escape(specs[name].remedy)
            text += f'<br><span class="faint">{remedy}</span>' if remedy else ""
        rows.append([*_quantity(name, q, units), shown, text])
    heads = (*_QUANTITY, "status", "meaning")
    return section("Parameters", heads, rows, numeric=(1, 3), kind="explained")


def _derived(document: ParameterDocument) -> str:
    units = recorded_units(document)
    rows = [_quantity(name, q, units) for name, q in document.derived.items()]
    shown = len(_QUANTITY) if any(row[-1] for row in rows) else len(_QUANTITY) - 1  # intervals
    rows = [row[:shown] for row in rows]
    return section("Derived from the parameters", _QUANTITY[:shown], rows, numeric=(1, 3))


def _quantity(name: str, q: Derived, units: Sequence[str]) -> list[str]:
    """Name, value with its error in a unit of the log and in SI, unit and interval."""
    value, error, scale = in_scale(q, units)
    interval = ""
    if isinstance(value, list):
        text = _list_table(value, error)
    else:
        text = escape(show(value, error))
        if scale.factor != 1.0 and value:
            in_si = f"{show(q.value, q.std_error)} {pretty_unit(q.unit)}"
            text += f'<br><span class="faint">{escape(in_si)}</span>'
        if q.ci95 is not None:
            ends = [scale.factor * end for end in flatten(q.ci95)]
            interval = in_print(format_interval(ends, error))
    return [code(name), text, escape(scale.unit), escape(interval)]


def _list_table(value: list[Any], error: list[Any] | None) -> str:
    """All entries of a list, folded away when there are many."""
    values = flatten(value)
    errors = [None] * len(values) if error is None else flatten(error)
    rows = "<br>".join(escape(show(v, e)) for v, e in zip(values, errors))
    if len(values) <= 8:
        return rows
    return f"<details><summary>{escape(show(value))}</summary>{rows}</details>"


def _comparisons(document: ParameterDocument) -> str:
    """Tables in which a fit set models side by side: ``fit.details.comparisons``."""
    out = ""
    for title, rows in (document.fit.details or {}).get("comparisons", {}).items():
        heads = list(dict.fromkeys(key for row in rows for key in row))
        numeric = [k for k, h in enumerate(heads) if isinstance(rows[0].get(h), int | float)]
        cells = [[_cell(row.get(h, "")) for h in heads] for row in rows]
        out += section(title, [h.replace("_", " ") for h in heads], cells, numeric)
    return out


def _cell(value: Any) -> str:
    return escape(short(value, 3) if isinstance(value, float) else str(value))


def _logs(document: ParameterDocument) -> str:
    kinds = (("fitted", document.fit.logs), ("judged", document.validation))
    sizes = [e.rmse.value for _, entries in kinds for e in entries if e.rmse]
    units = recorded_units(document)
    scale = choose_scale(document.fit.rmse.unit, max(sizes, default=0.0), units)
    rows = [
        [escape(e.file), kind, "" if e.samples is None else count(e.samples),
         escape(f"{short(e.rmse.value * scale.factor, 3)} {scale.unit}") if e.rmse else "",
         escape(percent(e.fit_percent))]
        for kind, entries in kinds for e in entries
    ]  # fmt: skip
    if not rows:
        return ""
    title, heads = "Agreement with each log", ("log or run", "use", "samples", "rmse", "fit")
    shown = table(title, heads, rows, numeric=(2, 3, 4))
    if len(rows) > 12:
        shown = f"<details><summary>{len(rows)} runs</summary>{shown}</details>"
    return f"<h2>{title}</h2>{shown}{_whiteness(document)}"


def _whiteness(document: ParameterDocument) -> str:
    w = document.fit.residual_whiteness
    if w is None:
        return ""
    text = escape(probability_text(w.p_value))
    if w.p_value >= 0.01:
        return f'<p class="faint">Residuals are white ({text}).</p>'
    return (
        f'<p class="faint">Residuals are not random from sample to sample ({text}): the noise '
        "lasts longer than a sample, which the intervals allow for, or the model lacks something. "
        "Where that would move a parameter beyond its interval, a warning names it.</p>"
    )


def _validity(document: ParameterDocument) -> str:
    rows = []
    for role, r in document.validity.items():
        scale = choose_scale(r.unit, max(abs(r.low), abs(r.high)), recorded_units(document))
        low, high = (short(end * scale.factor, 5) for end in (r.low, r.high))
        rows.append([code(role), low, high, escape(scale.unit)])
    title = "Range of the data: outside it the model extrapolates"
    return section(title, ("role", "low", "high", "unit"), rows, numeric=(1, 2))


def _correlation(document: ParameterDocument) -> str:
    if document.covariance is None:
        return ""
    order, matrix = document.covariance.order, document.covariance.matrix
    title = "Correlation of the estimates"
    if len(order) > _MOST_CORRELATED:
        return (
            f'<h2>{title}</h2><p class="faint">{len(order)} numbers; the covariance is in the '
            "file.</p>"
        )
    spread = [matrix[k][k] ** 0.5 for k in range(len(order))]
    top = "".join(f'<th scope="col"><span>{escape(n)}</span></th>' for n in order)
    body = ""
    for name, row, own in zip(order, matrix, spread):
        cells = "".join(_heat(value, own * other) for value, other in zip(row, spread))
        body += f'<tr><th scope="row">{escape(name)}</th>{cells}</tr>'
    shown = f"<table><thead><tr><td></td>{top}</tr></thead><tbody>{body}</tbody></table>"
    return f"<h2>{title}</h2>{scrolling(title, shown, 'heat')}"


def _heat(covariance: float, scale: float) -> str:
    """A cell, blue for negative and orange for positive correlation."""
    if scale <= 0.0:
        return "<td>–</td>"
    rho = min(max(covariance / scale, -1.0), 1.0)
    text = f"{rho:+.2f}".replace("-", "−")
    sign = "pos" if rho > 0.0 else "neg"
    return f'<td class="{sign}" style="--rho:{100.0 * abs(rho):.0f}%">{text}</td>'


def _model(document: ParameterDocument) -> str:
    """Model section of the file, without the file's first comment."""
    if not document.model:
        return ""
    lines = dump_yaml(document.to_dict()["model"]).splitlines()
    shown = "\n".join(line for line in lines if not line.startswith("#"))
    title = "Model in the file: what a controller runs"
    return folded(title, f'<pre tabindex="0" aria-label="{title}">{escape(shown)}</pre>')


def _provenance(document: ParameterDocument) -> str:
    p = document.provenance
    rows = [
        ["written by", escape(f"{p.tool.name} {p.tool.version}")],
        ["on", escape(p.created)],
    ]
    if p.command is not None:
        rows.append(["command", f'<span class="command">{code(p.command)}</span>'])
    if p.seed is not None:
        rows.append(["seed", str(p.seed)])
    for log in p.logs:
        columns = "; ".join(
            f"{role} ← {'?' if c.header is None else c.header}" + (f" [{c.unit}]" if c.unit else "")
            for role, c in log.columns.items()
        )
        rows.append(
            ["log", f"{escape(log.file)} · {count(log.rows)} rows · {escape(columns)}<br>"
             f'<span class="faint command"><code>sha256 {log.sha256}</code></span>']
        )  # fmt: skip
    return folded("Provenance", table("Provenance", ("", ""), rows))
