"""Files of older versions still load."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml

from fluidact_fit.errors import ParameterFileError
from fluidact_fit.parameters import CURRENT_VERSION, read_document
from fluidact_fit.parameters.migrations import MIGRATIONS, migrate
from fluidact_fit.parameters.problems import Problems

VERSION_0 = Path(__file__).with_name("version_0.yaml")


def test_every_older_version_has_a_migration():
    assert set(MIGRATIONS) == set(range(CURRENT_VERSION))


def test_version_0_loads(lookup):
    document = read_document(VERSION_0, lookup)
    assert document.format_version == CURRENT_VERSION
    mass, zone = (document.parameters[n] for n in ("mass", "dead_zone_negative"))
    assert (mass.std_error, mass.status) == (0.21, "estimated")
    assert (zone.std_error, zone.status) == (None, "fixed")
    assert document.derived["time_constant"].std_error == 0.0001
    assert document.derived["time_constant"].status is None


def test_the_given_document_is_left_alone():
    raw = yaml.safe_load(VERSION_0.read_text(encoding="utf-8"))
    before = yaml.safe_dump(raw)
    migrate(raw, Problems())
    assert yaml.safe_dump(raw) == before


def test_problems_of_an_old_file_are_named(lookup, tmp_path):
    text = VERSION_0.read_text(encoding="utf-8")
    path = tmp_path / "old.yaml"
    path.write_text(text.replace("std: 0.21", "std: 0.21, std_error: -1.0"), encoding="utf-8")
    with pytest.raises(ParameterFileError) as caught:
        read_document(path, lookup)
    assert {p for p, _ in caught.value.problems} == {
        "parameters.mass.std",
        "parameters.mass.std_error",
    }


@pytest.mark.parametrize("parameters", ["[]", "{mass: 3.0}", "nothing"])
def test_a_broken_old_file_is_a_problem_not_a_fault(parameters, lookup, tmp_path):
    path = tmp_path / "old.yaml"
    path.write_text(f"format_version: 0\nparameters: {parameters}\n", encoding="utf-8")
    with pytest.raises(ParameterFileError):
        read_document(path, lookup)


@pytest.mark.parametrize("hold", ["[linear]", "{a: 1}", "3"])
def test_a_hold_that_is_no_text_is_a_problem_not_a_fault(hold, lookup, tmp_path):
    path = tmp_path / "old.yaml"
    logs = f"[{{columns: {{force: {{unit: N, hold: {hold}}}}}}}]"
    path.write_text(f"format_version: 1\nprovenance: {{logs: {logs}}}\n", encoding="utf-8")
    with pytest.raises(ParameterFileError, match=r"columns\.force\.hold"):
        read_document(path, lookup)
