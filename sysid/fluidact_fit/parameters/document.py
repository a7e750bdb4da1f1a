"""The parameter document, version 1: every key a parameter file may hold.

A document checks itself whenever it is made. What a key *means* for a family (units,
ranges, lengths) is checked in ``validation``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from datetime import datetime
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Discriminator,
    Field,
    Tag,
    ValidationError,
    ValidationInfo,
    field_validator,
    model_validator,
)
from pydantic_core import InitErrorDetails, PydanticCustomError

from ..experiment import FloatArray
from ..options import FamilyOptions
from ..specification import Described, Plant, Quantity, ReadT, Status, Value, entry_name
from .problems import Location, suggest

# Tags of union members start with a character that no key of a document starts with, so
# that they can be taken out of the path of a problem again.
TAG = "~"

# Rounding of printed numbers is no reason to reject a file.
_RELATIVE = 1e-9
_WITHOUT_ERROR = ("fixed", "not_identified")  # statuses of values that were not measured
_EIGENVALUE = 1e-8


def _nested(least: int, most: int) -> Callable[[Any], str]:
    def tag(value: Any) -> str:
        depth = 0
        while isinstance(value, (list, tuple)) and depth < most:
            value, depth = value[0] if value else None, depth + 1
        return f"{TAG}{max(depth, least)}"

    return tag


Number = Annotated[float, Field(allow_inf_nan=False)]
Row = Annotated[list[Number], Field(min_length=1)]
Table = Annotated[list[Row], Field(min_length=1)]
Pair = Annotated[list[Number], Field(min_length=2, max_length=2)]
Pairs = Annotated[list[Pair], Field(min_length=1)]
PairTable = Annotated[list[Pairs], Field(min_length=1)]
AnyValue = Annotated[
    Annotated[Number, Tag("~0")] | Annotated[Row, Tag("~1")] | Annotated[Table, Tag("~2")],
    Discriminator(_nested(0, 2)),
]
AnyInterval = Annotated[
    Annotated[Pair, Tag("~1")] | Annotated[Pairs, Tag("~2")] | Annotated[PairTable, Tag("~3")],
    Discriminator(_nested(1, 3)),
]
Free = dict[str, Any]  # numbers, text and lists of them; what they mean is up to the family
Count = Annotated[int, Field(ge=0, le=2**53)]  # beyond it, JSON readers lose digits
_REAL = r"[-+]?[0-9]+(\.[0-9]+)?(e[-+]?[0-9]+)?"
_EXCLUDED = rf"^(run=[0-9]+|(lines|rows)=[0-9]+(:[0-9]+)?|time=({_REAL})?:({_REAL})?)$"  # of a log
_WINDOW = rf"^({_REAL}:({_REAL})?|:{_REAL})$"  # seconds that were used
_IN_NAME = r"^([^{}]+\{[^{}]*\}[^{}]*|\{[^{}]*\}[^{}]+)$"  # text around {UNIT}
Percent = Annotated[Number, Field(le=100.0)]
Verdict = Literal["pass", "warn", "fail"]


def refuse(objections: Iterable[tuple[Location, str]]) -> None:
    """Raise what a validator objects to, each with its place below what is validated."""
    errors = [
        InitErrorDetails(
            type=PydanticCustomError("objection", "{words}", {"words": words}),
            loc=place,
            input=None,
        )
        for place, words in objections
    ]
    if errors:
        raise ValidationError.from_exception_data("document", errors)


def _as(model: type[BaseModel]) -> AfterValidator:
    """Check of a free part: what this program reads of it has to be as in a model."""

    def check(part: Free | None) -> Free | None:
        model.model_validate(part or {})
        return part

    return AfterValidator(check)


class Part(BaseModel):
    """A mapping of the document: its own keys and no others."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, populate_by_name=True)

    def to_dict(self) -> dict[str, Any]:
        """Return the part as plain dicts, lists, text and numbers.

        Keys stand in the order of the file; keys without a value are left out.
        """
        return self.model_dump(exclude_none=True, by_alias=True)


