"""SysIdentPy: polynomial NARX models; physical only where the model happens to be linear."""

from __future__ import annotations

from importlib import metadata

from conversions import second_order
from problems import Log
from sysidentpy.basis_function import Polynomial
from sysidentpy.model_structure_selection import FROLS
from sysidentpy.parameter_estimation import LeastSquares
from sysidentpy.utils.display_results import results

TITLE = "SysIdentPy"


def version() -> str:
    """Version of SysIdentPy."""
    return metadata.version("sysidentpy")


def p2(log: Log, guess: dict[str, float]) -> dict[str, float]:
    """Linear model of second order, extended least squares off, bias correction on."""
    model = FROLS(
        order_selection=True,
        n_info_values=5,
        n_terms=4,
        ylag=2,
        xlag=2,
        info_criteria="bic",
        estimator=LeastSquares(unbiased=True),
        basis_function=Polynomial(degree=1),
        err_tol=None,
    )
    model.fit(X=log.u.reshape(-1, 1), y=log.y.reshape(-1, 1))
    rows = results(model.final_model, model.theta, model.err, model.n_terms, dtype="sci")
    terms = {row[0]: float(row[1]) for row in rows}
    a1, a2 = -terms.get("y(k-1)", 0.0), -terms.get("y(k-2)", 0.0)
    return second_order(a1, a2, log.sample_time)


FITS = {"P2": p2}
