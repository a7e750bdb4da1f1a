"""Parameter files spoilt at random, one place at a time, and what may happen to their readers.

Every case follows from the file and a seed, so that one that fails can be had again.
"""

from __future__ import annotations

import copy
import json
import random
from collections.abc import Iterator
from typing import Any, NamedTuple

# JSON is YAML as well, but for what it has no words for.
_WORDS = {"\0nan": ".nan", "\0inf": "-.inf", "\0null": "null", "\0long": "9" * 500}
_REPLACEMENTS: tuple[Any, ...] = (
    *_WORDS, True, -1, 0, 1, 7, 10**400, -1.0, 0.0, 1e308, -1e308, 5e-324, 1e-320,
    "", "text", "²", "#²", "#" + "9" * 5000, "#1", "1", "1.0e-07", "nan", "none", "auto", "zoh",
    "9^9^9^9", "m" * 3000, "kg", "V", "%", "degC", "\x1b[31mred", "١", "../../etc/passwd",
    "(((((((((((((((((((((((((", "!!python/object:os.system", "{}", "a,b,c", "5", "64,64", ",",
    [], {}, [5.0], [1.0, 2.0], [2.0, 1.0], [[1.0]], [[1.0, 2.0], [3.0]], [[]], ["a"],
    ["\0nan"] * 50, [[["x"]]], {"from": 0.0, "to": 1.0, "at": 0.0}, {"value": 1.0, "unit": "m"},
    {"a": {"b": {"c": [1.0]}}}, [{"file": "x"}], {"": 1}, {"0": "²"},
)  # fmt: skip

Place = tuple[Any, ...]


class Case(NamedTuple):
    """A spoilt file: what was done to it, and its text."""

    what: str
    text: str


def to_text(document: Any) -> str:
    """A document as YAML in one line; texts that begin with NUL stand for what is no JSON."""
    text = json.dumps(document, ensure_ascii=False)
    for word, meant in _WORDS.items():
        text = text.replace(json.dumps(word), meant)
    return text


def places(part: Any, above: Place = ()) -> Iterator[Place]:
    """Every place of a document below its top, parts before what they hold."""
    if not isinstance(part, (dict, list)):
        return
    for key, item in part.items() if isinstance(part, dict) else enumerate(part):
        yield (*above, key)
        yield from places(item, (*above, key))


def spoil_document(document: Any, seed: int) -> Case:
    """Change one place: another value, nothing, less, more, turned round, or in other hands."""
    rng = random.Random(seed)
    spoilt = copy.deepcopy(document)
    # a section first: a long list of numbers should not draw most of the cases
    section = rng.choice(list(document))
    place = rng.choice([p for p in places(document) if p[0] == section])
    parent = spoilt
    for key in place[:-1]:
        parent = parent[key]
    last, found = place[-1], parent[place[-1]]
    way = rng.choice(["replace"] * 4 + ["shape"] * 3 + ["delete", "add", "rename"])
    if way == "delete" or (way == "rename" and isinstance(parent, list)):
        del parent[last]
    elif way == "rename":
        parent[f"{last}_" if rng.random() < 0.5 else str(last).upper()] = parent.pop(last)
    elif way == "add" and isinstance(parent, list):
        parent.append(copy.deepcopy(rng.choice([found, *_REPLACEMENTS])))
    elif way == "add":
        parent["added"] = copy.deepcopy(rng.choice(_REPLACEMENTS))
    else:
        parent[last] = (
            copy.deepcopy(rng.choice(_REPLACEMENTS)) if way == "replace" else _reshape(found, rng)
        )
    return Case(f"{way} {place}, seed {seed}", to_text(spoilt))


def _reshape(found: Any, rng: random.Random) -> Any:
    """The same thing in another form."""
    if isinstance(found, list) and found:
        return rng.choice([found[:1], found[:-1], found[::-1], found * 2, found[0], [found]])
    if isinstance(found, dict) and found:
        return rng.choice([[found], list(found), list(found.values()), str(found), {}])
    if isinstance(found, (int, float)) and not isinstance(found, bool):
        return rng.choice([-found, str(found), [found], 2 * found, found * 1e-200, int(found)])
    return rng.choice([[found], {str(found): found}, f"{found}{found}", f" {found} "])


def spoil_text(text: str, seed: int) -> Case:
    """Change the text itself: cut it, drop, double or swap lines, or change one character."""
    rng = random.Random(seed)
    lines = text.splitlines(keepends=True)
    at, other = rng.randrange(len(lines)), rng.randrange(len(lines))
    cut = rng.randrange(len(text))
    character = rng.choice("\t\n:#-[]{}&*!|>'\"%@`,? \x1b\u2028\ufeff²é0")
    way, spoilt = rng.choice(
        [
            ("cut", text[:cut]),
            ("drop", "".join(lines[:at] + lines[at + 1 :])),
            ("double", "".join(lines[:at] + lines[at : at + 1] + lines[at:])),
            ("swap", "".join([*lines[:at], lines[other], *lines[at + 1 :]])),
            ("indent", "".join([*lines[:at], " ", *lines[at:]])),
            ("character", text[:cut] + character + text[cut + 1 :]),
            ("insert", text[:cut] + character + text[cut:]),
        ]
    )
    return Case(f"{way} line {at + 1} or character {cut}, seed {seed}", spoilt)
