"""Equations as MathML."""

from __future__ import annotations

import re
from xml.etree import ElementTree

import pytest

from fluidact_fit.families import family_names, get_family
from fluidact_fit.report.equation import typeset

EQUATIONS = sorted(
    {v.equation or get_family(n).equation for n in family_names() for v in get_family(n).variants}
)


def read(html: str) -> str:
    """Text of all formulas, numerator and denominator behind each other."""
    return "".join(ElementTree.fromstring(f"<p>{html.replace('<wbr>', '')}</p>").itertext())


@pytest.mark.parametrize("text", EQUATIONS)
def test_equations_of_all_families_are_typeset_whole(text: str) -> None:
    html = typeset(text)
    assert "<math" in html
    assert "<code>" not in html
    for word in set(re.findall(r"[^\W\d_]{3,}", text)) - {"sqrt"}:
        assert word in read(html), word


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        ("y = a * b / (c + 1)", ["<mfrac><mrow><mi>a</mi><mo>·</mo><mi>b</mi></mrow><mrow><mrow>"]),
        ("y = (a + 1) / 2 - (b + 1) * c", ["<mn>2</mn>", "<mo>(</mo>"]),
        ("x'' = w[i] |v|", ["′′", "<msub><mi>w</mi>", "<mo>|</mo>"]),
        ("p_1 = -p2^2", ["<msub><mi>p</mi><mrow><mi>1</mi>", "<msup>", "−"]),
        ("f = sqrt(a / b)", ["<msqrt><mrow><mfrac>"]),
    ],
)
def test_what_is_written_is_what_is_set(text: str, parts: list[str]) -> None:
    for part in parts:
        assert part in typeset(text)


def test_parts_of_absent_parameters_are_left_out() -> None:
    text = "y = a (* (late s + 1)) / (s + b (+ stiffness x))"
    assert read(typeset(text)) == "y=a·(lates+1)s+b+stiffnessx"
    assert read(typeset(text, {"late"})) == "y=as+b+stiffnessx"
    assert read(typeset(text, {"late", "stiffness", "other"})) == "y=as+b"


@pytest.mark.parametrize("text", [e for e in EQUATIONS if "stribeck_speed" in e])
def test_a_rise_of_friction_that_was_not_fitted_is_left_out(text: str) -> None:
    html = typeset(text, {"stribeck", "stribeck_speed"})
    assert "<math" in html
    assert "stribeck" not in html
    assert "exp" not in html


@pytest.mark.parametrize("text", ["y = (a", "y = a)", "y = <b>&x", "= ", "y = $x", "a ^ = b"])
def test_what_is_no_equation_stays_as_it_is_typed(text: str) -> None:
    html = typeset(text)
    assert html.startswith("<code>")
    assert "<b>" not in html


def test_brackets_fall_only_around_a_whole_part_of_a_fraction() -> None:
    assert read(typeset("y = (a + b) (c + d) / e")) == "y=(a+b)(c+d)e"
    assert read(typeset("y = (a + b) / (c + d)")) == "y=a+bc+d"
