"""Keys that a controller ignores, lacks, or reads in another unit."""

from __future__ import annotations

import hashlib
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import fluidact_fit as ff
from fluidact_fit.consumer import Comparison, Key, compare, hashes_in, read_consumer
from fluidact_fit.consumer.values import literals_in
from fluidact_fit.errors import ConsumerError
from fluidact_fit.export import export
from fluidact_fit.export.target import Arithmetic

GOLDEN = Path(__file__).parents[1] / "golden" / ff.__version__


def write(path: Path, text: str) -> Path:
    path.write_text(text, encoding="utf-8")
    return path


def against(family: str, *keys: Key) -> Comparison:
    path = GOLDEN / f"{family}.yaml"
    return compare(ff.load(path), keys, str(path))


HEADER = """\
#ifndef LINE_H
#define LINE_H
#include <stdint.h>
#define LINE_SAMPLES 10 + x
#define LINE_GAIN 0.98f /* 1 */
#define LINE_KIND "gain"
static const float line_time_constant = 119.9f; /* filled volume [ms] */
typedef struct { float state[4]; int16_t flags; float pressure; /* [bar] */
    double line_dead_time; // [s]
} line_t;
extern const double weights[2][3] = {
    {1.0, 2.0, 3.0},
    {1.0, 2.0, 3.0},
}; /* [1] */
static const float lookup[] PROGMEM = {1.0f}; // table of 3 [not a line
float line_step(line_t *s, float input);
#endif
"""


def test_a_header_is_read(tmp_path: Path) -> None:
    found = read_consumer(write(tmp_path / "line.h", HEADER.replace("\n", "\r\n")))
    assert found == [
        Key("LINE_SAMPLES"), Key("LINE_GAIN", "1"), Key("line_time_constant", "ms"),
        Key("state", "", False), Key("flags", "", False), Key("pressure", "bar"),
        Key("line_dead_time", "s"), Key("weights", "1"), Key("lookup"),
    ]  # fmt: skip


CONTROLLER = """\
/* Forces in [N] unless said otherwise. */
#pragma once
#include "x.h" // [m]
#define LOOP_HZ 100
#define RIG_SHIFT_EXPONENT (-5)
#define HYDROSTATIC_MASS 53.7f
/* Damping
   of the line [N s/m] */
#define HYDROSTATIC_DAMPING (1720.5f)
// half of the dead zone [kN]
// with the sign of it
static const float kDeadZoneNegative = -3e-3f, kDeadZonePositive = 1e-3f;

#define SPLIT \\
    3.5 /* see [3], a [mm] */
/* #define OLD 3.0f
#define OLDER 4.0f // [m] */
typedef struct __attribute__((packed)) {
    float mass; ///< kg
    float damping; /*!< [N s/mm] */ float other /* [s] */;
} rig_t;
static const rig_t rig = {.mass = 53.7f, /* [g] */ .damping = 2.0f, // [kg/s]
};
static const char *const text = "#define QUOTED 1.0f /* [m] */ ; const float quoted = 1.0f;";
static inline float step(float gain) { const float local = 1.0f; /* [m] */ if (gain) { } }
constexpr std::array<double, 2> pair{1.2, 3.4};  // N
const int count = 3, most = 4;
extern double const limit;
"""


def test_units_stand_beside_or_above(tmp_path: Path) -> None:
    found = read_consumer(write(tmp_path / "rig.hpp", CONTROLLER))
    assert found == [
        Key("LOOP_HZ", "", False), Key("HYDROSTATIC_MASS"), Key("HYDROSTATIC_DAMPING", "N s/m"),
        Key("kDeadZoneNegative", "kN"), Key("kDeadZonePositive", "kN"), Key("SPLIT", "mm"),
        Key("mass", "kg"), Key("damping", "N s/mm"), Key("other", "s"), Key("mass", "g"),
        Key("damping", "kg/s"), Key("pair", "N"), Key("count", "", False),
        Key("most", "", False), Key("limit", "", False),
    ]  # fmt: skip


