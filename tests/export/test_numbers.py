"""What a target's own library reads back is the same float64, to the last bit."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from scipy.io import loadmat

import fluidact_fit as ff
from fluidact_fit.export import export


def exported(path: Path, to: str, folder: Path) -> dict[str, Path]:
    """Suffix of each file of an export to its path."""
    written = export([path], to, folder)
    return {written_path.name.partition(".")[2]: written_path for written_path in written}


def bits(value: Any) -> list[str]:
    """Numbers flattened by rows, all their digits."""
    return [float(v).hex() for v in np.asarray(value, dtype=float).ravel()]


def values(path: Path) -> dict[str, Any]:
    raw = yaml.safe_load(path.read_text(encoding="utf-8"))
    return {name: entry["value"] for name, entry in raw["parameters"].items()}


def test_json(parameter_file: Path, tmp_path: Path) -> None:
    text = exported(parameter_file, "json", tmp_path)["json"].read_text(encoding="ascii")
    due = yaml.safe_load(parameter_file.read_text(encoding="utf-8"))
    found = json.loads(text)
    for part, key in (("parameters", "value"), ("parameters", "std_error"), ("derived", "value")):
        for name, entry in due.get(part, {}).items():
            if key in entry:
                assert bits(found[part][name][key]) == bits(entry[key])
    assert found.get("covariance") == due.get("covariance")
    assert found["model"] == due["model"]
    assert found == ff.read_document(parameter_file).to_dict()


def test_ros2(parameter_file: Path, tmp_path: Path) -> None:
    path = exported(parameter_file, "ros2", tmp_path)["ros2.yaml"]
    ((_, node),) = yaml.safe_load(path.read_text(encoding="utf-8")).items()
    found = node["ros__parameters"]
    for name, value in values(parameter_file).items():
        assert bits(found[name]) == bits(value)
        if np.ndim(value) == 2:
            assert [found[f"{name}_rows"], found[f"{name}_columns"]] == [*np.shape(value)]
    model = yaml.safe_load(parameter_file.read_text(encoding="utf-8"))["model"]
    for part in ("continuous", "discrete"):
        for key, number in model.get(part, {}).items():
            if key != "hold":
                assert bits(found[part][key]) == bits(number)


def test_mat(parameter_file: Path, tmp_path: Path) -> None:
    path = exported(parameter_file, "matlab", tmp_path)["mat"]
    due = yaml.safe_load(parameter_file.read_text(encoding="utf-8"))
    model = loadmat(path, struct_as_record=False)[path.stem][0, 0]
    parameters, errors = model.parameters[0, 0], model.std_errors[0, 0]
    for name, entry in due["parameters"].items():
        found = getattr(parameters, name)
        assert found.dtype == np.float64
        assert found.shape == np.atleast_2d(entry["value"]).shape
        assert bits(found) == bits(entry["value"])
        assert getattr(model.units[0, 0], name).item() == entry["unit"]
        if "std_error" in entry:
            assert bits(getattr(errors, name)) == bits(entry["std_error"])
    if "covariance" in due:
        assert bits(model.covariance[0, 0].matrix) == bits(due["covariance"]["matrix"])
    for role, covered in due["validity"].items():
        assert bits(getattr(model.validity[0, 0], role)) == bits([covered["low"], covered["high"]])


def test_a_reader_of_the_function_sees_units(parameter_file: Path, tmp_path: Path) -> None:
    """They stood in a list of their own alone."""
    text = exported(parameter_file, "matlab", tmp_path)["m"].read_text(encoding="ascii")
    due = yaml.safe_load(parameter_file.read_text(encoding="utf-8"))
    for name, entry in due["parameters"].items():
        _, _, rest = text.partition(f"\n  model.parameters.{name} = ")
        behind = rest.partition("\n  model.")[0].rpartition(";")[2]
        assert behind == ("" if entry["unit"] == "1" else f"  % {entry['unit']}")


def test_the_same_file_gives_the_same_bytes(parameter_file: Path, tmp_path: Path) -> None:
    for to in ("json", "ros2", "matlab"):
        first = export([parameter_file], to, tmp_path / "first")
        second = export([parameter_file], to, tmp_path / "second")
        assert [p.read_bytes() for p in first] == [p.read_bytes() for p in second]


# ------------------------------------------------------------- what ROS 2 insists on


def leaves(node: Any, path: tuple[str, ...] = ()) -> Iterator[tuple[str, Any]]:
    """Keys with dots, and the scalars and lists below them."""
    if isinstance(node, dict):
        for key, part in node.items():
            yield from leaves(part, (*path, key))
    else:
        yield ".".join(path), node


KINDS = {"double": r"-?\d+\.\d+(e[+-]\d+)?", "int": r"-?\d+", "bool": "true|false", "string": ".*"}
VALIDATORS = {
    "bounds<>": 2, "gt_eq<>": 1, "lt_eq<>": 1, "element_bounds<>": 2, "lower_element_bounds<>": 1,
    "upper_element_bounds<>": 1, "fixed_size<>": 1,
}  # fmt: skip


def declared(node: Any, path: tuple[str, ...] = ()) -> Iterator[tuple[str, dict[str, Any]]]:
    """Leaves of a declaration: mappings with a type."""
    for key, part in node.items():
        if "type" in part:
            yield ".".join((*path, key)), part
        else:
            yield from declared(part, (*path, key))


def check_value(text: Any, kind: str) -> None:
    """Compare a scalar or list, as written, with the type that is declared for it."""
    base, array, size = kind.partition("_array")
    assert isinstance(text, list) == bool(array)
    for item in text if array else [text]:
        assert re.fullmatch(KINDS[base], item), (item, kind)
    if array:
        assert text
    if size:
        assert len(text) == int(size.removeprefix("_fixed_"))


def test_ros2_types_are_those_declared(parameter_file: Path, tmp_path: Path) -> None:
    """Every double has a decimal point, arrays are of one type, and nothing is empty."""
    written = exported(parameter_file, "ros2", tmp_path)
    # every scalar as it is written, before any YAML reader has guessed its type
    raw = yaml.load(written["ros2.yaml"].read_text(encoding="utf-8"), yaml.BaseLoader)
    text = written["declaration.yaml"].read_text(encoding="utf-8")
    ((name, node),), ((namespace, tree),) = raw.items(), yaml.safe_load(text).items()
    assert name == namespace == parameter_file.stem.replace("-", "_")
    values, types = dict(leaves(node["ros__parameters"])), dict(declared(tree))
    assert set(values) == set(types)
    for key, entry in types.items():
        check_value(values[key], entry["type"])
        assert next(iter(entry)) == "type"  # the generator knows a leaf by its first value
        assert entry["read_only"] is True
        assert set(entry) <= {"type", "description", "read_only", "validation"}
        for validator, arguments in entry.get("validation", {}).items():
            assert len(arguments) == VALIDATORS[validator]
            kind = int if validator == "fixed_size<>" else float
            assert all(type(a) is kind for a in arguments)


def test_ros2_bounds_hold_and_are_those_of_the_specification(
    parameter_file: Path, tmp_path: Path
) -> None:
    written = exported(parameter_file, "ros2", tmp_path)
    (node,) = yaml.safe_load(written["ros2.yaml"].read_text(encoding="utf-8")).values()
    (tree,) = yaml.safe_load(written["declaration.yaml"].read_text(encoding="utf-8")).values()
    block = ff.load(parameter_file)
    for spec in (block.variant.parameter(name) for name in block.parameters):
        validation, value = tree[spec.name].get("validation", {}), node["ros__parameters"]
        numbers = np.atleast_1d(value[spec.name])
        bounds = [v for k, some in validation.items() if k != "fixed_size<>" for v in some]
        finite = [v for v in (spec.minimum, spec.maximum) if np.isfinite(v)]
        assert bounds == finite
        assert np.all((numbers >= spec.minimum) & (numbers <= spec.maximum))
        assert validation.get("fixed_size<>", [numbers.size]) == [numbers.size]


def test_the_generator_of_the_library_takes_the_declaration(
    parameter_file: Path, tmp_path: Path
) -> None:
    library = pytest.importorskip(
        "generate_parameter_library_py.generate_cpp_header",
        reason="generate_parameter_library_py is not installed (it comes with ROS 2)",
    )
    path = exported(parameter_file, "ros2", tmp_path)["declaration.yaml"]
    library.run(str(tmp_path / "generated" / "header.hpp"), str(path))
    text = (tmp_path / "generated" / "header.hpp").read_text(encoding="utf-8")
    for name in values(parameter_file):
        assert f" {name}" in text
