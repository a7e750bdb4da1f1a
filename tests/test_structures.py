"""Structures of a family compared on the same logs, against machines of a known structure."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from studies.structures import Machine, machines, recommended

from fluidact_fit.errors import LogError, UsageError
from fluidact_fit.families import family_names, get_family
from fluidact_fit.options import describe
from fluidact_fit.structures import (
    StructureFit,
    _recommended,
    _rival,
    _structures,
    bayes_criteria,
    compare_structures,
)

QUICK = {"valve", "line", "spring-cylinder"}  # a second or two each
NAMED = [pytest.param(m, id=f"{m.family}: {m.structure}") for m in machines() if m.family in QUICK]


@pytest.mark.parametrize("machine", NAMED)
def test_the_structure_of_the_machine_is_recommended(machine: Machine) -> None:
    assert recommended(machine, seed=100) == machine.structure


@pytest.mark.parametrize("name", family_names())
def test_structures_are_made_of_options_and_parameters_of_the_family(name: str) -> None:
    family = get_family(name)
    known = {o.name: o for o in describe(family.options_type)}
    specs = {p.name: p for v in family.variants for p in v.parameters}
    for structure in family.structures:
        family.options_type.read(dict(structure.options))
        assert set(structure.options) <= set(known)
        assert all(value == specs[p].neutral for p, value in structure.fixed.items())
    assert len({s.name for s in family.structures}) == len(family.structures)
    assert len(family.structures) != 1
    assert len({tuple(s.options) for s in family.structures}) <= 1  # each sets all that differ


def test_structures_that_what_is_held_makes_the_same_are_fitted_once() -> None:
    held = {"dead_zone_negative": 0.0, "dead_zone_positive": 0.0}
    family = get_family("hydrostatic")
    assert len(_structures(family, {}, {})) == 5
    names = [s.name for s in _structures(family, {}, held)]
    assert names == [
        "no dead zone", "dead zone, dead time", "dead zone, spring",
        "dead zone, dead time, spring",
    ]  # fmt: skip


def valve_log(seed: int, n: int = 400) -> dict[str, np.ndarray]:
    (machine,) = (m for m in machines() if (m.family, m.structure) == ("valve", "second order"))
    record = machine.record(np.random.default_rng(seed))[0]
    return {role: values[:n] for role, values in record.items()}


def test_one_log_is_judged_by_its_last_third() -> None:
    found = compare_structures("valve", valve_log(1), zero="none")
    assert [s.name for s in found.structures] == ["second order", "second order, dead time"]
    assert "last third" in found.held_out
    assert all(s.held_out_percent is not None for s in found.structures)
    assert found.best is not None
    assert found.best.parameters == 3
    assert found.best.moved == ()


def test_a_structure_that_is_refused_is_a_row_with_its_reason() -> None:
    rng = np.random.default_rng(2)
    (machine,) = (m for m in machines() if (m.family, m.structure) == ("hydrostatic", "dead zone"))
    found = compare_structures("hydrostatic", machine.record(rng), stiffness="none",
                               dead_time="none")  # fmt: skip
    refused = [s for s in found.structures if s.verdict == "refused"]
    assert found.recommended == "dead zone"
    assert all(s.reason and s.bic_difference is None for s in refused)


@pytest.mark.parametrize(
    ("family", "options", "error", "words"),
    [
        ("force-map", {}, UsageError, "one structure only"),
        ("valve", {"zero": "none", "dead_time": "none"}, UsageError, "nothing to compare"),
        ("valve", {"zero": "some"}, UsageError, "nothing to compare"),
        ("valve", {"columns": {"outlet": "absent"}, "zero": "none"}, LogError, "absent"),
        ("valve", {"fixed": {"absent": 1.0}, "zero": "none"}, UsageError, "absent"),
    ],
)
def test_what_is_wrong_for_all_structures_is_said_once(family, options, error, words) -> None:
    with pytest.raises(error, match=words):
        compare_structures(family, valve_log(1), **options)


def test_the_criterion_compares_identical_samples_with_one_noise_model() -> None:
    """A structure cannot gain by leaving samples out: the others leave them out as well."""
    import fluidact_fit as ff

    result = ff.fit("valve", valve_log(1))
    (run,) = result.fitted
    fewer = run.measured.copy()
    fewer[np.argsort(-np.abs(run.residual))[:40]] = np.nan
    other = replace(result, fitted=[replace(run, measured=fewer)])
    (one, two), samples = bayes_criteria([result, other])
    assert samples == run.measured.size - 40
    assert one == pytest.approx(two)


def entry(name: str, parameters: int, bic: float, rmse: float | None, **more) -> StructureFit:
    return StructureFit(name, {}, {}, parameters, 99.0, 99.0, rmse, "pass", bic, **more)


@pytest.mark.parametrize(
    ("fits", "best"),
    [
        ([entry("a", 3, 5.0, 1.0), entry("b", 4, 0.0, 0.99)], "a"),  # weak evidence
        ([entry("a", 3, 50.0, 1.0), entry("b", 4, 0.0, 0.9)], "b"),
        ([entry("a", 3, 50.0, 1.0), entry("b", 4, 0.0, 1.2)], "a"),  # predicts worse
        ([entry("a", 3, 50.0, 1.0), entry("b", 4, 0.0, None)], "a"),  # cannot predict
        ([entry("a", 3, 50.0, None), entry("b", 4, 0.0, None)], "b"),
        ([entry("b", 4, 0.0, 1.0), entry("a", 3, 3.0, 1.0)], "a"),
    ],
)
def test_a_term_has_to_convince_both_judges(fits: list[StructureFit], best: str) -> None:
    found = _recommended(fits)
    assert found is not None
    assert found.name == best


def test_a_failed_fit_is_not_recommended_while_another_has_not_failed() -> None:
    failed = replace(entry("a", 3, 0.0, 1.0), verdict="fail")
    found = _recommended([failed, entry("b", 4, 90.0, 2.0)])
    assert found is not None
    assert found.name == "b"
    assert _recommended([replace(failed, bic_difference=None)]) is None


def test_held_out_logs_that_disagree_with_the_criterion_are_a_rival() -> None:
    best = StructureFit("plain", {}, {}, 4, 99.4, 98.6, 0.307, "warn", 0.0)
    better = replace(best, name="dead time", held_out_rmse=0.226, bic_difference=910.0)
    alike = replace(better, name="alike", held_out_rmse=0.300)
    assert _rival([best, better], best) is better
    assert _rival([best, alike], best) is None
    assert _rival([best, replace(better, verdict="fail")], best) is None