def test_what_may_be_anything_is_a_key_where_the_file_has_one() -> None:
    """A pin or a buffer is not missing from the file; what has its name before it is."""
    found = against("line", Key("gain", "", False), Key("PIN", "", False), Key("PORT", "", False),
                    Key("LINE_TIME", "", False), Key("dead_time", "s"))  # fmt: skip
    assert [(r.consumer, r.finding) for r in found.rows] == [
        ("gain", "agrees"), ("LINE_TIME", "lacking"), ("dead_time", "agrees"), ("", "ignored"),
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("names", "finding"),
    [
        (("RIG_GAIN", "RIG_TIME_CONSTANT", "RIG_DEAD_TIME"), "agrees"),
        (("kGain", "kTimeConstant", "kDeadTime"), "agrees"),
        (("gain", "time_constant_s", "DEAD_TIME_S"), "agrees"),
        (("gain_bar", "TIME_CONSTANT_MS", "dead_time_us"), "other unit"),
        (("loop_gain", "timeConst", "RIG_DEAD_TIME"), "lacking"),
    ],
)
def test_names_agree_whatever_stands_about_them(names: tuple[str, ...], finding: str) -> None:
    rows = against("line", *map(Key, names)).rows
    assert {row.finding for row in rows if row.consumer} == {finding}


def test_a_declaration_is_read(tmp_path: Path) -> None:
    text = """\
controller:
  gain: {type: double, default_value: 1.0, description: "steady gain [Pa/V]"}
  limits:
    stroke: {type: double_array_fixed_2, description: "of the piston (full) [mm]"}
    names: {type: string_array, validation: {unique<>: null, subset_of<>: [[a, b]]}}
"""
    assert read_consumer(write(tmp_path / "c.yaml", text)) == [
        Key("gain", "Pa/V"), Key("limits.stroke", "mm"), Key("limits.names"),
    ]  # fmt: skip


@pytest.mark.parametrize(
    "text",
    [
        "# what it reads\ngain [Pa/V]\n\ndead_time[s]   # late\nlimit\n",
        "name,unit\ngain,Pa/V\ndead_time,s\nlimit,\n",
        'key;unit\ngain;"Pa/V"\ndead_time;[s]\nlimit;\n',
        "gain\tPa/V\ndead_time\ts\nlimit\n",
    ],
)
def test_a_list_is_read(text: str, tmp_path: Path) -> None:
    due = [Key("gain", "Pa/V"), Key("dead_time", "s"), Key("limit")]
    assert read_consumer(write(tmp_path / "keys.csv", text)) == due


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("none.h", None, "cannot be read"),
        ("a.h", b"int main(void);\n", "no keys"),
        ("a.h", b"\0\1", "binary"),
        ("a.h", b"float x;\n" * 2_000_000, "too large"),
        ("a.yaml", b"a: &x 1\nb: *x\n", "alias"),
        ("a.yaml", b"a: [1\n", "not YAML"),
        ("a.yaml", b"a: {b: 1}\n", "no keys"),
        ("a.txt", b"gain 3 4\n", r"line 1: 'gain 3 4' is not a key"),
        ("a.txt", b"\n# nothing\n", "no keys"),
        ("a.txt", b"x'); system('x')\n", "is not a key"),
    ],
)
def test_what_cannot_be_read_is_said(
    name: str, content: bytes | None, words: str, tmp_path: Path
) -> None:
    path = tmp_path / name
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(ConsumerError, match=words) as caught:
        read_consumer(path)
    assert caught.value.exit_status == 3


def test_a_long_header_does_not_take_forever(tmp_path: Path) -> None:
    """Declarations that never end are given up at the next one."""
    text = "static const float a =\n" * 20_000 + ";\nstatic const float b = 1.0f; /* [m] */\n"
    assert read_consumer(write(tmp_path / "a.h", text))[-1] == Key("b", "m")
    for text in ("/*", "// [m]\n", "{", "){", '"', "#define A ", "const float a[1],", "const "):
        read_consumer(write(tmp_path / "a.h", "float a;\n" + text * 80_000))


