"""Pages that stand by themselves: no script, nothing loaded from elsewhere."""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Iterable, Sequence
from html import escape as escape_html

from ..errors import visible

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


def escape(text: str) -> str:
    """Text from anywhere as HTML that shows it."""
    return escape_html(visible(text))


def whole_page(title: str, parts: Iterable[str]) -> str:
    """A page of parts that are HTML already; empty ones are left out."""
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        '<meta http-equiv="Content-Security-Policy" content="default-src \'none\'; '
        "img-src data:; style-src 'unsafe-inline'\">\n"
        f"<title>{escape(title)}</title>\n<style>{_CSS}</style>\n</head>\n<body>\n"
        + "\n".join(p for p in parts if p)
        + "\n</body>\n</html>\n"
    )


def pictures(figures: Sequence[tuple[str, bytes]]) -> str:
    """Pictures inside the page; description and SVG of each."""
    return "".join(
        f'<img alt="{escape(text)}" src="data:image/svg+xml;base64,{b64encode(svg).decode()}">\n'
        for text, svg in figures
    )


def code(text: str) -> str:
    """Text as it is typed."""
    return f"<code>{escape(text)}</code>"


def section(
    title: str, heads: Sequence[str], rows: Sequence[Sequence[str]], numeric: Sequence[int] = ()
) -> str:
    """A heading and a table; nothing when the table has no rows."""
    return f"<h2>{escape(title)}</h2>{table(heads, rows, numeric)}" if rows else ""


def table(heads: Sequence[str], rows: Sequence[Sequence[str]], numeric: Sequence[int] = ()) -> str:
    """A table of cells that are HTML already."""

    def cells(tag: str, row: Sequence[str]) -> str:
        return "".join(
            f'<{tag} class="n">{c}</{tag}>' if k in numeric else f"<{tag}>{c}</{tag}>"
            for k, c in enumerate(row)
        )

    top = f"<tr>{cells('th', [escape(h) for h in heads])}</tr>" if any(heads) else ""
    body = "".join(f"<tr>{cells('td', row)}</tr>" for row in rows)
    return f'<div class="scroll"><table>{top}{body}</table></div>'
