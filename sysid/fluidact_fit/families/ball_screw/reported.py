"""Static levels in the fit, as excess over the kinetic ones, and in the file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ...errors import Notice
from ...estimation.parametric import Fitted
from ...family import ParameterSpec, Variant
from .model import SIDES


def stiction_specs(variant: Variant) -> list[ParameterSpec]:
    """Specifications of the internal static excess over the kinetic level."""
    return [
        replace(s, name=s.name.replace("breakaway", "stiction"))
        for s in variant.parameters
        if s.name.startswith("breakaway")
    ]


def to_breakaway(fitted: Fitted) -> Fitted:
    """Turn ``stiction`` into ``breakaway = coulomb + stiction``, covariance included."""
    names = list(fitted.names)
    turn = np.eye(len(names))
    values, status = dict(fitted.values), dict(fitted.status)
    for s in SIDES:
        inner, outer, base = f"stiction_{s}", f"breakaway_{s}", f"coulomb_{s}"
        if inner not in values:
            continue
        values[outer] = values[base] + values.pop(inner)
        status[outer] = status.pop(inner)
        if inner in names:
            k = names.index(inner)
            names[k] = outer
            if base in names:
                turn[k, names.index(base)] = 1.0
        elif status[base] == "not_identified":
            status[outer] = "not_identified"
    u = fitted.uncertainty
    turned = replace(u, covariance=turn @ u.covariance @ turn.T)
    return replace(fitted, names=tuple(names), values=values, status=status, uncertainty=turned)


def rename_notices(notices: Sequence[Notice], variant: Variant) -> list[Notice]:
    """Say in the file's own words what was refused."""
    out = []
    for n in notices:
        if n.code == "not-identified" and n.message.startswith("stiction_"):
            side = "positive" if n.message.startswith("stiction_positive") else "negative"
            reason = n.message.split(": ", 1)[1].split(" It is written")[0]
            remedy = next(s for s in variant.parameters if s.name == f"breakaway_{side}").remedy
            message = (
                f"breakaway_{side} cannot be determined from these data: {reason} It is written "
                f"as the kinetic level, status not_identified. {remedy}"
            )
            out.append(Notice(n.code, message))
        else:
            out.append(n)
    return out
