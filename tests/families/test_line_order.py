"""Lines of second order: named where the first order was fitted, and recovered where asked for."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from studies.structures import line

import fluidact_fit as ff
from fluidact_fit.experiment import Experiment, Signal
from fluidact_fit.family import Plant

HELD = {"inlet": "zoh"}
DATASET = Path(__file__).parents[2] / "datasets" / "line"


def logs(lags: tuple[float, ...]) -> list[dict[str, np.ndarray]]:
    rng = np.random.default_rng(5)
    return [dict(line(rng, lags=lags, delay=0.0147)[0]) for _ in range(2)]


@pytest.mark.parametrize("lags", [(0.12, 0.05), (0.08, 0.0799)])  # two that are nearly alike
def test_two_lags_are_recovered(lags: tuple[float, float]) -> None:
    result = ff.fit("line", logs(lags), hold=HELD, order="second")
    truth = {"time_constant": sum(lags), "dead_time": 0.0147, "gain": 0.98,
             "second_time_constant": lags[0] * lags[1] / sum(lags)}  # fmt: skip
    assert result.verdict == "pass"
    for name, value in truth.items():
        q = result.parameters[name]
        assert abs(q.number - value) < 4.0 * float(q.std_error)
    w = result.derived["bandwidth"].number  # where the gain has fallen by 3 dB
    gain = 1.0 / abs((1j * w * lags[0] + 1.0) * (1j * w * lags[1] + 1.0))
    assert gain == pytest.approx(np.sqrt(0.5), rel=0.02)


def test_an_outlet_that_never_moves_is_refused() -> None:
    """Whether a run was cut was judged by the logarithm of the power of its outlet."""
    inlet = np.repeat(np.random.default_rng(1).uniform(1e5, 3e5, 20), 100)
    log = {"time": 0.01 * np.arange(2000), "inlet": inlet, "outlet": np.full(2000, 2.5e5)}
    with pytest.raises(ff.NotIdentifiedError, match="outlet is always"):
        ff.fit("line", log)


def test_a_missed_order_is_named_with_its_option() -> None:
    result = ff.fit("line", logs((0.12, 0.05)), hold=HELD)
    (said,) = [n.message for n in result.notices if n.code == "unmodelled-response"]
    assert "the response is of second order" in said
    assert "--order=second" in said


def test_a_line_of_first_order_has_no_second_time_constant() -> None:
    result = ff.fit("line", logs((0.12,)), hold=HELD, order="second")
    q = result.parameters["second_time_constant"]
    assert q.status == "not_identified" or q.number < 4.0 * float(q.std_error or 0.0)
    assert "second_time_constant" not in ff.fit("line", logs((0.12,)), hold=HELD).parameters


def test_the_next_log_of_a_line_without_a_second_lag_is_designed() -> None:
    """A derivative at none changed the order of the line: "a bug in fluidact-fit"."""
    family, t = ff.get_family("line"), 0.01 * np.arange(200)
    values = {"gain": 1.0, "time_constant": 0.12, "dead_time": 0.015, "second_time_constant": 0.0}
    plant = Plant(family.variants[0], values, family.options_type())
    inlet = Signal("inlet", t, np.sign(np.sin(20.0 * t)), "Pa", "zoh", 0.0)
    information = family.information(plant, Experiment("", 0, t, {"inlet": inlet}, 0.01, True))
    assert information is not None
    assert np.isfinite(information.jacobian).all()
    assert not information.jacobian[:, information.names.index("second_time_constant")].any()


def test_a_second_order_that_is_not_there_leaves_the_dead_time() -> None:
    columns = {"inlet": "p_valve (bar)", "outlet": "p_chamber (bar)"}
    found = ff.fit(
        "line", [DATASET / "trial1.csv", DATASET / "trial2.csv"], columns=columns, order="second"
    ).parameters
    assert found["second_time_constant"].status == "not_identified"
    dead_time = found["dead_time"]
    assert abs(dead_time.number - 0.0147) < 4.0 * float(dead_time.std_error)