def test_findings() -> None:
    found = against(
        "line", Key("LINE_GAIN", "1"), Key("time-constant", "ms"), Key("dead_tme", "s"),
        Key("validity.inlet.low", "bar"), Key("continuous.numerator"),
    )  # fmt: skip
    assert [(r.parameter, r.consumer, r.finding) for r in found.rows] == [
        ("gain", "LINE_GAIN", "agrees"),
        ("time_constant", "time-constant", "other unit"),
        ("", "dead_tme", "lacking"),
        ("validity.inlet.low", "validity.inlet.low", "other unit"),
        ("continuous.numerator", "continuous.numerator", "agrees"),
        ("dead_time", "", "ignored"),
    ]
    assert not found.agrees
    assert "1000 times the number" in found.reasons[0]
    assert "Is dead_time meant?" in found.reasons[1]
    assert "1e-05 times" in found.reasons[2]
    assert len(found.reasons) == 4


def test_units_that_are_the_same_written_otherwise_agree() -> None:
    for unit in ("N*s/m", "N s/m", "N.s/m", "kg/s", ""):
        keys = [Key("mass", "kg"), Key("damping", unit), Key("dead_zone_negative", "N"),
                Key("DEAD_ZONE_POSITIVE", "kg m/s^2")]  # fmt: skip
        assert against("hydrostatic", *keys).agrees, unit
    for unit in ("N/m", "kN s/m", "lbf s/in", "furlongs"):
        rows = against("hydrostatic", Key("damping", unit)).rows
        assert rows[0].finding == "other unit"


@pytest.mark.parametrize("family", ff.family_names())
def test_a_file_agrees_with_its_own_declaration_and_no_other(family: str, tmp_path: Path) -> None:
    path = GOLDEN / f"{family}.yaml"
    declaration = export([path], "ros2", tmp_path)[1]
    keys = read_consumer(declaration)
    assert compare(ff.load(path), keys, str(path)).agrees
    assert not compare(ff.load(path), keys[1:], str(path)).agrees
    other = GOLDEN / ("valve.yaml" if family != "valve" else "line.yaml")
    assert not compare(ff.load(other), keys, str(other)).agrees


@pytest.mark.parametrize(
    ("family", "arithmetic"),
    [(f, "float32") for f in ff.family_names()]
    + [(f, "q15") for f in ff.family_names() if f not in ("line", "valve")],
)
def test_a_file_agrees_with_its_own_header(
    family: str, arithmetic: Arithmetic, tmp_path: Path
) -> None:
    path = GOLDEN / f"{family}.yaml"
    header = export([path], "c", tmp_path, arithmetic=arithmetic)[0]
    found = compare(ff.load(path), read_consumer(header), str(path))
    assert found.reasons == ()
    text = header.read_text()
    first = re.search(rf"#define {family.replace('-', '_').upper()}_(\w+) .*\[", text, re.DOTALL)
    assert first is not None
    header.write_text(text.replace(first[1], "SOMETHING_ELSE"))
    found = compare(ff.load(path), read_consumer(header), str(path))
    assert {row.finding for row in found.rows if row.message} == {"ignored", "lacking"}


# --------------------------------------------------------------------------------- values


@pytest.mark.parametrize(
    ("text", "due"),
    [
        ("0.98f", [(0.98, 0.005)]),
        ("(-1.50e-3)", [(-1.5e-3, 5e-6)]),
        ("{1.0f, -2.f, .5}", [(1.0, 0.05), (-2.0, 0.5), (0.5, 0.05)]),
        ("3", [(3.0, 0.0)]),
        ("- 4.25L", [(-4.25, 0.005)]),
        ("2.0f * GAIN", None),
        ("2.0f / 3.0f", None),
        ("GAIN", None),
        ("", None),
        ("0x1.8p+1f", [(3.0, 0.0)]),
        ("((float)(40.5f))", [(40.5, 0.05)]),
        ("-(2.50d)", [(-2.5, 0.005)]),
        ("1'000.5", [(1000.5, 0.05)]),
        ("053", [(43.0, 0.0)]),
        ("0.5 + 0.4", None),
        ("1.0.0", None),
    ],
)
def test_literals_say_how_far_their_digits_reach(text: str, due: Any) -> None:
    found = literals_in(text)
    assert (found is None) == (due is None)
    if found is not None:
        np.testing.assert_allclose(found, due, rtol=1e-12)


