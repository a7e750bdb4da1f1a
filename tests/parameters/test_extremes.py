"""Files that agree with themselves and hold numbers, names or lists of absurd sizes."""

from __future__ import annotations

import contextlib
import copy
import io
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import pytest
import yaml

from fluidact_fit.families import get_family
from fluidact_fit.family import Plant
from fluidact_fit.parameters.yaml_io import to_plain
from fluidact_fit_cli.main import run

GOLDEN = Path(__file__).parents[1] / "golden" / "0.1.0"
FAMILIES = sorted(path.stem for path in GOLDEN.glob("*.yaml"))
ABSURD = (1e31, 1e39, 1e300, -1e308)
Raw = dict[str, Any]


@cache
def golden(family: str) -> Raw:
    found: Raw = yaml.safe_load((GOLDEN / f"{family}.yaml").read_text())
    return found


def first_of(value: Any) -> tuple[list[Any], int]:
    """The list that holds the first number of a list or a list of lists."""
    while isinstance(value[0], list):
        value = value[0]
    return value, 0


def with_value(family: str, name: str, number: float) -> Raw:
    """A file in which a parameter has a value, its first entry that is, and the model follows."""
    raw = copy.deepcopy(golden(family))
    entry = raw["parameters"][name]
    if isinstance(entry["value"], list):
        part, at = first_of(entry["value"])
        part[at] = number
    else:
        entry["value"] = number
    raw["parameters"][name] = {"value": entry["value"], "unit": entry["unit"], "status": "fixed"}
    raw.pop("covariance", None)
    for other in raw["parameters"].values():
        for key in ("std_error", "ci95", "method"):
            other.pop(key, None)
    kind = get_family(raw["family"])
    options = kind.options_type.read(raw.get("options", {}), from_file=True)
    values = {n: e["value"] for n, e in raw["parameters"].items()}
    discrete = raw["model"].get("discrete", {"sample_time": 0.0, "hold": "zoh"})
    plant = Plant(kind.variant(raw.get("variant")), values, options)
    offset = {k: v for k, v in raw["model"].items() if k == "output_offset"}
    with contextlib.suppress(Exception):  # then the reader meets the old one
        model = kind.model(plant, discrete["sample_time"], discrete["hold"])
        raw["model"] = {**to_plain(model), **offset}
    return raw


def export(raw: Raw, folder: Path, target: str) -> tuple[int, str]:
    path = folder / "x.yaml"
    path.write_text(yaml.safe_dump(raw, sort_keys=False))
    open_ = [n for n, e in raw["parameters"].items() if e["status"] == "not_identified"]
    accepted = [w for name in open_ for w in ("--accept-not-identified", name)]
    args = ["export", str(path), "--to", target, "-o", str(folder / target), "-f"]
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        status = run([*args, "--accept-failed", *accepted])
    return status, err.getvalue()


def parameters_of(family: str) -> Iterator[str]:
    yield from golden(family)["parameters"]


@pytest.mark.parametrize("family", FAMILIES)
def test_numbers_beyond_those_of_options_are_refused(family: str, tmp_path: Path) -> None:
    for name in parameters_of(family):
        for number in ABSURD:
            status, err = export(with_value(family, name, number), tmp_path, "json")
            assert status == 3, (name, number, err)
            assert f"parameters.{name}.value" in err
            assert "Traceback" not in err


@pytest.mark.parametrize("family", FAMILIES)
def test_what_is_left_is_exported_or_refused(family: str, tmp_path: Path) -> None:
    scalars = [n for n in parameters_of(family)
               if isinstance(golden(family)["parameters"][n]["value"], float)]  # fmt: skip
    for name in scalars:
        # that of C runs the code at many arguments, which is for one of a family enough
        for number, target in ((-0.0, "st"), (1e29, "c" if name == scalars[-1] else "st")):
            status, err = export(with_value(family, name, number), tmp_path, target)
            assert status in (0, 2, 3), (name, number, target, err)
            for path in (tmp_path / target).glob("*.[chsm]*") if status == 0 else ():
                if path.suffix in (".c", ".h", ".st", ".m"):
                    assert not re.search(r"(?<![\w.])-?(inf|nan)(\.0f?)?(?!\w)[,;)]",
                                         path.read_text()), (name, number, path)  # fmt: skip


def test_a_number_too_small_to_divide_by_is_refused(tmp_path: Path) -> None:
    for family, name, number in (
        ("hydraulic-cylinder", "valve_gain_1", 0.0), ("hydraulic-motor", "gain", -0.0),
        ("spring-cylinder", "pressure_gain", 1e-200), ("valve", "gain", 1e-310),
        ("ball-screw", "viscous", 5e-324),
    ):  # fmt: skip
        if name not in golden(family)["parameters"]:
            continue
        status, err = export(with_value(family, name, number), tmp_path, "c")
        assert status == 3, (family, name, err)
        assert f"parameters.{name}.value" in err


def put(raw: Raw, path: str, number: Any) -> None:
    *above, last = path.split("/")
    for key in above:
        raw = raw[int(key)] if isinstance(raw, list) else raw[key]
    if isinstance(raw, list):
        raw[int(last)] = number
    else:
        raw[last] = number


@pytest.mark.parametrize(
    ("path", "number"),
    [
        ("validity/inlet/high", 1e308), ("validity/inlet/low", -1e308),
        ("covariance/matrix/0/0", 1e200), ("model/discrete/sample_time", 1e-300),
        ("model/discrete/sample_time", 1e300), ("provenance/logs/0/sample_time", 1e300),
        ("fit/rmse/value", 1e99), ("parameters/gain/std_error", 1e77),
        ("model/continuous/dead_time", 1e250),
    ],
)  # fmt: skip
def test_numbers_beside_the_parameters(path: str, number: float, tmp_path: Path) -> None:
    raw = copy.deepcopy(golden("line"))
    put(raw, path, number)
    status, err = export(raw, tmp_path, "c")
    assert status == 3
    assert re.sub(r"/(\d+)", r"[\1]", path).replace("/", ".") in err, err


@pytest.mark.parametrize(
    "text",
    [
        "parameters: {gain: {value: [" + "1.0, " * 1_000_000 + "1.0]}}\n",
        "family: " + "a" * 9_000_000 + "\n",
        "a" * 9_000_000 + ": 1\n",
        '? "' + "b" * 900 + '"\n: 1\n',
        "format: fluidact-parameters\nformat_version: " + "9" * 4000 + "\n",
        "x: " + "[" * 5000 + "\n",
    ],
)
def test_lists_and_names_of_megabytes(text: str, tmp_path: Path) -> None:
    path = tmp_path / "x.yaml"
    path.write_text(text)
    err = io.StringIO()
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(err):
        status = run(["export", str(path), "--to", "json", "-o", str(tmp_path)])
    assert status == 3
    assert len(err.getvalue()) < 4000
    assert "Traceback" not in err.getvalue()
