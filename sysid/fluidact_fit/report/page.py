"""One self-contained HTML page per result: no script, nothing loaded from elsewhere."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ..comparison import Comparison
from ..errors import UsageError
from ..families import get_family
from ..outcome import Outcome
from ..parameters import ParameterDocument, dump_yaml, write_atomically
from ..parameters.document import Derived, Measure
from .compared import plot_comparison
from .figure import plot_result, plot_validation
from .html import code, escape, pictures, section, table, whole_page
from .numbers import count, flatten, percent, pretty_unit, short, show
from .save import render

_MOST_CORRELATED = 24
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
    _check_suffix(path)
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
    _check_suffix(path)
    return write_atomically(path, document_page(document, (), comparison), overwrite=overwrite)


def _check_suffix(path: str | os.PathLike[str]) -> None:
    if Path(path).suffix.lower() not in (".html", ".htm"):
        raise UsageError(
            "a report is an HTML page",
            where=os.fspath(path),
            expected="A name that ends with .html.",
        )


def result_page(result: Outcome) -> str:
    """The page of a fit, pictures included."""
    figures = [("The model against the data it was fitted to", render(plot_result(result), "svg"))]
    judged = plot_validation(result)
    if judged is not None:
        figures.append(("The model against logs that were not fitted", render(judged, "svg")))
    return document_page(result.document, figures)


def document_page(
    document: ParameterDocument,
    figures: Sequence[tuple[str, bytes]] = (),
    comparison: Comparison | None = None,
) -> str:
    """The page of a parameter document; ``figures`` are description and SVG of each picture."""
    sections = (
        _warnings, _parameters, _derived, _comparisons, _logs, _validity, _correlation, _model,
        _provenance,
    )  # fmt: skip
    beside = "" if comparison is None else _beside(comparison)
    parts = [_header(document), pictures(figures), beside, *(part(document) for part in sections)]
    return whole_page(f"{document.family}: {document.fit.verdict}", parts)


def _beside(comparison: Comparison) -> str:
    """Other files beside the first: a table, what it says, and a picture of the differences."""
    first, *others = comparison.files
    heads = ["name", "unit", escape(first)]
    for name in others:
        heads += [escape(name), "differs by"]
    rows = []
    for p in comparison.parameters:
        row = [code(p.name), escape(pretty_unit(p.unit))]
        columns = zip(p.values, p.std_errors, p.statuses, p.deviations)
        for k, (value, error, status, z) in enumerate(columns):
            text = (status or "-").replace("_", " ")
            if value is not None and status != "not_identified":
                text = show(value, error)
            row.append(escape(text))
            row += [("" if z is None else f"{z:+.1f}".replace("-", "−"))] if k else []
        rows.append(row)
    said = "<li>Differences are in standard errors of the difference.</li>"
    said += "".join(f"<li>{escape(t.words)}</li>" for t in comparison.together)
    figure, alt = plot_comparison(comparison), "Differences, and their 95 % intervals"
    shown = [] if figure is None else [(alt, render(figure, "svg"))]
    numbers = section("Beside other files", heads, rows, numeric=range(2, len(heads)))
    return f"{numbers}<ul>{said}</ul>{pictures(shown)}"


def _header(document: ParameterDocument) -> str:
    fit, verdict = document.fit, document.fit.verdict
    parts = (
        f"fit {percent(fit.fit_percent)}",
        f"rmse {_rmse(fit.rmse)}",
        f"{count(fit.samples)} samples",
        f"{len(document.provenance.logs)} log(s)",
    )
    accepted = (
        '<p class="bad">This fit failed and was accepted by the user (--accept-failed).</p>'
        if document.accepted_failed
        else ""
    )
    return (
        f'<header><div><h1>{escape(get_family(document.family).title)}</h1><p class="sub">'
        f"{escape('   ·   '.join(parts))}</p>{accepted}</div>"
        f'<div class="verdict {verdict}">{verdict.upper()}</div></header>'
    )


def _rmse(rmse: Measure) -> str:
    return f"{short(rmse.value, 3)} {pretty_unit(rmse.unit)}"


def _warnings(document: ParameterDocument) -> str:
    items = "".join(f"<li>{code(w.code)}: {escape(w.message)}</li>" for w in document.warnings)
    return f"<h2>Warnings, and what to do</h2><ul>{items}</ul>" if items else ""


def _parameters(document: ParameterDocument) -> str:
    specs = {p.name: p for p in get_family(document.family).variant(document.variant).parameters}
    rows = []
    for name, q in document.parameters.items():
        shown, text = escape(q.status.replace("_", " ")), escape(specs[name].description)
        if q.status == "not_identified":
            shown = f'<span class="bad">{shown}</span>'
            remedy = escape(specs[name].remedy)
            text += f'<br><span class="faint">{remedy}</span>' if remedy else ""
        rows.append([*_quantity(name, q), shown, text])
    return section("Parameters", (*_QUANTITY, "status", "meaning"), rows, numeric=(1, 3))


def _derived(document: ParameterDocument) -> str:
    rows = [_quantity(name, q) for name, q in document.derived.items()]
    return section("Derived from the parameters", _QUANTITY, rows, numeric=(1, 3))


def _quantity(name: str, q: Derived) -> list[str]:
    """Name, value with its error, unit and interval."""
    listed, interval = isinstance(q.value, list), ""
    value = _list_table(q) if listed else escape(show(q.value, q.std_error))
    if q.ci95 is not None and not listed:
        low, high = flatten(q.ci95)
        interval = f"{short(low, 5)} … {short(high, 5)}"
    return [code(name), value, escape(pretty_unit(q.unit)), interval]


def _list_table(q: Derived) -> str:
    """All entries of a list, folded away when there are many."""
    values = flatten(q.value)
    errors = [None] * len(values) if q.std_error is None else flatten(q.std_error)
    rows = "<br>".join(escape(show(v, e)) for v, e in zip(values, errors))
    if len(values) <= 8:
        return rows
    return f"<details><summary>{escape(show(q.value))}</summary>{rows}</details>"


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
    rows = [
        [escape(e.file), kind, "" if e.samples is None else count(e.samples),
         escape(_rmse(e.rmse)) if e.rmse else "", escape(percent(e.fit_percent))]
        for kind, entries in kinds for e in entries
    ]  # fmt: skip
    if not rows:
        return ""
    shown = table(("log or run", "use", "samples", "rmse", "fit"), rows, numeric=(2, 3, 4))
    if len(rows) > 12:
        shown = f"<details><summary>{len(rows)} runs</summary>{shown}</details>"
    return f"<h2>Agreement with each log</h2>{shown}{_whiteness(document)}"


def _whiteness(document: ParameterDocument) -> str:
    w = document.fit.residual_whiteness
    if w is None:
        return ""
    p = w.p_value
    value = f"= {p:.2g}" if p >= 1e-4 else "&lt; 0.0001"
    if p >= 0.01:
        return f'<p class="faint">Residuals are white (p {value}).</p>'
    return (
        f'<p class="faint">Residuals are autocorrelated (p {value}): by noise that lasts, which '
        "the intervals allow for, or by something that the model lacks. Where that would move a "
        "parameter beyond its interval, a warning names it.</p>"
    )


def _validity(document: ParameterDocument) -> str:
    rows = [
        [code(role), short(r.low, 5), short(r.high, 5), escape(pretty_unit(r.unit))]
        for role, r in document.validity.items()
    ]
    title = "Range of the data: outside it the model extrapolates"
    return section(title, ("role", "low", "high", "unit"), rows, numeric=(1, 2))


def _correlation(document: ParameterDocument) -> str:
    if document.covariance is None:
        return ""
    order, matrix = document.covariance.order, document.covariance.matrix
    head = "<h2>Correlation of the estimates</h2>"
    if len(order) > _MOST_CORRELATED:
        return f'{head}<p class="faint">{len(order)} numbers; the covariance is in the file.</p>'
    spread = [matrix[k][k] ** 0.5 for k in range(len(order))]
    top = "".join(f"<th>{escape(n)}</th>" for n in order)
    body = ""
    for name, row, own in zip(order, matrix, spread):
        cells = "".join(_heat(value, own * other) for value, other in zip(row, spread))
        body += f'<tr><th class="row">{escape(name)}</th>{cells}</tr>'
    return (
        f'{head}<div class="scroll"><table class="heat"><tr><th></th>{top}</tr>{body}</table></div>'
    )


def _heat(covariance: float, scale: float) -> str:
    """A cell, blue for negative and orange for positive correlation."""
    if scale <= 0.0:
        return "<td>–</td>"
    rho = min(max(covariance / scale, -1.0), 1.0)
    end = (230, 159, 0) if rho > 0.0 else (86, 180, 233)
    red, green, blue = (round(255 + (c - 255) * abs(rho)) for c in end)
    text = f"{rho:+.2f}".replace("-", "−")
    return f'<td style="background:rgb({red},{green},{blue})">{text}</td>'


def _model(document: ParameterDocument) -> str:
    family = get_family(document.family)
    equation = family.variant(document.variant).equation or family.equation
    equation = f"<h2>Model</h2><p>{code(equation)}</p>"
    if not document.model:
        return equation
    # as it stands in the file, without the file's first comment
    lines = dump_yaml(document.to_dict()["model"]).splitlines()
    shown = "\n".join(line for line in lines if not line.startswith("#"))
    return f"{equation}<pre>{escape(shown)}</pre>"


def _provenance(document: ParameterDocument) -> str:
    p = document.provenance
    rows = [
        ["written by", escape(f"{p.tool.name} {p.tool.version}")],
        ["on", escape(p.created)],
    ]
    if p.command is not None:
        rows.append(["command", code(p.command)])
    if p.seed is not None:
        rows.append(["seed", str(p.seed)])
    for log in p.logs:
        columns = "; ".join(
            f"{role} ← {'?' if c.header is None else c.header}" + (f" [{c.unit}]" if c.unit else "")
            for role, c in log.columns.items()
        )
        rows.append(
            ["log", f"{escape(log.file)} · {count(log.rows)} rows · {escape(columns)}<br>"
             f'<span class="faint"><code>sha256 {log.sha256}</code></span>']
        )  # fmt: skip
    return section("Provenance", ("", ""), rows)
