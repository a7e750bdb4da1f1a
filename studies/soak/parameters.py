"""Damaged parameter files: what does not agree with itself is refused, and said to be."""

from __future__ import annotations

import copy
import random
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import yaml

import fluidact_fit as ff

from . import program
from .case import LONGEST, WRONG, Case, Part, Result

_VALUES: tuple[Any, ...] = (
    None, True, False, "", "text", "nan", "none", "auto", "zoh", "#1", "#²", "²", "١", "１", "1",
    "1.0e+00", "64,64", ",", "%", "kg", "9^9^9^9", "(" * 26, "!!python/object:os.system",
    "../../etc/passwd", "=1+1", "2020-01-01", "\x1b[31mred", "\x85", "\ud7ff", "#" + "9" * 5000,
    "x" * 20_000, -1, 0, 1, 7, 2**63, 10**400, -1.0, -0.0, 1.5, 1e308, -1e308, 5e-324, 1e-320,
    float("nan"), float("inf"), [], [[]], [5.0], [1.0, 2.0], [2.0, 1.0], [[1.0]], [[1.0], [2.0]],
    [None], ["a"], [[["x"]]], [1.0] * 3000, [float("nan")] * 50, [{"file": "x"}], {}, {"": 1},
    {"0": "²"}, {"value": 1.0}, {"value": 1.0, "unit": "m"}, {"a": {"b": {"c": [1]}}},
    {"from": 0.0, "to": 1.0, "at": 0.0},
)  # fmt: skip
_UNITS = ("mol", "9^9^9^9", "bananas", "", "m/0", "kg*" * 200 + "mol", "%", "1e400 m", "((((m")
_LINES = (
    "a: &x 1", "b: *x", "!!python/object:os.system x: 1", "\tx: 1", "? [1, 2] : 3", "--- ", "...",
    "family: valve", "<<: {a: 1}", "%YAML 1.1", "x: |", "- 1", "{", "x: !\x1b[31m 1", "#" * 9000,
    "y: yes", "n: 0x1F", "o: 0o17", "t: 2020-01-01", "'", '"', "x: .nan", "\ufeff", ": :", "@",
    "!" + "t" * 3000 + " x: 1", "x: " + "[" * 500,
)  # fmt: skip
Place = tuple[Any, ...]


@cache
def _tree(family: str) -> Any:
    return yaml.safe_load(program.golden()[family])


def places(tree: Any, above: Place = ()) -> Iterator[tuple[Place, Any]]:
    """Every entry of a document, with the keys that lead to it."""
    pairs = tree.items() if isinstance(tree, dict) else enumerate(tree)
    for key, value in pairs:
        yield (*above, key), value
        if isinstance(value, (dict, list)):
            yield from places(value, (*above, key))


def _at(tree: Any, place: Place) -> Any:
    for key in place:
        tree = tree[key]
    return tree


def _put(tree: Any, place: Place, value: Any) -> None:
    _at(tree, place[:-1])[place[-1]] = value


def _pick(tree: Any, rng: random.Random) -> tuple[Place, Any]:
    """An entry, every part of the document as often as another."""
    part = rng.choice(list(tree))
    below = tree[part]
    found = [((part,), below)]
    if isinstance(below, (dict, list)):
        found = [*found, *places(below, (part,))]
    return rng.choice(found)


# What each function does to a document; it returns what it did, and why that must be refused, or
# nothing where it may well be harmless.
Done = tuple[str, str]


def replace(tree: Any, rng: random.Random) -> Done:
    """Put something else in the place of an entry."""
    place, old = _pick(tree, rng)
    new = copy.deepcopy(rng.choice(_VALUES))
    _put(tree, place, new)
    number = isinstance(old, (int, float)) and not isinstance(old, bool)
    finite = isinstance(new, (int, float)) and not isinstance(new, bool) and abs(new) < 1e309
    wrong = number and not finite and new is not None
    judged = place[0] in ("covariance", "validity") or (place[0] == "parameters")
    why = "a number replaced by what is none" if wrong and judged else ""
    return f"{_name(place)} = {repr(new)[:60]}", why


def reshape(tree: Any, rng: random.Random) -> Done:
    """Write the same thing in another form."""
    place, old = _pick(tree, rng)
    if isinstance(old, list) and old:
        forms: list[Any] = [old[:1], old[:-1], old[::-1], old * 2, old[0], [old]]
    elif isinstance(old, dict) and old:
        forms = [[old], list(old), list(old.values()), str(old), {}]
    elif isinstance(old, (int, float)) and not isinstance(old, bool):
        forms = [-old, str(old), [old], 2 * old, old * 1e-200, int(old)]
    else:
        forms = [[old], {str(old): old}, f"{old}{old}", f" {old} "]
    new = copy.deepcopy(rng.choice(forms))
    _put(tree, place, new)
    return f"{_name(place)} = {repr(new)[:60]}", ""


