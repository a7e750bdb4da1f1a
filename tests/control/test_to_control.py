"""Linear models as transfer functions of python-control."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import fluidact_fit as ff

GOLDEN = Path(__file__).parents[1] / "golden" / ff.__version__


@pytest.mark.parametrize("family", ["valve", "hydrostatic"])
def test_sampling_it_gives_the_discrete_model(family: str) -> None:
    control = pytest.importorskip("control", reason="python-control is not installed")
    model = ff.load(GOLDEN / f"{family}.yaml")
    sampled = control.c2d(model.to_control(), model.sample_time, "zoh")
    found = model.to_control(discrete=True)
    assert found.dt == model.sample_time
    for part in ("num", "den"):
        due, have = (np.trim_zeros(getattr(f, part)[0][0], "f") for f in (sampled, found))
        np.testing.assert_allclose(have, due, rtol=1e-9)


def test_a_dead_time_is_not_lost() -> None:
    control = pytest.importorskip("control", reason="python-control is not installed")
    model = ff.load(GOLDEN / "line.yaml")
    with pytest.raises(ff.UsageError, match="dead time"):
        model.to_control()
    gain, tau, late = (model.parameters[n] for n in ("gain", "time_constant", "dead_time"))
    omega = np.array([0.1, 1.0, 10.0])
    due = gain * np.exp(-1j * omega * late) / (1j * omega * tau + 1.0)
    found = control.evalfr
    values = [found(model.to_control(pade=3), 1j * w) for w in omega]
    np.testing.assert_allclose(values, due, rtol=1e-8)
    held = model.to_control(discrete=True)
    slow = np.exp(1j * omega[:1] * model.sample_time)
    # a sample held for one period is late by half of it
    half = np.exp(-0.5j * omega[:1] * model.sample_time)
    np.testing.assert_allclose([found(held, z) for z in slow], due[:1] * half, rtol=1e-5)


def test_without_python_control_it_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    import sys

    monkeypatch.setitem(sys.modules, "control", None)
    with pytest.raises(ff.UsageError, match=r"fluidact-fit\[control\]"):
        ff.load(GOLDEN / "valve.yaml").to_control()
