"""One self-contained HTML page per result: no script, nothing loaded from elsewhere."""

from __future__ import annotations

import contextlib
import os
from base64 import b64encode
from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any

from ..errors import FluidactError, UsageError
from ..families import get_family
from ..outcome import Outcome
from ..parameters import ParameterDocument, dump_yaml, write_atomically
from .figure import plot_result, plot_validation
from .numbers import count, flatten, percent, pretty_unit, short, show
from .save import render

_MOST_CORRELATED = 24

_CSS = """
:root { color-scheme: light; }
* { box-sizing: border-box; }
body { font: 15px/1.5 system-ui, -apple-system, "Segoe UI", "DejaVu Sans", sans-serif;
  color: #22262a; background: #fff; max-width: 1120px; margin: 0 auto; padding: 24px 28px 64px; }
h1 { font-size: 25px; margin: 0; } h2 { font-size: 17px; margin: 34px 0 8px; }
header { display: flex; justify-content: space-between; align-items: flex-start; gap: 24px;
  border-bottom: 1px solid #d9dcdf; padding-bottom: 14px; }
.sub { color: #5f666c; margin: 4px 0 0; }
.verdict { font-weight: 700; color: #fff; border-radius: 8px; padding: 4px 14px; font-size: 19px; }
.pass { background: #007a5a; } .warn { background: #9a6700; } .fail { background: #b3261e; }
.scroll { overflow-x: auto; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; font-size: 14px; }
th, td { padding: 4px 14px 4px 0; text-align: left; vertical-align: top; }
th { font-weight: 600; color: #5f666c; border-bottom: 1px solid #d9dcdf; white-space: nowrap; }
td { border-bottom: 1px solid #eef0f1; }
td.n, th.n { text-align: right; white-space: nowrap; }
.heat td { text-align: center; padding: 4px 8px; border: 1px solid #fff; min-width: 54px; }
.heat th { border: 0; } .heat th.row { text-align: right; }
.bad { color: #b3261e; font-weight: 600; } .faint { color: #5f666c; }
img { width: 100%; height: auto; margin-top: 16px; }
ul { padding-left: 20px; margin: 6px 0; } li { margin: 6px 0; overflow-wrap: anywhere; }
code, pre { font: 13px/1.45 ui-monospace, "DejaVu Sans Mono", monospace; }
pre { background: #f5f6f7; border-radius: 6px; padding: 12px 14px; overflow-x: auto; }
td code { overflow-wrap: anywhere; }
@media print { body { max-width: none; padding: 0; } h2 { break-after: avoid; }
  tr { break-inside: avoid; } }
"""


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
    return write_atomically(path, result_page(result), overwrite=overwrite)


def write_document_html(
    document: ParameterDocument,
    path: str | os.PathLike[str],
    *,
    overwrite: bool = False,
) -> Path:
    """Write the report of a parameter file alone, without pictures; see :func:`write_html`."""
    _check_suffix(path)
    return write_atomically(path, document_page(document), overwrite=overwrite)


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


def document_page(document: ParameterDocument, figures: Sequence[tuple[str, bytes]] = ()) -> str:
    """The page of a parameter document.

    Parameters
    ----------
    document
        A parameter document.
    figures
        Description and SVG of each picture.
    """
    d = document.to_dict()
    pictures = "".join(
        f'<img alt="{escape(text)}" src="data:image/svg+xml;base64,{b64encode(svg).decode()}">\n'
        for text, svg in figures
    )
    parts = [
        _header(d), pictures, _warnings(d), _parameters(d), _derived(d), _comparisons(d), _logs(d),
        _validity(d), _correlation(d), _model(d), _provenance(d),
    ]  # fmt: skip
    title = escape(f"{d['family']}: {d['fit']['verdict']}")
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        '<meta http-equiv="Content-Security-Policy" content="default-src \'none\'; '
        "img-src data:; style-src 'unsafe-inline'\">\n"
        f"<title>{title}</title>\n<style>{_CSS}</style>\n</head>\n<body>\n"
        + "\n".join(p for p in parts if p)
        + "\n</body>\n</html>\n"
    )


def _header(d: Mapping[str, Any]) -> str:
    fit = d["fit"]
    try:
        title = get_family(d["family"]).title
    except FluidactError:
        title = d["family"]
    rmse = fit["rmse"]
    parts = [
        f"fit {percent(fit.get('fit_percent'))}",
        f"rmse {short(rmse['value'], 3)} {pretty_unit(rmse['unit'])}",
        f"{count(fit['samples'])} samples",
        f"{len(d['provenance'].get('logs', ()))} log(s)",
    ]
    accepted = (
        '<p class="bad">This fit failed and was accepted by the user (--accept-failed).</p>'
        if d.get("accepted_failed")
        else ""
    )
    verdict = escape(fit["verdict"])
    return (
        f'<header><div><h1>{escape(title)}</h1><p class="sub">'
        f"{escape('   ·   '.join(parts))}</p>{accepted}</div>"
        f'<div class="verdict {verdict}">{verdict.upper()}</div></header>'
    )