class Derived(Part):
    """A number computed from the parameters."""

    value: AnyValue
    unit: str
    std_error: AnyValue | None = None
    ci95: AnyInterval | None = None
    status: Status | None = None
    method: str | None = None

    @field_validator("value", "std_error", "ci95")
    @classmethod
    def _fit_each_other(cls, found: Any, info: ValidationInfo) -> Any:
        value = found if info.field_name == "value" else info.data.get("value")
        if found is not None and value is not None:
            refuse(_misfits(str(info.field_name), _array(found), _array(value)))
        return found


class Parameter(Derived):
    """A physical parameter: SI value, unit, uncertainty, and where it came from."""

    status: Status

    @model_validator(mode="after")
    def _errs_where_estimated(self) -> Self:
        given = [key for key in ("std_error", "ci95") if getattr(self, key) is not None]
        words = f"a parameter that is {self.status} has none"
        refuse(((key,), words) for key in given if self.status in _WITHOUT_ERROR)
        return self


def _array(value: Any) -> FloatArray:
    """Return numbers as an array, an empty one when the lists are ragged."""
    try:
        return np.array(value, dtype=np.float64)
    except ValueError:
        return np.zeros(0)


def _misfits(key: str, found: FloatArray, value: FloatArray) -> Iterable[tuple[Location, str]]:
    def where(wrong: Any, words: str, numbers: FloatArray = value) -> Iterable[Any]:
        for index in map(tuple, np.argwhere(wrong).tolist()):
            yield index, words.format(float(numbers[index]))

    if key == "value":
        if not value.size:
            yield (), "its rows differ in length"
    elif key == "std_error":
        if found.shape != value.shape:
            yield (), "does not have the shape of the value"
        else:
            yield from where(found < 0.0, "{!r} is negative", found)
    elif found.shape != (*value.shape, 2):
        yield (), "is not one [low, high] for each number of the value"
    else:
        low, high = found[..., 0], found[..., 1]
        slack = _RELATIVE * np.maximum(np.abs(value), np.abs(found).max(axis=-1))
        yield from where(low > high, "low is above high")
        outside = (value < low - slack) | (value > high + slack)
        yield from where(outside & (low <= high), "does not contain the value {!r}")


class Covariance(Part):
    """Covariance of the estimates; list entries are named as in control_points[2]."""

    order: list[str]
    matrix: list[list[Number]]

    @field_validator("order")
    @classmethod
    def _name_once(cls, order: list[str]) -> list[str]:
        first = {name: i for i, name in reversed(list(enumerate(order)))}
        twice = [i for i, name in enumerate(order) if first[name] != i]
        refuse([((i,), f"{order[i]!r} is listed twice") for i in twice])
        return order

    @field_validator("matrix")
    @classmethod
    def _is_covariance(cls, matrix: list[list[float]], info: ValidationInfo) -> list[list[float]]:
        rows, widths = len(matrix), sorted({len(row) for row in matrix})
        names = len(info.data.get("order", matrix))
        if widths not in ([], [rows]):
            entries = " or ".join(map(str, widths))
            refuse([((), f"is not square: {rows} rows of {entries} entries")])
        if names != rows:
            refuse([((), f"has {rows} rows, but order has {names} names")])
        if rows:
            refuse(_flaws(_array(matrix)))
        return matrix


def _flaws(matrix: FloatArray) -> Iterable[tuple[Location, str]]:
    variances = np.diag(matrix)
    for index in np.flatnonzero(variances < 0.0).tolist():
        yield (index, index), "is a negative variance"
    # Parameters differ by many powers of ten: what is small is only known after scaling.
    # What does not vary cannot vary along with anything.
    spread = np.sqrt(np.where(variances > 0.0, variances, np.finfo(np.float64).tiny))
    with np.errstate(all="ignore"):
        scaled = matrix / spread[:, None] / spread
        skew = np.argwhere(np.abs(scaled - scaled.T) > _RELATIVE).tolist()
    if skew:
        row, column = skew[0]
        yield (), f"is not symmetric: [{row}][{column}] and [{column}][{row}] differ"
    elif np.all(variances >= 0.0):
        bounded = np.all(np.abs(scaled) <= 1.0 + _EIGENVALUE)
        if not bounded or np.linalg.eigvalsh(scaled)[0] < -_EIGENVALUE:
            yield (), "is not positive semidefinite"