GAIN = 0.9798702038323934  # of the golden line


@pytest.mark.parametrize(
    ("literal", "agrees"),
    [
        (f"{GAIN!r}f", True), ("0.98f", True), ("0.9799", True), ("0.97987f", True),
        ("9.8e-1f", True), ("(0.980f)", True), ("0.979870200f", True),
        ("0.97f", False), ("0.9798f", False), ("0.989669f", False), ("1", False), ("1.0f", False),
        ("0.0f", False), ("-0.98f", False), ("9.8f", False), ("2.0f * 0.5f", False),
        ("0x1.0p+0f", False), ("(float)0.97", False), ("-(0.98f)", False), ("0.97d", False),
        ("0.97_si", False), ("1 << 1", False), ("(real_t)(0.98f)", True),
        ("0x1.f5b18daaee9d9p-1", True),
    ],
)  # fmt: skip
@pytest.mark.parametrize(
    "form",
    ["#define LINE_GAIN {}\n", "static const float line_gain = {};\n",
     "struct s x = {{\n    .gain = {},\n}};\n", "constexpr double kGain{{{}}};\n"],
)  # fmt: skip
def test_a_stale_number_is_found(literal: str, agrees: bool, form: str, tmp_path: Path) -> None:
    path = tmp_path / "controller.h"
    path.write_text(form.format(literal), encoding="ascii")
    block = ff.load(GOLDEN / "line.yaml")
    (row,) = (r for r in compare(block, read_consumer(path)).rows if r.parameter == "gain")
    assert row.finding == ("agrees" if agrees else "other value")
    named = "computes" if re.search(r"[*_<]", literal) and not agrees else "0.97987"
    assert (named in row.message) == (not agrees)


@pytest.mark.parametrize(("given", "finding"), [("1.5", "other value"), ("0.98", "agrees")])
@pytest.mark.parametrize("quote", ["", '"'])
def test_a_default_of_a_declaration_is_compared(
    given: str, finding: str, quote: str, tmp_path: Path
) -> None:
    path = tmp_path / "declaration.yaml"
    path.write_text(f"line:\n  gain: {{type: double, default_value: {quote}{given}{quote}}}\n")
    rows = compare(ff.load(GOLDEN / "line.yaml"), read_consumer(path)).rows
    assert [r.finding for r in rows if r.parameter == "gain"] == [finding]


def test_every_number_of_an_export_is_compared(tmp_path: Path) -> None:
    """Each macro of a header made one per cent larger, lists number by number."""
    for family in ("line", "force-map", "potentiometer", "hydraulic-cylinder"):
        source = GOLDEN / f"{family}.yaml"
        path = export([source], "c", tmp_path / family, accept_not_identified=True)[0]
        text = path.read_text(encoding="ascii")
        block = ff.load(source, accept_not_identified=True)
        assert compare(block, read_consumer(path), source.name).agrees
        places = list(re.finditer(r"(?<![\w.])\d+\.\d+(?:e[-+]?\d+)?(?=f\b)", text))
        assert len(places) >= 3
        for m in places:
            if float(m[0]) == 0.0:
                continue
            changed = f"{text[: m.start()]}{float(m[0]) * 1.01!r}{text[m.end() :]}"
            path.write_text(changed, encoding="ascii")
            found = compare(block, read_consumer(path), source.name)
            assert [r.finding for r in found.rows if r.message] == ["other value"]


def test_an_export_of_another_file_is_found(tmp_path: Path) -> None:
    source = GOLDEN / "line.yaml"
    (header, *_) = export([source], "c", tmp_path)
    block, own = ff.load(source), hashlib.sha256(source.read_bytes()).hexdigest()
    assert hashes_in(header) == {own}
    keys = read_consumer(header)
    assert compare(block, keys, sha256=own, exported_from=hashes_in(header)).agrees
    other = compare(block, keys, sha256="0" * 64, exported_from=hashes_in(header))
    assert not other.agrees
    assert "exported from another file" in other.reasons[0]
    assert compare(block, keys, sha256="0" * 64).agrees