def _warnings(d: Mapping[str, Any]) -> str:
    items = [
        f"<li><code>{escape(w['code'])}</code>: {escape(w['message'])}</li>"
        for w in d.get("warnings", ())
    ]
    return f"<h2>Warnings, and what to do</h2><ul>{''.join(items)}</ul>" if items else ""


def _parameters(d: Mapping[str, Any]) -> str:
    return _section(
        "Parameters",
        ("name", "value ± standard error", "unit", "95 % interval", "status", "meaning"),
        _quantity_rows(d["parameters"], _meanings(d)),
        numeric=(1, 3),
    )


def _derived(d: Mapping[str, Any]) -> str:
    rows = [row[:4] for row in _quantity_rows(d.get("derived", {}), {})]
    heads = ("name", "value ± standard error", "unit", "95 % interval")
    return _section("Derived from the parameters", heads, rows, numeric=(1, 3))


def _meanings(d: Mapping[str, Any]) -> dict[str, tuple[str, str]]:
    """Description and remedy of every parameter the family knows."""
    try:
        variants = get_family(d["family"]).variants
    except FluidactError:
        return {}
    chosen = [v for v in variants if v.name == d.get("variant")] or list(variants)
    return {p.name: (p.description, p.remedy) for v in chosen for p in v.parameters}


def _quantity_rows(
    quantities: Mapping[str, Any], meanings: Mapping[str, tuple[str, str]]
) -> list[list[str]]:
    out = []
    for name, q in quantities.items():
        status = q.get("status", "")
        meaning, remedy = meanings.get(name, ("", ""))
        text = escape(meaning)
        shown = escape(status.replace("_", " "))
        if status == "not_identified":
            shown = f'<span class="bad">{shown}</span>'
            text += f'<br><span class="faint">{escape(remedy)}</span>' if remedy else ""
        listed = isinstance(q["value"], list)
        value = _list_table(q) if listed else escape(show(q["value"], q.get("std_error")))
        interval = "" if listed or "ci95" not in q else _interval(q["ci95"])
        out.append(
            [f"<code>{escape(name)}</code>", value, escape(pretty_unit(q["unit"])), interval,
             shown, text]
        )  # fmt: skip
    return out


def _interval(ci: Any) -> str:
    low, high = flatten(ci)[:2]
    return escape(f"{short(low, 5)} … {short(high, 5)}")


def _list_table(q: Mapping[str, Any]) -> str:
    """All entries of a list, folded away when there are many."""
    values = flatten(q["value"])
    errors: list[Any] = flatten(q["std_error"]) if "std_error" in q else [None] * len(values)
    errors = errors if len(errors) == len(values) else [None] * len(values)
    rows = "<br>".join(escape(show(v, e)) for v, e in zip(values, errors))
    if len(values) <= 8:
        return rows
    return f"<details><summary>{escape(show(q['value']))}</summary>{rows}</details>"


def _comparisons(d: Mapping[str, Any]) -> str:
    """Tables in which a fit set models side by side: ``fit.details.comparisons``."""
    out = []
    for title, rows in d["fit"].get("details", {}).get("comparisons", {}).items():
        heads = list(dict.fromkeys(key for row in rows for key in row))
        numeric = [k for k, h in enumerate(heads) if isinstance(rows[0].get(h), int | float)]
        cells = [[_cell(row.get(h, "")) for h in heads] for row in rows]
        out.append(
            f"<h2>{escape(title)}</h2>"
            + _table([h.replace("_", " ") for h in heads], cells, numeric)
        )
    return "".join(out)


def _cell(value: Any) -> str:
    return escape(str(value) if isinstance(value, str | int) else short(float(value), 3))


def _logs(d: Mapping[str, Any]) -> str:
    rows = []
    for kind, entries in (
        ("fitted", d["fit"].get("logs", ())),
        ("judged", d.get("validation", ())),
    ):
        for e in entries:
            rmse = e.get("rmse")
            shown = f"{short(rmse['value'], 3)} {pretty_unit(rmse['unit'])}" if rmse else ""
            samples = count(e["samples"]) if "samples" in e else ""
            rows.append([escape(e["file"]), kind, samples, escape(shown),
                         escape(percent(e.get("fit_percent")))])  # fmt: skip
    heads = ("log or run", "use", "samples", "rmse", "fit")
    table = _table(heads, rows, numeric=(2, 3, 4))
    if not rows:
        return ""
    if len(rows) > 12:
        table = f"<details><summary>{len(rows)} runs</summary>{table}</details>"
    return f"<h2>Agreement with each log</h2>{table}{_whiteness(d)}"


