"""What a fit explains: against the mean of a run with its own offset, else of all runs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fluidact_fit.assessment import Cause
from fluidact_fit.assessment.verdict import judge
from fluidact_fit.estimation.uncertainty import Whiteness
from fluidact_fit.experiment import Experiment
from fluidact_fit.outcome import (
    Agreement,
    Simulation,
    agreement,
    common_level,
)
from fluidact_fit.tables import percent_text


def run(measured: float, error: float, offset: float | None = None) -> Simulation:
    """A run that hardly varies about one value."""
    ripple = 0.01 * np.array([1.0, -1.0, 1.0, -1.0])
    empty = Experiment("log.csv", 0, np.zeros(0), {}, 0.0, True)
    return Simulation(empty, np.full(4, measured - error), measured + ripple, offset)


def test_without_offsets_the_means_of_the_runs_are_explained() -> None:
    runs = [run(1.0, 0.0), run(3.0, 0.0)]
    assert common_level(runs) == pytest.approx(2.0)
    assert agreement(runs).fit_percent == pytest.approx(99.0, abs=0.01)
    (alone, _) = (replace(r, level=common_level(runs)) for r in runs)
    assert alone.agreement.fit_percent == pytest.approx(99.0, abs=0.01)


def test_with_an_offset_of_its_own_a_run_is_judged_by_what_varies_in_it() -> None:
    runs = [run(1.0, 0.0, 1.0), run(3.0, 0.0, 3.0)]
    assert common_level(runs) is None
    assert agreement(runs).fit_percent == pytest.approx(0.0, abs=0.01)


def test_an_offset_that_all_runs_share_is_not_their_own() -> None:
    assert common_level([run(1.0, 0.0, 0.5), run(3.0, 0.0, 0.5)]) == pytest.approx(2.0)
    assert common_level([run(1.0, 0.0, 0.5)]) is None


@pytest.mark.parametrize(
    ("value", "shown"),
    [
        (99.318, "99.32 %"),
        (99.998, "99.998 %"),
        (99.9999996, "99.9999996 %"),
        (100.0, "100.00 %"),
        (-1000.0, "-1000.00 %"),
        (-1e-9, "0.00 %"),
        (-1e30, "below -1000 %"),
        (1e30, "over 1000 %"),
    ],
)
def test_a_percentage_of_thirty_digits_is_not_printed(value: float, shown: str) -> None:
    assert percent_text(value) == shown


def test_a_change_may_be_rounded_to_a_hundred() -> None:
    assert percent_text(99.999998, "+.2f") == "+100.00 %"


def test_a_hopeless_fit_is_told_in_few_words() -> None:
    _, (notice,) = judge(agreement([replace(run(1.0, 1e28), level=1.0)]), [], None, None)
    assert "by over 1000 % of what it moves" in notice.message


def fitted(percent: float) -> Agreement:
    return Agreement(1.0, percent, 1000, 1.0)


WHITE, COLOURED = Whiteness(10.0, 0.9, 20), Whiteness(900.0, 0.0, 20)
CAUSE = Cause("two columns seem to be swapped, and", "Check --column.")


@pytest.mark.parametrize(
    ("percent", "ratio", "white", "verdict", "code"),
    [
        (75.0, 2.0, COLOURED, "pass", None),
        (50.0, 2.0, COLOURED, "warn", "weak-fit"),
        (25.0, 2.0, COLOURED, "fail", "poor-fit"),
        (25.0, None, WHITE, "fail", "poor-fit"),  # nothing is known of the noise
        (25.0, 1.05, COLOURED, "fail", "poor-fit"),
        (25.0, 1.05, WHITE, "warn", "weak-fit"),  # all that is left is noise
    ],
)
def test_a_fit_fails_that_explains_less_than_half_of_what_is_no_noise(
    percent: float, ratio: float | None, white: Whiteness, verdict: str, code: str | None
) -> None:
    found, reasons = judge(fitted(percent), [], ratio, white)
    assert found == verdict
    assert [n.code for n in reasons] == ([code] if code else [])


def test_a_failed_fit_begins_with_what_the_logs_show() -> None:
    _, reasons = judge(fitted(10.0), [], 2.0, COLOURED, CAUSE)
    words = reasons[-1].message
    assert words.startswith("two columns seem to be swapped, and the model misses the output by 90")
    assert words.endswith("Check --column.")


def test_a_failed_fit_names_what_was_given_beside_its_cause() -> None:
    _, reasons = judge(fitted(10.0), [], 2.0, COLOURED, None, "--fix time_constant=85")
    assert (
        "these logs contradict --fix time_constant=85 (in SI): try without" in reasons[-1].message
    )
