"""What a map gives for a log, and which samples it claims to describe."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...estimation.motion_state import BoolArray, running_median
from ...experiment import Experiment, FloatArray
from ...family import Simulated
from .data import branch_of, column_of, fill_direction, input_table, is_known
from .equation import NetworkMap
from .options import ForceMapOptions, default_inputs


def predict_runs(
    network: NetworkMap, experiments: Sequence[Experiment], options: ForceMapOptions
) -> list[Simulated]:
    """Output of every run; rows without a motion state and lone samples are not described."""
    out = []
    for e in experiments:
        names = options.names or default_inputs(options, [e])
        x = input_table(e, names, options)
        state = names.index("direction") if "direction" in names else None
        y, used = network.predict(fill_direction(x, names), state), is_known(x, names)
        if options.target in e:
            measured = column_of(e, options.target)
            there = np.isfinite(measured)
            level, rest = np.where(there, (measured - network.base, measured - y), 0.0)
            used &= there & ~find_spikes(level, rest, branch_of(e, options)[1])
        out.append(Simulated(y, used))
    return out


def find_spikes(output: FloatArray, residual: FloatArray, settled: BoolArray) -> BoolArray:
    """Samples that stand alone: off the fit, off their neighbours' residuals, and off them.

    Misfit of the network lasts for many samples; a load-cell spike for one to three. A jump
    of an input, as of a velocity, moves the residual but not what was measured. Just after a
    reversal a lone sample is the seal's creep. All arrays are of one run.
    """
    if residual.size < 8:
        return np.zeros(residual.size, dtype=bool)
    off = np.abs(residual - running_median(residual, 3))
    floor = 1e-6 * float(np.abs(output).max())
    limit = max(10.0 * 1.4826 * float(np.median(off)), floor)
    jump = np.abs(output - running_median(output, 3))
    far = 3.0 * 1.4826 * float(np.median(np.abs(residual)))
    return np.asarray((np.minimum(off, jump) > limit) & (off > far) & settled)