class Range(Part):
    """The range of a role that the data covered; outside it the model extrapolates."""

    low: Number
    high: Number
    unit: str

    @model_validator(mode="after")
    def _is_range(self) -> Self:
        if self.low > self.high:
            refuse([(("low",), f"{self.low!r} is above high, {self.high!r}")])
        return self


class Measure(Part):
    """A number with its SI unit."""

    value: Number
    unit: str


class Deviation(Measure):
    """A root mean square, which has no sign."""

    value: Annotated[Number, Field(ge=0.0)]


class Whiteness(Part):
    """Test of the residuals for structure that the model lacks."""

    statistic: Number
    p_value: Annotated[Number, Field(ge=0.0, le=1.0)]
    lags: Count | None = None
    method: str | None = None


class LogFit(Part):
    """Fit of the model to one log.

    ``offset`` is what was added to the model's output for this log; ``left_out`` counts the
    samples that the model does not claim to describe.
    """

    file: str
    samples: Count | None = None
    left_out: Count | None = None
    offset: Measure | None = None
    rmse: Deviation | None = None
    fit_percent: Percent | None = None
    residual_whiteness: Whiteness | None = None
    verdict: Verdict | None = None
    details: Free | None = None


class _KnownDetails(BaseModel):
    """Those of the details that this program reads; whatever else stands there is left alone."""

    model_config = ConfigDict(strict=True)

    output_resolution: Annotated[Number, Field(ge=0.0)] | None = None
    comparisons: dict[str, list[dict[str, Any]]] | None = None


class Fit(Part):
    """Fit of the model to the data it was fitted to."""

    verdict: Verdict
    fit_percent: Percent | None = None
    # mean output of all fitted logs, the reference of fit_percent; without it, each log's own
    level: Measure | None = None
    rmse: Deviation
    samples: Annotated[Count, Field(ge=1)]
    residual_whiteness: Whiteness | None = None
    method: str | None = None
    logs: list[LogFit] = []
    details: Annotated[Free | None, _as(_KnownDetails)] = None


class WarningEntry(Part):
    """A warning: a stable code for programs and a sentence for people."""

    code: str
    message: str


class Tool(Part):
    """The program that wrote the file."""

    name: str
    version: str


class Step(Part):
    """A signal that was not recorded: a step at an instant [s], in the column's unit."""

    start: Number = Field(alias="from")
    end: Number = Field(alias="to")
    at: Number


class Column(Part):
    """Source of a role, and its conversion to SI.

    ``assumed`` says that neither the log nor the user named the unit; ``hold`` is the hold
    with which the fit took the signal. ``turn`` is what the column begins again after, as written,
    0 for never. ``from_name`` says where a constant stood in the name of
    the log: ``kinked{%}``.
    """

    header: str | None = None
    step: Step | None = None
    from_name: Annotated[str, Field(pattern=_IN_NAME, max_length=200)] | None = None
    unit: str
    scale: Number | None = None
    assumed: bool | None = None
    turn: Annotated[Number, Field(ge=0.0)] | None = None
    hold: Literal["zoh", "foh", "smooth"] | None = None


class _KnownReading(BaseModel):
    """How a log is written, as options of the reader."""

    model_config = ConfigDict(strict=True, extra="forbid")

    decimal: Annotated[str, Field(max_length=10)] | None = None
    thousands: Annotated[str, Field(max_length=10)] | None = None
    delimiter: Annotated[str, Field(max_length=10)] | None = None
    skip_rows: Annotated[int, Field(ge=0)] = 0
    header_row: Annotated[int, Field(ge=1)] | None = None


class _KnownLogDetails(BaseModel):
    """Those of the details of a log that this program reads."""

    model_config = ConfigDict(strict=True)

    exclude: list[Annotated[str, Field(pattern=_EXCLUDED, max_length=100)]] = []
    window: Annotated[str, Field(pattern=_WINDOW, max_length=100)] | None = None
    invalid: Literal["drop", "refuse"] | None = None
    reading: _KnownReading | None = None

    @field_validator("window")
    @classmethod
    def _starts_first(cls, window: str | None) -> str | None:
        low, high = window_ends(window)
        if low is not None and high is not None and low >= high:
            raise ValueError(f"the window '{window}' is empty")
        return window


