"""Counters of time that overflow are continued, where it is certain that they did."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from fluidact_fit.errors import Notice
from fluidact_fit.experiment import Experiment
from fluidact_fit.family import Role, Variant
from fluidact_fit.logs import experiments, read_log

ROLES = (Role("time", "s", ""), Role("outlet", "1", "", output=True))


def fit(
    folder: Path, stamps: Sequence[object], name: str = "time [ms]"
) -> tuple[list[Experiment], list[Notice]]:
    path = folder / "log.csv"
    rows = [f"{t},{k % 7}.5" for k, t in enumerate(stamps)]
    path.write_text("\n".join([f"{name},outlet [1]", *rows]) + "\n", encoding="utf-8")
    return experiments(read_log(path), Variant("any", ROLES, ()))


@pytest.mark.parametrize("turns", [1, 3])
@pytest.mark.parametrize("step", [1, 7, 10])
@pytest.mark.parametrize("bits", [8, 10, 12, 16])
def test_counters_of_some_bits(tmp_path: Path, bits: int, step: int, turns: int) -> None:
    count = min(turns * 2**bits // step + 5, 30_000)
    stamps = [(2**bits - 100 + step * k) % 2**bits for k in range(count)]
    (one,), notices = fit(tmp_path, stamps)
    np.testing.assert_allclose(np.diff(one.time), step / 1000, rtol=1e-9)
    assert one.time[0] == pytest.approx((2**bits - 100) / 1000)
    assert [n.code for n in notices] == ["time-wrapped"]
    assert f"(2^{bits})" in notices[0].message
    assert "line" in notices[0].message


@pytest.mark.parametrize(
    ("turn", "name"),
    [(2**16, "time [ms]"), (2**24, "time [us]"), (2**31, "time [us]"), (10**6, "time [ms]"),
     (10**5, "time [ms]"), (10**10, "time [us]")],
)  # fmt: skip
def test_a_counter_that_is_not_even(tmp_path: Path, turn: int, name: str) -> None:
    steps = np.random.default_rng(0).integers(990, 1011, 300)
    stamps = (turn - 100_321 + np.concatenate(([0], np.cumsum(steps)))) % turn
    (one,), notices = fit(tmp_path, stamps.tolist(), name)
    scale = 1e-3 if "ms" in name else 1e-6
    np.testing.assert_allclose(np.diff(one.time), steps * scale, rtol=1e-6)
    assert [n.code for n in notices if n.code != "uneven-sampling"] == ["time-wrapped"]


@pytest.mark.parametrize("bits", [16, 32])
def test_signed_counters(tmp_path: Path, bits: int) -> None:
    half = 2 ** (bits - 1)
    (one,), notices = fit(tmp_path, [10 * k - 205 for k in range(80)])
    np.testing.assert_allclose(np.diff(one.time), 0.01, rtol=1e-6)
    assert "time-wrapped" not in {n.code for n in notices}
    (one,), notices = fit(tmp_path, [(half - 55 + 10 * k + half) % (2 * half) - half
                                     for k in range(80)])  # fmt: skip
    np.testing.assert_allclose(np.diff(one.time), 0.01, rtol=1e-6)
    assert [n.code for n in notices] == ["time-wrapped"]


@pytest.mark.parametrize(("bits", "power"), [(32, 6), (32, 3), (16, 3), (24, 6)])
def test_counters_that_are_printed_in_another_unit(tmp_path: Path, bits: int, power: int) -> None:
    """`micros() / 1e6` begins again at 4294.967296 s."""
    stamps = [(2**bits - 20_300 + 1000 * k) % 2**bits for k in range(60)]
    (one,), notices = fit(tmp_path, [f"{s / 10**power:.{power}f}" for s in stamps], "time [s]")
    np.testing.assert_allclose(np.diff(one.time), 10.0 ** (3 - power), rtol=1e-5)
    assert [n.code for n in notices] == ["time-wrapped"]


@pytest.mark.parametrize(
    "stamps",
    [
        [k % 100 for k in range(300)],
        [k % 256 for k in range(1000)],  # records of 256 samples as well as 8 bits
        [k % 1000 / 100 for k in range(3000)],  # cycles of 10 s
        [k % 5000 for k in range(9000)],
        [60_000 + 10 * k if k < 200 else 10 * (k - 200) for k in range(400)],
        [61_000 + 10 * k if k < 200 else 500 + 10 * (k - 200) for k in range(400)],
    ],
)
def test_times_that_start_again_are_runs(tmp_path: Path, stamps: list[float]) -> None:
    found, notices = fit(tmp_path, stamps)
    assert len(found) > 1
    assert "time-wrapped" not in {n.code for n in notices}