def rename(tree: Any, rng: random.Random) -> Done:
    """Give an entry another name."""
    place = rng.choice([p for p, _ in places(tree) if isinstance(p[-1], str)])
    above = _at(tree, place[:-1])
    key = f"{place[-1]}_" if rng.random() < 0.5 else place[-1].upper()
    above[key] = above.pop(place[-1])
    strict = len(place) == 1 and key != place[-1]
    return f"{_name(place)} is called {key!r}", "an unknown key" if strict else ""


def delete(tree: Any, rng: random.Random) -> Done:
    """Delete an entry."""
    place, _ = _pick(tree, rng)
    above = _at(tree, place[:-1])
    del above[place[-1]]
    needed = place[-1] in ("value", "unit") and place[0] == "parameters" and len(place) == 3
    needed |= place in (("format",), ("format_version",), ("family",), ("parameters",))
    shorter = isinstance(above, list) and place[0] in ("covariance",)
    return f"{_name(place)} deleted", "a needed entry is gone" if needed or shorter else ""


def add_key(tree: Any, rng: random.Random) -> Done:
    """Add a key that does not exist."""
    found = [((), tree), *((p, v) for p, v in places(tree) if isinstance(v, dict))]
    place, mapping = rng.choice(found)
    key = rng.choice(("extra", "", "valeu", 1, "\x1b[31m", "__class__", "x" * 190))
    mapping[key] = copy.deepcopy(rng.choice(_VALUES))
    strict = place[:1] in ((), ("parameters",), ("validity",), ("covariance",))
    return f"{_name(place)} has {key!r}", "an unknown key" if strict else ""


def change_list(tree: Any, rng: random.Random) -> Done:
    """Shorten or lengthen a list."""
    found = [(p, v) for p, v in places(tree) if isinstance(v, list) and v]
    chosen = [(p, v) for p, v in found if p[0] == rng.choice(("parameters", "model", "covariance"))]
    place, values = rng.choice(chosen or found)
    how = rng.choice(("cut to one", "cut by one", "longer by one", "empty"))
    if how == "cut to one":
        changed = values[:1]
    elif how == "cut by one":
        changed = values[:-1]
    else:
        changed = [*values, values[-1]] if how == "longer by one" else []
    _put(tree, place, changed)
    judged = place[0] in ("parameters", "model", "covariance") and len(changed) != len(values)
    return f"{_name(place)} {how}", f"a list that is {how}" if judged else ""


def change_unit(tree: Any, rng: random.Random) -> Done:
    """Give a number another unit."""
    found = [(p, v) for p, v in places(tree) if p[-1] == "unit"]
    place, _ = rng.choice(found)
    unit = rng.choice(_UNITS)
    _put(tree, place, unit)
    judged = place[0] in ("parameters", "validity") or place[:2] == ("fit", "rmse")
    return f"{_name(place)} = {unit[:30]!r}", "a wrong unit" if judged else ""


def change_sign(tree: Any, rng: random.Random) -> Done:
    """Make what cannot be negative negative, or turn a range round."""
    found: list[tuple[Place, Any, str]] = []
    for p, v in places(tree):
        if "details" in p:
            continue
        if p[-1] in ("std_error", "samples") or p[-2:] == ("rmse", "value"):
            found.append((p, v, "a negative size"))
        elif (
            (p[-1] == "ci95" or p[1:2] == ("reading_range",))
            and isinstance(v, list)
            and len(v) == 2
        ):
            found.append((p, v, "a reversed interval"))
        elif p[0] == "validity" and isinstance(v, dict) and "low" in v and "high" in v:
            found.append((p, v, "a reversed range"))
    place, old, why = rng.choice(found)
    if isinstance(old, dict):
        new = {**old, "low": old["high"], "high": old["low"]}
    elif isinstance(old, list):
        new = np.negative(old).tolist() if np.ndim(old) != 1 or len(old) != 2 else old[::-1]
    else:
        new = -old
    _put(tree, place, new)
    return f"{_name(place)}: {why}", why if new != old else ""


def scale_number(tree: Any, rng: random.Random) -> Done:
    """Double one number of a parameter, or of the model that is made of them."""
    found = [
        (p, v)
        for p, v in places(tree)
        if p[0] in ("parameters", "model") and isinstance(v, float) and v
        and (p[0] == "model" or p[2] == "value")
        # of the logs, not of the machine; and a setting, where nothing is computed from it
        and p[1] != "output_offset"
        and (p[-1] != "sample_time" or len(tree["model"]["discrete"]) > 2)
    ]  # fmt: skip
    if not found:
        return leave(tree, rng)
    place, old = rng.choice(found)
    _put(tree, place, 2.0 * old)
    fixed = place[0] == "parameters" and tree["parameters"][place[1]].get("status") != "estimated"
    return f"{_name(place)} doubled", "" if fixed else "parameters and model that disagree"


def flood(tree: Any, rng: random.Random) -> Done:
    """Fill the file with very many entries."""
    how = rng.choice(("keys", "covariance", "nan"))
    if how == "covariance" and "covariance" not in tree:
        how = "nan"
    if how == "keys":
        tree.update({f"k{i}": 1 for i in range(100_000)})
    elif how == "covariance":
        tree["covariance"]["matrix"] = [["x"] * 700] * 700
    else:
        first = next(iter(tree["parameters"].values()))
        first["value"] = [float("nan")] * 300_000
    return f"very many: {how}", "very many wrong entries"


