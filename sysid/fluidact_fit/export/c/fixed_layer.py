"""Layers of a network in fixed point: a row of products with one exponent, summed without shifts.

The exponents of the weights absorb those of the inputs and the next layer those of the outputs, so
that every output is the upper half of its sum. Inputs count from the lower end of their range and
the signs of the weights are those of the terms: products of unsigned numbers take an AVR half the
time of signed ones.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import ceil

import numpy as np

from ...experiment import FloatArray
from ...routines.expression import Item
from ...routines.routine import Layer, as_matrix
from ..ranges import Range, extreme
from .fixed_sheet import Sheet, Value
from .fixed_table import NotFixed, exponent_for
from .language import Folded

_PRODUCTS = 2000  # of a layer: they are written one by one
_FINE = 2.0**-15  # error of the table of an activation that all outputs share
_HALF = 2**15  # of the units that are cut off below the upper half of a sum


@dataclass(frozen=True)
class _Row:
    """One output: integers, their common exponent, and the range of the sum."""

    weights: tuple[int, ...]
    biases: tuple[int, ...]
    exponent: int
    sum: Range


def write_layer(
    sheet: Sheet, layer: Layer, folded: Folded, given: list[Value], condition: str
) -> list[Value]:
    """Write the outputs of a layer down.

    Parameters
    ----------
    sheet
        Where to.
    layer, folded
        The layer, and as :func:`fold` leaves it.
    given
        The inputs of ``folded``, as factors.
    condition
        What chooses the first row of its biases; empty where there is only one.
    """
    if sheet.width.bits != 15:
        raise NotFixed("a network is not computed with wider factors")
    if len(layer.biases) * len(given) > _PRODUCTS:
        raise NotFixed(f"a layer of it has more than {_PRODUCTS} products")
    inputs = [_from_zero(sheet, x) for x in given]
    shift = np.array([float(x.range.low.min() - y.range.low.min()) for x, y in zip(given, inputs)])
    biases = np.array(folded.biases) + np.array(folded.weights) @ shift
    folded = replace(folded, biases=as_matrix(biases))
    bits = 30 if layer.activation == "linear" else 31
    count = len(layer.biases)
    exponents = [_exponent(folded, k, inputs, bits) for k in range(count)]
    if layer.activation == "tanh":
        exponents = [max(exponents)] * count
    rows = [_row(folded, k, inputs, exponents[k]) for k in range(count)]
    side = ""
    if condition:
        side = sheet.name("int8_t", f"({condition}) ? 0 : 1", "which biases")
        sheet.biases[layer.name] = tuple(zip(*(row.biases for row in rows)))
    hulls = [row.sum.hull() for row in rows]
    whole = Range(
        np.min([h.low for h in hulls], axis=0), np.max([h.high for h in hulls], axis=0),
        np.max([h.error for h in hulls], axis=0),
    )  # fmt: skip
    found = []
    before = sheet.word, sheet.subject
    for k, row in enumerate(rows):
        sheet.word, sheet.subject = layer.name, Item(layer.name, k)
        bias = sheet.width.literal(row.biases[0])
        if side:
            table = f"{layer.name}_biases"
            bias = f"{sheet.prefix.upper()}_READ_LONG({table}[{side}][{k}])"
        found.append(_finish(sheet, layer, _write_sum(sheet, row, inputs, bias), row, whole))
    sheet.word, sheet.subject = before
    return found


def _from_zero(sheet: Sheet, x: Value) -> Value:
    """An input as an unsigned number that counts from the lower end of its range."""
    first = ceil(float((x.range.low - x.range.error).min()) / x.unit - 1e-9)
    if first == 0:
        return x
    off = first * x.unit
    found = Range(x.range.low - off, x.range.high - off, x.range.error)
    text = f"(uint16_t)({x.text} - {sheet.width.literal(first)})"
    name = sheet.name("uint16_t", text, f"{x.text} from the lower end of its range")
    return replace(x, text=name, range=found, bits=16)


def _exponent(folded: Folded, k: int, inputs: list[Value], bits: int) -> int:
    """Smallest exponent where the sum and every weight fit."""
    weights, biases = folded.weights[k], [b[k] for b in folded.biases]
    reach = max(map(abs, biases)) + sum(abs(w) * x.range.reach for w, x in zip(weights, inputs))
    room = (len(inputs) + 2) * 2.0**-15  # for what rounding adds to the terms and to the sum
    exponent = exponent_for(reach * (1.0 + room), bits)
    for w, x in zip(weights, inputs):
        if w != 0.0:
            exponent = max(exponent, exponent_for(abs(w), 16) + x.exponent)
    return exponent


def _row(folded: Folded, k: int, inputs: list[Value], exponent: int) -> _Row:
    biases = [b[k] for b in folded.biases]
    whole = tuple(round(b / 2.0**exponent) for b in biases)
    low, high = np.array([min(biases)]), np.array([max(biases)])
    off_low = off_high = np.zeros(1)  # the error that the rounded weights make, with its sign
    carried: FloatArray = np.zeros(1)
    weights = []
    for w, x in zip(folded.weights[k], inputs):
        weights.append(round(w / 2.0 ** (exponent - x.exponent)))
        off = weights[-1] * 2.0 ** (exponent - x.exponent) - w
        r = x.range
        low = low + np.minimum(w * r.low, w * r.high)
        high = high + np.maximum(w * r.low, w * r.high)
        off_low = off_low + np.minimum(off * r.low, off * r.high)
        off_high = off_high + np.maximum(off * r.low, off * r.high)
        carried = carried + (abs(w) + abs(off)) * r.error
    error = carried + np.maximum(np.abs(off_low), np.abs(off_high)) + 2.0 ** (exponent - 1)
    return _Row(tuple(weights), whole, exponent, Range(low, high, error))


def _write_sum(sheet: Sheet, row: _Row, inputs: list[Value], bias: str) -> str:
    text = bias
    for w, x in zip(row.weights, inputs):
        unsigned = x.text if x.bits == 16 else f"(uint16_t){x.text}"
        if w:
            text += f" {'+' if w > 0 else '-'} (int32_t)((uint32_t){unsigned} * {abs(w)}u)"
    return sheet.new(text, row.exponent, row.sum).text


def _finish(sheet: Sheet, layer: Layer, total: str, row: _Row, whole: Range) -> Value:
    """Activation of a sum; ``whole`` is the range of all sums, so that they share a table."""
    if layer.activation == "linear":
        return Value(total, row.exponent, row.sum, 30)
    upper, unit = row.exponent + 16, 2.0**row.exponent
    near = f"({total} + INT32_C({_HALF})) >> 16"
    if layer.activation == "relu":
        found = extreme(row.sum, Range(np.zeros(1), np.zeros(1), np.zeros(1)), "max")
        text = f"(uint16_t)(({total} > 0) ? ({near}) : 0)"
        name = sheet.name("uint16_t", text, f"{total} * 2^-16 where it is positive")
        return Value(name, upper, found.wider(_HALF * unit), 15)
    x = sheet.new(f"(int16_t)({near})", upper, row.sum.wider(_HALF * unit), 15)
    half = replace(x, range=whole.wider(_HALF * unit))
    table = sheet.table(half, np.tanh, wanted=_FINE)
    r = x.range  # the slope is at most 1
    found = Range(np.tanh(r.low), np.tanh(r.high), r.error + table.error)
    return replace(sheet.lookup(x, table), range=found)
