"""What a family shows of the law inside its model agrees with what was measured."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from dataset_fits import fit_dataset
from fluidact_fit.families import family_names, get_family
from fluidact_fit.family import Family
from fluidact_fit.mechanics.local_motion import delayed
from fluidact_fit.report.details import physics_view

# family: largest typical distance of a point from the nearest curve, in ranges of the curves
SHOWN = {"ball-screw": 0.005, "hydraulic-cylinder": 0.01, "hydraulic-motor": 0.005,
         "hydrostatic": 0.02}  # fmt: skip


@pytest.mark.parametrize("family", SHOWN)
def test_measured_points_lie_on_the_law(family: str) -> None:
    view = physics_view(fit_dataset(family))
    assert view is not None
    x, y = view.samples.x, view.samples.y
    assert x.shape == y.shape
    used = np.isfinite(x) & np.isfinite(y)
    assert used.sum() > 100
    curves = [(c.x[np.isfinite(c.y)], c.y[np.isfinite(c.y)]) for c in view.curves]
    spans = [np.ptp(np.concatenate([c[k] for c in curves])) for k in (0, 1)]
    # with points between a static level and rest, the distance is to the mark or the law
    points = np.column_stack((x[used] / spans[0], y[used] / spans[1]))[:: max(used.sum() // 500, 1)]
    moving = np.abs(points[:, 0]) > 0.02
    lines = np.concatenate([np.column_stack((a / spans[0], b / spans[1])) for a, b in curves])
    away = np.sqrt(((points[moving, None] - lines) ** 2).sum(axis=2)).min(axis=1)
    assert np.median(away) < SHOWN[family]


def test_families_that_show_a_law_are_held_to_it() -> None:
    shows = {n for n in family_names() if type(get_family(n)).physics_view != Family.physics_view}
    assert shows == set(SHOWN)


def test_a_drive_shows_both_levels_of_friction() -> None:
    result = fit_dataset("ball-screw")
    view = physics_view(result)
    assert view is not None
    kinetic, static = view.curves
    values = SimpleNamespace(**{n: float(np.max(q.value)) for n, q in result.parameters.items()})
    assert np.nanmax(static.y) == pytest.approx(values.breakaway_positive)
    assert np.nanmin(static.y) == pytest.approx(-values.breakaway_negative)
    at_rest = kinetic.y[kinetic.x == 0.0]
    assert sorted(at_rest) == pytest.approx([-values.coulomb_negative, values.coulomb_positive])
    stuck = np.abs(view.samples.x) < 0.1
    assert np.nanmax(view.samples.y[stuck]) < 1.1 * values.breakaway_positive


def test_a_motor_shows_its_loop() -> None:
    result = fit_dataset("hydraulic-motor")
    view = physics_view(result)
    assert view is not None
    rising, falling = view.curves
    width = float(np.max(result.parameters["hysteresis"].value))
    level = 100.0
    between = np.interp(level, rising.y, rising.x) - np.interp(
        level, falling.y[::-1], falling.x[::-1]
    )
    assert between == pytest.approx(width, rel=0.02)


def test_a_delayed_input_is_drawn_when_it_acts() -> None:
    time, values = 0.1 * np.arange(6), np.arange(6.0)
    later = delayed(time, values, 0.25)
    assert np.isnan(later[:3]).all()
    assert later[3:].tolist() == [0.0, 1.0, 2.0]