def leave(tree: Any, rng: random.Random) -> Done:
    """Leave the document as it is."""
    return "nothing", ""


def damage_text(text: str, rng: random.Random) -> tuple[str, bytes]:
    """Damage the text of a file; returns what was done, and its bytes."""
    lines = text.split("\n")
    at = rng.randrange(len(lines))
    how = rng.choice(("delete", "twice", "swap", "cut", "garble", "indent", "insert",
                      "bytes", "encoding"))  # fmt: skip
    if how == "delete":
        del lines[at : at + rng.choice((1, 1, 5))]
    elif how == "twice":
        lines.insert(at, lines[at])
    elif how == "swap":
        other = rng.randrange(len(lines))
        lines[at], lines[other] = lines[other], lines[at]
    elif how == "cut":
        lines = [*lines[:at], lines[at][: rng.randint(0, len(lines[at]))]]
    elif how == "indent":
        lines[at] = " " + lines[at]
    elif how == "garble":
        characters = list(lines[at])
        for _ in range(rng.choice((1, 3, 20))):
            if characters:
                signs = "0123456789.-+e{}[]:,#&*!|>'\"%@`,? \tabc°²\x07\x1b\u2028\ufeff"
                characters[rng.randrange(len(characters))] = rng.choice(signs)
        lines[at] = "".join(characters)
    elif how == "insert":
        indent = " " * rng.choice((0, 0, 2, 4))
        lines.insert(at, indent + rng.choice(_LINES))
    content = "\n".join(lines).encode()
    if how == "bytes":
        k = rng.randrange(len(content))
        content = content[:k] + rng.randbytes(rng.choice((1, 8))) + content[k + 1 :]
    elif how == "encoding":
        name = rng.choice(("utf-16", "utf-8-sig", "latin-1", "utf-32"))
        content = text.encode(name, errors="replace")
        how = name
    return f"text: {how} at line {at + 1}", content


_DAMAGES: tuple[Callable[[Any, random.Random], Done], ...] = (
    replace, replace, replace, reshape, reshape, delete, delete, rename, add_key,
    change_list, change_list, change_unit, change_sign, scale_number,
)  # fmt: skip


def _name(place: Place) -> str:
    return ".".join(map(str, place)) or "the document"


def drafted(rng: random.Random, family: str = "") -> tuple[str, str, str, bytes]:
    """A damaged file: its family, what was done, why it must be refused, and its bytes."""
    family = family or rng.choice(sorted(program.golden()))
    if rng.random() < 0.3:
        about, content = damage_text(program.golden()[family], rng)
        return family, about, "", content
    tree = copy.deepcopy(_tree(family))
    done = flood if rng.random() < 0.005 else rng.choice(_DAMAGES)
    about, why = done(tree, rng)
    dumper = getattr(yaml, "CSafeDumper", yaml.SafeDumper)
    text = yaml.dump(tree, Dumper=dumper, sort_keys=False, allow_unicode=True)
    return family, about, why, text.encode("utf-8", errors="surrogatepass")


def attack_file(case: Case) -> Result:
    """Read and load one damaged file; what loads is simulated, now and then checked."""
    family, about, why, content = drafted(case.rng)
    case.tell(f"{family}: {about}")
    path = case.folder / "file.yaml"
    path.write_bytes(content)
    result = Result("refused")
    for read in (ff.read_document, ff.load):
        try:
            read(path)
        except ff.FluidactError as error:
            result.message = str(error)
            if len(str(error)) > LONGEST:
                result.fail(WRONG, f"message of {len(str(error))} characters")
                return result
        else:
            result.outcome = "loaded"
    if result.outcome == "loaded" and why:
        result.fail(WRONG, f"loaded all the same: {why}")
    if result.outcome == "loaded" or case.rng.random() < 0.2:
        _run_with(case, family, path, result)
    if path.read_bytes() != content:
        result.fail(WRONG, "the file was changed")
    return result


def _run_with(case: Case, family: str, path: Path, result: Result) -> None:
    """Give the file to the commands that take one."""
    log = case.folder / "log.csv"
    program.write_log(family, log, 40)
    given = [word for word in program.arguments(family) if "=" in word]
    columns = [word for pair in given for word in ("--column", pair)]
    commands = ["simulate"] if case.rng.random() < 0.9 else ["check", "simulate"]
    for command in commands:
        ended = program.run([command, str(path), str(log), *columns])
        result.message = ended.err
        allowed = (0, 3, 4, 5) if command == "check" else (0, 3, 4)
        program.judge(ended, result, allowed)
        if ended.status == 0 and result.outcome == "refused":
            result.fail(WRONG, f"{command} takes what load refuses")


PARTS = (Part("parameters", "damaged parameter files", 10_000, attack_file),)
