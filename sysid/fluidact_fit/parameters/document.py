"""The parameter document, version 1: every key a parameter file may hold.

What a key *means* for a family (units, ranges, lengths) is checked in ``validation``.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Discriminator, Field, Tag

from ..specification import Quantity, Status, Value

FORMAT = "fluidact-parameters"

# Tags of union members start with a character that no key of a document starts with, so
# that they can be taken out of the path of a problem again.
TAG = "~"


def _rank(value: Any) -> str:
    rank = 0
    while isinstance(value, (list, tuple)) and value and rank < 3:
        value = value[0]
        rank += 1
    if isinstance(value, (list, tuple)):
        rank += 1
    return f"{TAG}{min(rank, 3)}"


def _value_rank(value: Any) -> str:
    return min(_rank(value), f"{TAG}2")


def _interval_rank(value: Any) -> str:
    return max(_rank(value), f"{TAG}1")


Number = Annotated[float, Field(allow_inf_nan=False)]
Row = Annotated[list[Number], Field(min_length=1)]
Table = Annotated[list[Row], Field(min_length=1)]
Pair = Annotated[list[Number], Field(min_length=2, max_length=2)]
Pairs = Annotated[list[Pair], Field(min_length=1)]
PairTable = Annotated[list[Pairs], Field(min_length=1)]
AnyValue = Annotated[
    Annotated[Number, Tag("~0")] | Annotated[Row, Tag("~1")] | Annotated[Table, Tag("~2")],
    Discriminator(_value_rank),
]
AnyInterval = Annotated[
    Annotated[Pair, Tag("~1")] | Annotated[Pairs, Tag("~2")] | Annotated[PairTable, Tag("~3")],
    Discriminator(_interval_rank),
]
Free = dict[str, Any]  # numbers, text and lists of them; what they mean is up to the family
Count = Annotated[int, Field(ge=0)]


class Part(BaseModel):
    """A mapping of the document: its own keys and no others."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)


class Derived(Part):
    """A number computed from the parameters."""

    value: AnyValue
    unit: str
    std_error: AnyValue | None = None
    ci95: AnyInterval | None = None
    status: Status | None = None
    method: str | None = None


class Parameter(Part):
    """A physical parameter: SI value, unit, uncertainty, and where it came from."""

    value: AnyValue
    unit: str
    std_error: AnyValue | None = None
    ci95: AnyInterval | None = None
    status: Status
    method: str | None = None


class Covariance(Part):
    """Covariance of the estimates; list entries are named as in control_points[2]."""

    order: list[str]
    matrix: list[list[Number]]


class Range(Part):
    """The range of a role that the data covered; outside it the model extrapolates."""

    low: Number
    high: Number
    unit: str


class Measure(Part):
    """A number with its SI unit."""

    value: Number
    unit: str


class Whiteness(Part):
    """Test of the residuals for leftover structure."""

    statistic: Number
    p_value: Annotated[Number, Field(ge=0.0, le=1.0)]
    lags: Count | None = None
    method: str | None = None


class LogFit(Part):
    """How well the model describes one log."""

    file: str
    samples: Count | None = None
    left_out: Count | None = None
    offset: Measure | None = None
    rmse: Measure | None = None
    fit_percent: Annotated[Number, Field(le=100.0)] | None = None
    residual_whiteness: Whiteness | None = None
    verdict: Literal["pass", "warn", "fail"] | None = None
    details: Free | None = None


class Fit(Part):
    """How well the model describes the data it was fitted to."""

    samples: Count
    rmse: Measure
    fit_percent: Annotated[Number, Field(le=100.0)] | None = None
    residual_whiteness: Whiteness | None = None
    verdict: Literal["pass", "warn", "fail"]
    method: str | None = None
    logs: list[LogFit] = []
    details: Free | None = None


class WarningEntry(Part):
    """A warning: a stable word for programs and a sentence for people."""

    code: str
    message: str


class Tool(Part):
    """The program that wrote the file."""

    name: str
    version: str


class LogSource(Part):
    """A recorded log, as it was read."""

    file: str
    sha256: Annotated[str, Field(pattern="^[0-9a-f]{64}$")]
    rows: Count
    sample_time: Annotated[Number, Field(ge=0.0)] | None = None
    columns: dict[str, Free] = {}
    details: Free | None = None


class Provenance(Part):
    """Where the numbers came from."""

    tool: Tool
    created: str
    command: str | None = None
    logs: list[LogSource] = []
    seed: int | None = None
    options: Free | None = None


class ParameterDocument(Part):
    """A parameter file of fluidact-fit. All values are SI."""

    format: Literal["fluidact-parameters"]
    format_version: Literal[1]
    family: str
    variant: str | None = None
    options: Free | None = None
    accepted_failed: bool | None = None
    parameters: dict[str, Parameter]
    derived: dict[str, Derived] = {}
    covariance: Covariance | None = None
    model: Free = {}
    validity: dict[str, Range] = {}
    fit: Fit
    validation: list[LogFit] = []
    warnings: list[WarningEntry] = []
    provenance: Provenance

    def values(self) -> dict[str, Value]:
        """Return the parameter values by name [SI], in the family's order."""
        return {name: entry.value for name, entry in self.parameters.items()}

    def quantities(self) -> dict[str, Quantity]:
        """Return the parameters with their uncertainty by name, in the family's order."""
        return {
            name: Quantity(
                value=entry.value,
                unit=entry.unit,
                status=entry.status,
                std_error=entry.std_error,
                ci95=entry.ci95,
                method=entry.method,
            )
            for name, entry in self.parameters.items()
        }

    def to_dict(self) -> dict[str, Any]:
        """Return the document as plain dicts, lists, text and numbers.

        Keys stand in the order of the file; keys without a value are left out.
        """
        return self.model_dump(exclude_none=True)