def window_ends(window: str | None) -> tuple[float | None, float | None]:
    """Ends of a window as a log's details hold it, ``0.5:8`` [s]; ``None`` for an open one."""
    low, _, high = (window or "").partition(":")
    return float(low) if low else None, float(high) if high else None


class LogSource(Part):
    """A recorded log, as it was read."""

    file: str
    sha256: Annotated[str, Field(pattern="^[0-9a-f]{64}$")]
    rows: Count
    sample_time: Annotated[Number, Field(ge=0.0)] | None = None
    columns: dict[str, Column] = {}
    details: Annotated[Free | None, _as(_KnownLogDetails)] = None


class _Choices(Part):
    """User's choices for single parameters and roles [SI]; a check uses them again."""

    fixed: dict[str, Number] = {}
    start: dict[str, Number] = {}
    bounds: dict[str, Pair] = {}
    noise: dict[str, Annotated[Number, Field(ge=0.0)]] = {}


class Provenance(Part):
    """Origin of the numbers."""

    tool: Tool
    created: str
    command: str | None = None
    logs: list[LogSource] = []
    seed: Annotated[int, Field(ge=0)] | None = None
    options: Annotated[Free | None, _as(_Choices)] = None

    @field_validator("created")
    @classmethod
    def _is_instant(cls, created: str) -> str:
        try:
            datetime.fromisoformat(created)
        except ValueError:
            refuse([((), f"{created[:60]!r} is not an instant, such as '2026-11-20T22:00:00Z'")])
        return created


class ParameterDocument(Part):
    """A parameter file of fluidact-fit. All values are SI."""

    format: Literal["fluidact-parameters"]
    format_version: Literal[1]
    family: str
    variant: str | None = None
    accepted_failed: bool | None = None
    parameters: dict[str, Parameter]
    derived: dict[str, Derived] = {}
    model: Free = {}
    warnings: list[WarningEntry] = []
    fit: Fit
    validation: list[LogFit] = []
    validity: dict[str, Range] = {}
    options: Free | None = None
    covariance: Covariance | None = None
    provenance: Provenance

    @field_validator("covariance")
    @classmethod
    def _names_parameters(cls, covariance: Covariance | None, info: ValidationInfo) -> Any:
        parameters: dict[str, Parameter] | None = info.data.get("parameters")
        if covariance is None or parameters is None:
            return covariance
        names = {
            entry_name(name, index)
            for name, entry in parameters.items()
            for index in np.ndindex(np.shape(entry.value))
        }
        refuse(
            (
                ("order", place),
                f"{name!r} is not a number among the parameters"
                + suggest(name.partition("[")[0], parameters),
            )
            for place, name in enumerate(covariance.order)
            if name not in names
        )
        heads = [(place, name.partition("[")[0]) for place, name in enumerate(covariance.order)]
        refuse(
            (("order", place), f"{head!r} is {parameters[head].status}: it has no variance")
            for place, head in heads
            if parameters[head].status in _WITHOUT_ERROR
        )
        return covariance

    def values(self) -> dict[str, Value]:
        """Return the parameter values by name [SI], in the family's order."""
        return {name: entry.value for name, entry in self.parameters.items()}

    def settled_options(self, options_type: type[ReadT]) -> ReadT:
        """Return the options as the fit settled them."""
        return options_type.read(self.options or {}, from_file=True)

    def plant(self, family: Described) -> Plant[FamilyOptions]:
        """Return the model of the document, whose family is given, with its numbers."""
        options = self.settled_options(family.options_type)
        return Plant(family.variant(self.variant), self.values(), options)

    def quantities(self) -> dict[str, Quantity]:
        """Return the parameters with their uncertainty by name, in the family's order."""
        return {name: Quantity(**dict(entry)) for name, entry in self.parameters.items()}

    def __repr__(self) -> str:
        count = len(self.parameters)
        return f"<ParameterDocument {self.family}: {count} parameters, {self.fit.verdict}>"

    __str__ = __repr__
