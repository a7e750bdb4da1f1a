"""Pages that stand by themselves: nothing comes from elsewhere; all is there without scripts."""

from __future__ import annotations

import json
from base64 import b64encode
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from hashlib import sha256
from html import escape as escape_html
from importlib.resources import files

from ..errors import visible

Cell = str | tuple[float, str]  # what is shown, behind the number by which it is sorted
_NUMERIC = ' class="n"'


@dataclass(frozen=True)
class Panel:
    """Axes of a picture: their place and content, for reading values off it.

    Attributes
    ----------
    box
        Left, top, right and bottom edge, as shares of the picture from its upper left corner.
    x, y
        Values at the left and the right edge, at the lower and the upper edge.
    x_label, y_label
        Name and unit.
    lines
        Id in the picture and name of every line that has one height at each ``x``.
    """

    box: tuple[float, float, float, float]
    x: tuple[float, float]
    y: tuple[float, float]
    x_label: tuple[str, str]
    y_label: tuple[str, str]
    lines: Sequence[tuple[str, str]] = ()


@dataclass(frozen=True)
class Picture:
    """A picture of a page: its caption, what it shows in words, and its SVG."""

    title: str
    words: str
    svg: bytes
    panels: Sequence[Panel] = ()


def escape(text: str) -> str:
    """Text from anywhere as HTML that shows it."""
    return escape_html(visible(text))


def whole_page(title: str, parts: Iterable[str]) -> str:
    """A page of parts that are HTML already; empty ones are left out."""
    style, script = (
        (files(__package__) / name).read_text(encoding="utf-8") for name in ("page.css", "page.js")
    )
    trusted = b64encode(sha256(script.encode()).digest()).decode()
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        '<meta http-equiv="Content-Security-Policy" content="default-src \'none\'; '
        f"img-src data:; style-src 'unsafe-inline'; script-src 'sha256-{trusted}'\">\n"
        f"<title>{escape(title)}</title>\n<style>{style}</style>\n</head>\n<body>\n<main>\n"
        + "\n".join(p for p in parts if p)
        + f"\n</main>\n<script>{script}</script>\n</body>\n</html>\n"
    )


def header(title: str, facts: Sequence[str], badge: str = "", remark: str = "") -> str:
    """Top of a page: title, a line of facts, a badge of the class that it names, a remark."""
    line = escape("   ·   ".join(facts))
    return (
        f'<div class="top"><div><h1>{escape(title)}</h1><p class="sub">{line}</p>'
        + (f'<p class="bad">{escape(remark)}</p>' if remark else "")
        + "</div>"
        + (f'<p class="verdict {badge}">{badge.upper()}</p>' if badge else "")
        + "</div>"
    )


def pictures(shown: Sequence[Picture]) -> str:
    """Pictures inside the page."""
    return "".join(
        f'<figure><div class="picture" tabindex="0" role="region" '
        f'aria-label="Picture: {escape(p.title)}"><img alt="{escape(p.words)}" '
        f'data-title="{escape(p.title)}" '
        f'data-panels="{escape(json.dumps([asdict(panel) for panel in p.panels]))}" '
        f'src="data:image/svg+xml;base64,{b64encode(p.svg).decode()}"></div>'
        f"<figcaption>{escape(p.title)}</figcaption></figure>\n"
        for p in shown
    )


def code(text: str) -> str:
    """Text as it is typed."""
    return f"<code>{escape(text)}</code>"


def section(
    title: str, heads: Sequence[str], rows: Sequence[Sequence[Cell]], numeric: Sequence[int] = (),
    *, kind: str = "",
) -> str:  # fmt: skip
    """A heading and a table; nothing when the table has no rows."""
    shown = table(title, heads, rows, numeric, kind=kind)
    return f"<h2>{escape(title)}</h2>{shown}" if rows else ""


def folded(title: str, body: str) -> str:
    """A heading that shows its part of the page when it is chosen."""
    return f"<details><summary><h2>{escape(title)}</h2></summary>{body}</details>"


def table(
    name: str, heads: Sequence[str], rows: Sequence[Sequence[Cell]], numeric: Sequence[int] = (),
    *, kind: str = "",
) -> str:  # fmt: skip
    """A table of cells that are HTML already, the first of every row being its name.

    ``kind`` is ``sortable`` for a table that a reader may sort, ``explained`` for one whose last
    column is prose.
    """

    def cells(row: Sequence[Cell]) -> str:
        out = ""
        for k, cell in enumerate(row):
            tag, scope = ("td", "") if k else ("th", ' scope="row"')
            number, shown = ("", cell) if isinstance(cell, str) else cell
            key = f' data-value="{number}"' if shown != cell else ""
            out += f"<{tag}{scope}{_NUMERIC * (k in numeric)}{key}>{shown}</{tag}>"
        return out

    top = "".join(
        f'<th scope="col"{_NUMERIC * (k in numeric)}>{escape(h)}</th>' for k, h in enumerate(heads)
    )
    top = f"<thead><tr>{top}</tr></thead>" if any(heads) else ""
    body = "".join(f"<tr>{cells(row)}</tr>" for row in rows)
    return scrolling(name, f'<table class="{kind}">{top}<tbody>{body}</tbody></table>')


def scrolling(name: str, body: str, kind: str = "") -> str:
    """A part that scrolls sideways by itself, by keyboard too."""
    return (
        f'<div class="{f"scroll {kind}".strip()}" tabindex="0" role="region" '
        f'aria-label="{escape(name)}">{body}</div>'
    )
