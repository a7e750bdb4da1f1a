"""Rows of a table that are no samples: their mean, deviation, lowest and highest value.

Loggers and spreadsheets write them below the samples, above them, or after each run. A word for one
stands where the other rows have a number, or nothing.
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Mapping, Sequence
from functools import lru_cache

from .layout import LONG_CELL, Cut, says_nothing

_WORDS = (
    # English
    r"mean|average|avg|aver|ave|median|mode|std|stdev|stddev|standard deviation|std\.? ?dev|sd|rms"
    r"|rmse|variance|var|min|max|minimum|maximum|sum|total|count|range|peak|skew(ness)?|kurtosis"
    r"|(peak|pk|p)[ -]?(to[ -])?(peak|pk|p)|quantile|percentile|coefficient of variation"
    # German
    r"|mittel|mittelwert|durchschnitt|medianwert|standardabweichung|stabw|std\.? ?abw|streuung"
    r"|varianz|minimalwert|maximalwert|kleinstwert|größtwert|summe|gesamt|anzahl|spannweite"
    # French, Spanish, Italian
    r"|moyenne|moy|médiane|mediane|[ée]cart[ -]?type|somme|nombre|[ée]tendue|media|promedio|mediana"
    r"|desviaci[óo]n( est[áa]ndar| t[íi]pica)?|desv|varianza|m[áa]ximo|m[íi]nimo|suma|recuento"
    r"|massimo|minimo|somma|conteggio|deviazione( standard)?"
    # signs, and Chinese and Japanese
    r"|Ø|⌀|σ|平均值?|均值|标准差|標準偏差|方差|最大值?|最小值?|总和|总计|合计|合計|计数|中位数|中央値"
)
_STATISTIC = re.compile(
    rf"\W*({_WORDS})[ ._-]?(value|val|wert|valeur|valor|valore)?\s*([(\[].*|of\b.*)?[\s:=.]*",
    re.IGNORECASE,
)
_NO_WORDS = b"0123456789+-.,;|eE \t\n\"'"  # what rows of numbers consist of
_LABELLED = re.compile(rf"[\s\"']*({_WORDS})(?![^\W_])", re.IGNORECASE)
_WORD = re.compile(r"[^\W\d_][^\W\d_. -]{2,}[^\d]*|=.*")  # or a formula
_MOST_APART = 20  # rows of statistics below names of their own


def begins_with_statistic(line: str) -> bool:
    """Return whether a line begins with the word for a statistic."""
    return _LABELLED.match(line) is not None


def find_statistics(rows: Sequence[Sequence[str]], text: str, cut: Cut) -> dict[int, str]:
    """Rows that hold statistics of the others, by index, each with the word for it.

    Parameters
    ----------
    rows
        Cells of every row of the table.
    text
        All of it: the rows are not looked at where it holds nothing but numbers.
    cut
        How it is cut.
    """
    found: dict[int, str] = {}
    if text.encode(errors="replace").translate(None, _NO_WORDS):
        labels: dict[int, dict[int, str]] = defaultdict(dict)
        for index, row in enumerate(rows):
            at = [k for k, c in enumerate(row) if not c[-1:].isdigit() and _is_statistic(c)]
            if len(at) == 1:  # one word says what the numbers beside it are
                labels[at[0]][index] = row[at[0]].strip()
            elif at and len(rows) - index <= _MOST_APART and not any(map(cut.is_value, row)):
                found |= dict.fromkeys(range(index, len(rows)), row[at[0]].strip())
        for column, words in labels.items():
            found |= _of_column(rows, column, words, cut)
        found |= _without_label(rows, found, cut)
    return found | _below(rows, found, cut)


@lru_cache(maxsize=1 << 14)
def _is_statistic(cell: str) -> bool:
    return len(cell) < LONG_CELL and _STATISTIC.fullmatch(cell) is not None


def _of_column(
    rows: Sequence[Sequence[str]], column: int, words: Mapping[int, str], cut: Cut
) -> dict[int, str]:
    """The rows whose word in a column is no sample of it, and their neighbours with other words."""
    others = [row[column].strip() for k, row in enumerate(rows) if k not in words]
    numbers = sum(map(cut.is_value, others))
    texts = sum(not says_nothing(cell) for cell in others) - numbers
    if numbers > texts:
        return _with_neighbours(rows, column, words, cut)
    if numbers or texts or not others:
        return {}  # a column of words
    last = range(len(rows) - len(words), len(rows))
    if set(words) == set(last) and len(set(words.values())) > 1:
        return dict(words)
    full = [k for k in range(len(rows[0])) if k != column and _is_full(rows, k, words, cut)]
    return {i: word for i, word in words.items() if any(says_nothing(rows[i][k]) for k in full)}


def _is_full(rows: Sequence[Sequence[str]], column: int, but: Mapping[int, str], cut: Cut) -> bool:
    """Return whether a column has a number in every row but some."""
    return all(cut.is_value(row[column].strip()) for k, row in enumerate(rows) if k not in but)


def _with_neighbours(
    rows: Sequence[Sequence[str]], column: int, words: Mapping[int, str], cut: Cut
) -> dict[int, str]:
    """Rows of statistics and those next to them that have another word, as ``25 %``."""
    out = dict(words)
    for index in words:
        for step in (-1, 1):
            at = index + step
            while 0 <= at < len(rows) and at not in out and _is_text(rows[at][column], cut):
                out[at] = rows[at][column].strip()
                at += step
    return out


def _is_text(cell: str, cut: Cut) -> bool:
    cell = cell.strip()
    return not says_nothing(cell) and not cut.is_value(cell)


def _without_label(
    rows: Sequence[Sequence[str]], known: Mapping[int, str], cut: Cut
) -> dict[int, str]:
    """Rows of numbers below a row with nothing but the word for them, in pairs to the last one."""
    alone = [k for k in known if not any(cut.is_value(cell.strip()) for cell in rows[k])]
    pairs = [k for k in alone if k + 1 < len(rows) and k + 1 not in known]
    return {k + 1: known[k] for k in pairs if k + 2 == len(rows) or k + 2 in known}


def _below(rows: Sequence[Sequence[str]], known: Mapping[int, str], cut: Cut) -> dict[int, str]:
    """The last rows that have a word where the first column has numbers, whatever it says."""
    out: dict[int, str] = {}
    for index in range(len(rows) - 1, -1, -1):
        cell = rows[index][0].strip()
        if index in known:
            continue
        if len(cell) > LONG_CELL or says_nothing(cell) or not _WORD.fullmatch(cell):
            break
        out[index] = cell
    firsts = [row[0].strip() for row in rows[: len(rows) - len(out) - len(known)]]
    numbers = sum(map(cut.is_value, firsts)) if out else 0
    return out if out and 2 * numbers > len(firsts) else {}
