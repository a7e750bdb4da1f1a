"""Units in and out: everything inside the package is SI, and converted here."""

from .conversion import base_units, conversion_factor, dimension_name, same_dimension, unit_doubt
from .display import DisplayUnit, display_unit
from .headers import (
    SUFFIXES,
    is_doubtful_suffix,
    looks_like_unit,
    names_input,
    parse_unit_from_header,
    unit_within,
)
from .reading import (
    after_number,
    as_share,
    as_time,
    is_known_unit,
    is_share,
    is_unit,
    pressure_reference,
    without_size,
)
from .spelling import normalise_unit

__all__ = [
    "SUFFIXES",
    "DisplayUnit",
    "after_number",
    "as_share",
    "as_time",
    "base_units",
    "conversion_factor",
    "dimension_name",
    "display_unit",
    "is_doubtful_suffix",
    "is_known_unit",
    "is_share",
    "is_unit",
    "looks_like_unit",
    "names_input",
    "normalise_unit",
    "parse_unit_from_header",
    "pressure_reference",
    "same_dimension",
    "unit_doubt",
    "unit_within",
    "without_size",
]