def _whiteness(d: Mapping[str, Any]) -> str:
    w = d["fit"].get("residual_whiteness")
    if not w:
        return ""
    p = w["p_value"]
    found = (
        "are white" if p >= 0.01 else "are not white: they contain structure that the model lacks"
    )
    value = f"{p:.2g}" if p >= 1e-4 else "&lt; 0.0001"
    return f'<p class="faint">Residuals {found} (p {"=" if p >= 1e-4 else ""} {value}).</p>'


def _validity(d: Mapping[str, Any]) -> str:
    rows = [
        [f"<code>{escape(role)}</code>", escape(short(r["low"], 5)), escape(short(r["high"], 5)),
         escape(pretty_unit(r["unit"]))]
        for role, r in d.get("validity", {}).items()
    ]  # fmt: skip
    return _section(
        "Range of the data: outside it the model extrapolates",
        ("role", "low", "high", "unit"), rows, numeric=(1, 2),
    )  # fmt: skip


def _correlation(d: Mapping[str, Any]) -> str:
    covariance = d.get("covariance")
    if not covariance:
        return ""
    order, matrix = covariance["order"], covariance["matrix"]
    if len(order) > _MOST_CORRELATED:
        return (
            "<h2>Correlation of the estimates</h2>"
            f'<p class="faint">{len(order)} numbers; the covariance is in the file.</p>'
        )
    spread = [max(matrix[k][k], 0.0) ** 0.5 for k in range(len(order))]
    top = "".join(f"<th>{escape(n)}</th>" for n in order)
    rows = []
    for i, name in enumerate(order):
        cells = "".join(_heat(matrix[i][j], spread[i] * spread[j]) for j in range(len(order)))
        rows.append(f'<tr><th class="row">{escape(name)}</th>{cells}</tr>')
    return (
        '<h2>Correlation of the estimates</h2><div class="scroll"><table class="heat">'
        f"<tr><th></th>{top}</tr>{''.join(rows)}</table></div>"
    )


def _heat(covariance: float, scale: float) -> str:
    """A cell, blue for negative and orange for positive correlation."""
    if scale <= 0.0:
        return "<td>–</td>"
    rho = min(max(covariance / scale, -1.0), 1.0)
    end = (230, 159, 0) if rho > 0.0 else (86, 180, 233)
    red, green, blue = (round(255 + (c - 255) * abs(rho)) for c in end)
    text = escape(f"{rho:+.2f}".replace("-", "−"))
    return f'<td style="background:rgb({red},{green},{blue})">{text}</td>'


def _model(d: Mapping[str, Any]) -> str:
    parts = []
    with contextlib.suppress(FluidactError):
        parts.append(f"<p><code>{escape(get_family(d['family']).equation)}</code></p>")
    if d.get("model"):
        parts.append(f"<pre>{escape(_yaml(d['model']))}</pre>")
    return f"<h2>Model</h2>{''.join(parts)}" if parts else ""


def _yaml(part: Mapping[str, Any]) -> str:
    """A part of the document as it stands in the file, without the file's first comment."""
    lines = dump_yaml(dict(part)).splitlines()
    return "\n".join(line for line in lines if not line.startswith("#"))


def _provenance(d: Mapping[str, Any]) -> str:
    p = d["provenance"]
    rows = [
        ["written by", escape(f"{p['tool']['name']} {p['tool']['version']}")],
        ["on", escape(p["created"])],
    ]
    if "command" in p:
        rows.append(["command", f"<code>{escape(p['command'])}</code>"])
    if "seed" in p:
        rows.append(["seed", str(p["seed"])])
    for log in p.get("logs", ()):
        columns = "; ".join(
            f"{role} ← {c.get('header', '?')}" + (f" [{c['unit']}]" if c.get("unit") else "")
            for role, c in log.get("columns", {}).items()
        )
        rows.append(
            ["log", f"{escape(log['file'])} · {count(log['rows'])} rows · {escape(columns)}<br>"
             f'<span class="faint"><code>sha256 {escape(log["sha256"])}</code></span>']
        )  # fmt: skip
    return f"<h2>Provenance</h2>{_table(('', ''), rows)}"


def _section(
    title: str, heads: Sequence[str], rows: Sequence[Sequence[str]], numeric: Sequence[int] = ()
) -> str:
    """A heading and a table; nothing when the table has no rows."""
    return f"<h2>{escape(title)}</h2>{_table(heads, rows, numeric)}" if rows else ""


def _table(heads: Sequence[str], rows: Sequence[Sequence[str]], numeric: Sequence[int] = ()) -> str:
    """A table of cells that are HTML already."""

    def cells(tag: str, row: Sequence[str]) -> str:
        return "".join(
            f'<{tag} class="n">{c}</{tag}>' if k in numeric else f"<{tag}>{c}</{tag}>"
            for k, c in enumerate(row)
        )

    top = f"<tr>{cells('th', [escape(h) for h in heads])}</tr>" if any(heads) else ""
    body = "".join(f"<tr>{cells('td', row)}</tr>" for row in rows)
    return f'<div class="scroll"><table>{top}{body}</table></div>'
