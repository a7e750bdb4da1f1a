"""Long records in blocks: against one piece, and how much memory another row takes."""

import tracemalloc

import numpy as np
import pytest
from scipy.linalg import toeplitz

from fluidact_fit import fit, rows
from fluidact_fit.estimation.blocks import condense, condensed
from fluidact_fit.estimation.linear import transition
from fluidact_fit.estimation.uncertainty import covariance, fit_autoregression

STEP = 0.001  # s


def forces(rng: np.random.Generator, samples: int) -> np.ndarray:
    """Strokes beyond a dead zone of -10 to 12 N, by as much to either side."""
    size = rng.uniform(8.0, 25.0, samples // 160 + 1)
    return np.column_stack((12.0 + size, -10.0 - size)).repeat(80, axis=1).ravel()[:samples]


def second_order_log(samples: int, uneven: bool, held: bool) -> dict[str, np.ndarray]:
    """A mass on a damper behind a dead zone, step by step through matrix exponentials."""
    rng = np.random.default_rng(5)
    shifts = 0.3 * rng.uniform(-0.5, 0.5, samples) if uneven else 0.0
    time = np.round(STEP * (np.arange(samples) + shifts), 6)
    force = forces(rng, samples)
    if not held:
        force = 30.0 * np.sin(7.0 * time) + 8.0 * np.sin(23.0 * time)
    # between two samples of a force that moves, twenty steps of a held one
    finer = 1 if held else 20
    steps = np.repeat(np.diff(time) / finer, finer)
    moving = np.interp(np.concatenate(([0.0], np.cumsum(steps))), time - time[0], force)
    driving = force[:-1] if held else 0.5 * (moving[1:] + moving[:-1])
    acting = np.maximum(driving - 12.0, 0.0) + np.minimum(driving + 10.0, 0.0)
    a, b = np.array([[0.0, 1.0], [0.0, -50.0]]), np.array([0.0, 1.0 / 0.8])
    distinct, which = np.unique(np.round(steps, 12), return_inverse=True)
    phi, gamma = transition(a, b, distinct)
    state, states = np.zeros(2), [np.zeros(2)]
    for k, f in zip(which.tolist(), acting.tolist()):
        state = phi[k] @ state + gamma[k, :, 0] * f
        states.append(state)
    position = np.array(states)[::finer, 0] + 2e-5 * rng.standard_normal(samples)
    return {"time [s]": time, "force [N]": force, "position [m]": position}


@pytest.mark.parametrize(
    ("uneven", "hold", "more"),
    [
        (False, "zoh", {}),
        (False, "zoh", {"dead_time": "estimate"}),
        pytest.param(True, "zoh", {}, marks=pytest.mark.slow),
        pytest.param(False, "foh", {"stiffness": "estimate"}, marks=pytest.mark.slow),
    ],
)
def test_several_blocks_give_what_one_does(monkeypatch, uneven, hold, more):
    log = second_order_log(6_000, uneven, hold == "zoh")
    found = []
    for block in (1 << 20, 700):
        monkeypatch.setattr(rows, "BLOCK_ROWS", block)
        found.append(fit("hydrostatic", [log], hold={"force": hold}, **more))
    compare(found[0], found[1])
    mass = found[0].parameters["mass"]
    assert abs(mass.value - 0.8) < 4.0 * mass.std_error


def compare(one, several):
    """Whether two fits found the same."""
    for name, q in one.parameters.items():
        other = several.parameters[name]
        assert other.status == q.status
        if q.status == "estimated":
            assert other.value == pytest.approx(q.value, rel=1e-9, abs=1e-9 * q.std_error)
            assert other.std_error == pytest.approx(q.std_error, rel=1e-9)
    assert several.fitted[0].simulated == pytest.approx(one.fitted[0].simulated, abs=1e-12)
    for (name, a), b in zip(examined(one).items(), examined(several).values(), strict=True):
        assert b == pytest.approx(a, rel=1e-6, abs=1e-6), name


def examined(result):
    """What the examinations found of the fit."""
    details = result.document.fit.details
    terms = details["missing_response"].items()
    found = {f"{name}, {key}": t[key] for name, t in terms for key in ("size", "deviations")}
    late = details["given"]["one_sample_late"]["force"]
    parts = details["parts"]["halves"]
    return found | {
        "influence": details["influence"]["largest_influence"],
        "leverage": details["influence"]["largest_leverage"],
        "late": late["seen_in_residual"],
        "halves": abs(parts["deviations"]),
    }


def test_a_triangle_keeps_the_products_of_columns(monkeypatch):
    rng = np.random.default_rng(7)
    monkeypatch.setattr(rows, "BLOCK_ROWS", 500)
    n = 20_000
    k = np.arange(n)
    large = 1e9 * rng.standard_normal(n)
    table = np.column_stack((
        np.exp(-k / 300.0),  # a free response, over in the first blocks
        np.zeros(n),
        np.ones(n),
        large,
        1e-9 * large + 1e-5 * rng.standard_normal(n),  # all but the one before
        (k > 11_000) * rng.standard_normal(n),  # nothing for the first half
    ))  # fmt: skip
    exact = table.astype(np.longdouble)
    products = exact.T @ exact
    size = np.sqrt(np.diag(products))
    size[size == 0.0] = 1.0
    found = condensed([table]).astype(np.longdouble)
    assert found.shape == (6, 6)
    assert np.abs((found.T @ found - products) / np.outer(size, size)).max() < 1e-13


def test_covariance_of_coloured_residuals_is_that_of_the_toeplitz_matrix(monkeypatch):
    rng = np.random.default_rng(8)
    n = 1500
    white = rng.standard_normal(n)
    residual = white.copy()
    for k in range(2, n):
        residual[k] += 1.1 * residual[k - 1] - 0.3 * residual[k - 2]
    j = np.column_stack((np.ones(n), np.sin(0.01 * np.arange(n))))
    a, variance = fit_autoregression([residual], 25)
    spectrum = np.abs(np.fft.rfft(np.concatenate(([1.0], -a)), 1 << 14)) ** 2
    r = np.fft.irfft(variance / spectrum, 1 << 14)[:n]
    degrees = n - 2
    sigma2 = float(residual @ residual) / degrees
    r *= n / degrees
    r *= max(sigma2 / r[0], 1.0)
    bread = np.linalg.inv(j.T @ j)
    expected = bread @ (j.T @ toeplitz(r) @ j) @ bread
    for block in (1 << 20, 64):
        monkeypatch.setattr(rows, "BLOCK_ROWS", block)
        assert covariance([j], [residual]).covariance == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize(
    ("sizes", "most"),
    [
        # an examination more is done below 200,000 rows
        ((20_000, 40_000), 500),
        pytest.param((210_000, 310_000), 350, marks=pytest.mark.slow),
    ],
)
def test_another_row_of_a_long_log_takes_little_memory(monkeypatch, sizes, most):
    monkeypatch.setattr(rows, "BLOCK_ROWS", 1 << 12)
    log = second_order_log(sizes[1], False, True)
    # what a first fit imports would hide the memory of rows
    fit("hydrostatic", {name: values[:2000] for name, values in log.items()})
    peaks = []
    for samples in sizes:
        tracemalloc.start()
        fit("hydrostatic", iter([{name: values[:samples] for name, values in log.items()}]))
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    # time, input and output, the derivatives by four parameters, residual and simulation are 72
    # bytes, a fit of an input that was delayed another 32; states and columns that come and go are
    # the rest
    assert (peaks[1] - peaks[0]) / (sizes[1] - sizes[0]) < most


@pytest.mark.parametrize("order", [1, -1])
def test_blocks_that_hold_one_direction_each_keep_the_products(order):
    """As logs at one constant speed each do, the later ones far beyond those before."""
    rng = np.random.default_rng(3)
    small = [1e-9 * rng.standard_normal((40, 3)) for _ in range(2)]
    large = [np.outer(rng.standard_normal(40), direction) for direction in np.eye(3)[:2] + 0.5]
    parts = [*small, *large][::order]
    found = condense(iter(parts)).astype(np.longdouble)
    exact = np.vstack(parts).astype(np.longdouble)
    products = exact.T @ exact
    size = np.sqrt(np.diag(products))
    assert np.abs((found.T @ found - products) / np.outer(size, size)).max() < 1e-13
