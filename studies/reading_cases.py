# ruff: noqa: T201, E501 (it prints its table; a command is a line)
"""Logs, options and parameter files that were once misread: what the program says of each today.

    python studies/reading_cases.py [--write] [--only TEXT]

Every case is a command line as a user would type it, run by a shell in an empty folder beside the
datasets. What the program did before is what was seen when the case was found; a case whose exit
status is another, or that does not say what it should, makes the study fail. ``--write`` writes
``docs/evidence/reading-cases.md``.
"""

from __future__ import annotations

import argparse
import os
import re
import shlex
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "evidence" / "reading-cases.md"
_LONGEST = 30  # s of the processor, beyond which a command hangs: a fit and a check take two
_WAIT = 20.0 * _LONGEST  # s on the clock, beside other work
_EXPLAINED = """\
# Logs, options and files that were once misread

Written by `studies/reading_cases.py --write`, which runs every command below and fails where the
exit status or the message is another. `datasets` are those of this repository, `COLUMNS` the
options of the dataset's README that name its columns. What is cut of a message ends with `…`.

| case | before | now | it says |
|---|---|---|---|
"""


class Case(NamedTuple):
    """What was wrong, what came of it, a command, its exit status and what it has to say."""

    name: str
    before: str
    command: str
    status: int
    says: str


BARE = "--column time=#1 --column command=#2 --column outlet=#3 --unit time=s --unit command=V --unit outlet=bar"
LINE = '--column "inlet=p_valve (bar)" --column "outlet=p_chamber (bar)"'
CYLINDER = (
    '--column "command=u [V]" --column "pressure_1=p1 [bar]" --column "pressure_2=p2 [bar]" '
    '--column "position=y [mm]" --area-1 4.91e-4 --area-2 2.37e-4 --dead-volume-1 1.2446e-4 '
    "--dead-volume-2 9.906e-5 --supply-pressure 5e6"
)
FORCE = '--column "command=u [V]" --column "position=x [mm]" --column "force=F [N]"'
FIT_LINE = f"fluidact-fit line datasets/line/trial1.csv {LINE} -o line.yaml -q"


CHECK_LINE = f"fluidact-fit check line.yaml datasets/line/trial1.csv {LINE}"
CUT_VALVE = 'tail -n +2 datasets/valve/trial1.csv > n.csv; sed -i "45s/;[^;]*$//" n.csv'


def _changed(old: str, new: str) -> str:
    """A fit of a line whose parameter file is changed, and checked."""
    return f"{FIT_LINE}; sed -i -E {shlex.quote(f's~{old}~{new}~')} line.yaml; {CHECK_LINE}"


def _unit_of_pressure(header: str, before: str, status: int, says: str) -> Case:
    """A line whose first pressure has another header."""
    text = shlex.quote(f"1s~p_valve (bar)~{header}~")
    command = f"sed {text} datasets/line/trial1.csv > u.csv; fluidact-fit line u.csv"
    columns = "--column time=#1 --column inlet=#2 --column outlet=#3 -o u.yaml"
    return Case(f"header `{header}`", before, f"{command} {columns}", status, says)


ROWS = [
    Case(
        "no header, one damaged line", "fits 955 of 1000 rows, PASS, no warning",
        f'{CUT_VALVE}; fluidact-fit valve n.csv {BARE} -o n.yaml',
        0, r"1 line with the wrong number of fields left out \(line 45",
    ),
    Case(
        "the same with `--strict`", "the same",
        f'{CUT_VALVE}; fluidact-fit valve n.csv {BARE} --strict -o n.yaml',
        4, r"partial-lines: .*line 45",
    ),
    Case(
        "50 rows, then the logger restarts", "49 rows lost",
        "(head -n 51 datasets/line/trial1.csv; tail -n +2 datasets/line/trial2.csv) > r.csv; fluidact-fit inspect r.csv",
        0, r"1051 lines: 1 above the data, 1050 data",
    ),
    Case(
        "line 12 of a log with a header is cut", "header lost, line 12 not named",
        "sed '12s/,[^,]*$//' datasets/line/trial1.csv > h.csv; fluidact-fit inspect h.csv",
        0, r"line 12 left out: 2 fields",
    ),
    Case(
        "`1.012` in a large log with decimal commas", "read as 1.012",
        "(echo 'time;x'; seq 0 30000 | sed 's/.*/&,5;2,25/'; echo '30001,5;1.012') > d.csv; fluidact-fit inspect d.csv",
        0, r"always 2.25; 1 invalid cell$",
    ),
    Case(
        "the same in a small one", "refused, not a finite number",
        "(echo 'time;x'; seq 0 300 | sed 's/.*/&,5;2,25/'; echo '301,5;1.012') > d.csv; fluidact-fit inspect d.csv",
        0, r"always 2.25; 1 invalid cell$",
    ),
    Case(
        "the same, fitted", "refused in a small log only",
        "(echo 'time;force;position'; seq 0 300 | sed 's/.*/&,5;2,25;3,&/'; echo '301,5;1.012;3,5') > d.csv; fluidact-fit hydrostatic d.csv -o p.yaml",
        3, r"'1.012', which is not a finite number",
    ),
    Case(
        "`3,502` that means thousands", "read as 3.502, PASS",
        "(echo 'time;x'; seq 100 400 | sed 's/.*/&;3,&/') > d.csv; fluidact-fit inspect d.csv",
        3, r"may be 3\.\d+ or 3\d+",
    ),
    Case(
        "`4.000` that means thousands", "read as 4.0, PASS",
        "(echo 'time;x'; seq 100 400 | sed 's/.*/&;4.&/') > d.csv; fluidact-fit inspect d.csv",
        3, r"may be 4\.\d+ or 4\d+",
    ),
    Case(
        "`4 004` between tabs", "columns shifted",
        r"(printf 'time\tx\n'; seq 100 400 | sed 's/.*/&\t4 &/') > d.tsv; fluidact-fit inspect d.tsv",
        3, r"holds a blank: it may be 4\d+, or two numbers",
    ),
    Case(
        "the same beside numbers with decimals", "columns shifted",
        r"(printf 'time\tforce\tposition\n'; seq 100 400 | sed 's/.*/0.&\t4 &\t0.&1/') > d.tsv; fluidact-fit hydrostatic d.tsv -o p.yaml",
        3, r"If ' ' stands between thousands, give --thousands ' '",
    ),
]  # fmt: skip
UNITS = [
    Case(
        "header `pressureMPa`", "SI, 10⁶ times wrong",
        'sed "1s~p_valve (bar)~pressureMPa~" datasets/line/trial1.csv > u.csv; fluidact-fit line u.csv --column time=#1 --column inlet=#2 --column outlet=#3 -o u.yaml',
        3, r"may be in 'MPa', which appears in the middle of its name",
    ),
    Case(
        "names between semicolons, rows between commas", "names and units gone, SI",
        'sed "1s~,~;~g" datasets/line/trial1.csv > u.csv; fluidact-fit inspect u.csv',
        3, r"units stand above the first row",
    ),
    Case(
        "Chinese headers in GBK", "SI, 1000 times wrong",
        "(printf '时间(毫秒),压力(兆帕)\\n' | iconv -t GBK; seq 0 40 | sed 's/.*/&,0.&/') > u.csv; fluidact-fit inspect u.csv",
        0, r"unit 毫秒",
    ),
    Case(
        "a column of decimals with commas, without a name", "two columns",
        "seq 10 60 | sed 's/.*/1,0&/' > u.csv; fluidact-fit inspect u.csv",
        3, r"may be one column or two",
    ),
    Case(
        "channels one below the other, named in a column", "one table of runs",
        "(echo 'VarName;t;x'; seq 0 20 | sed 's/.*/p1;&;&,5/'; seq 0 20 | sed 's/.*/p2;&;&,7/') > u.csv; fluidact-fit inspect u.csv",
        3, r"'p1', 'p2'\) that stand one below the other",
    ),
    *(_unit_of_pressure(*case) for case in (
        ("p_valve (mpa)", "SI, 10⁶ times wrong", 3, r"'mpa' is not known in this case: 'MPa'"),
        ("p_valve_mpa", "SI", 3, r"'mpa' is not known in this case: 'MPa'"),
        ("p_valve (psf)", "SI, 48 times wrong", 0, "written to"),
        ("p_valve (kgf/cm2)", "read", 0, "written to"),
        ("p_valve (bar(g))", "SI, 10⁵ times wrong", 0, "written to"),
        ("p_valve bar(a)", "SI, or a mass", 0, "written to"),
        ("p_valve [bar] (psi)", "SI", 3, "'bar or psi'"),
        ("p_valve [bar] filtered", "SI, 10⁵ times wrong", 0, "written to"),
        ("p_valve in 1/100 bar", "bar, 100 times wrong", 0, "written to"),
        ("p_valve / 0.01bar", "SI", 0, "written to"),
        ("p_valve (400 bar)", "SI, 10⁵ times wrong", 3, "steps of 400 bar, or in bar where 400 is a range"),
        ("p_valve (0-10 V)", "SI", 3, "not written as a unit"),
        ("p_valve（兆帕）", "SI, 10⁶ times wrong", 0, "written to"),
        ("p_valve (lb)", "SI", 3, "'lb' is a mass"),
        ("p_valve (valve side)", "SI assumed, and it is said", 0, r"'\(valve side\)' is no unit"),
    )),
    Case(
        "an angle in `[Grad]`, German for degrees and a gon", "10⁹ rad, PASS",
        "sed '1s/deg/Grad/' datasets/ball-screw/trial1.csv > g.csv; fluidact-fit ball-screw g.csv -o g.yaml",
        3, r"degrees \('deg'\) or gon",
    ),
    Case(
        "a position in `(millimeter)`", "m, PASS, 1000 times wrong",
        "sed '1s/mm/millimeter/' datasets/potentiometer/trial1.csv > g.csv; fluidact-fit potentiometer g.csv --column reading=#1 --column reference=#2 -o g.yaml -v",
        0, r"PASS",
    ),
    Case(
        "unit `9^9^9` in a header", "hangs",
        "sed '1s/(bar)/(9^9^9)/' datasets/line/trial1.csv > u.csv; fluidact-fit line u.csv --column 'inlet=p_valve (9^9^9)' --column outlet=#3 -o u.yaml",
        0, r"in which '\(9\^9\^9\)' is no unit that is known",
    ),
    Case(
        "unit `9^9^9^9` in a parameter file", "hangs, `ff.load` too",
        _changed("unit: s,", "unit: 9^9^9^9,"), 3, r"not a known unit|not written as a unit",
    ),
    Case(
        "`--column time=ms` on a header `ms`", "reads seconds, WARN",
        f"sed '1s/t (ms)/ms/' datasets/line/trial1.csv > u.csv; fluidact-fit line u.csv --column time=ms {LINE} -o u.yaml",
        0, r"time_constant +(119\.\d+ .* ms|0\.119\d+ .* s) ",
    ),
    Case(
        "header in bar, `--unit inlet=psi`", "passes without a word",
        f"fluidact-fit line datasets/line/trial1.csv {LINE} --unit inlet=psi -o u.yaml",
        0, r"psi",
    ),
    Case(
        "a row of units below the header", "a column in V became newtons",
        "(echo 't,u,p'; echo 's,V,bar'; tail -n +2 datasets/line/trial1.csv) > u.csv; fluidact-fit inspect u.csv",
        0, r"#2 +u +\[V\]",
    ),
    Case(
        "a row `ms,rpm,...` below the header", "not read",
        "(echo 't,n,p'; echo 'ms,rpm,bar'; tail -n +2 datasets/line/trial1.csv) > u.csv; fluidact-fit inspect u.csv",
        0, r"#2 +n +\[rpm\]",
    ),
    Case(
        "torque in `% of 9.84 mN m`", "unknown unit",
        "(echo 'Time [ms];Velocity [rpm];Torque [%]'; awk 'BEGIN {srand(1); for (k = 0; k < 4000; k++) {v = 3000 * sin(k / 300); print k \";\" v \";\" 10 * (v > 0 ? 1 : -1) + v / 300 + rand() - 0.5}}') > u.csv; fluidact-fit cylinder-friction u.csv --column 'torque=Torque [%]' --unit 'torque=% of 9.84 mN m' --column 'angular_velocity=Velocity [rpm]' -o u.yaml",
        0, r"coulomb_positive +983",
    ),
    Case(
        "`barg`, `bara`, `psig`, `gpm`, `NL/min`", "unknown",
        "(echo 't (s),a (barg),b (bara),c (psig),d (gpm),e (NL/min),f (l/min)'; seq 0 99 | sed 's/.*/0.0&1,1.5,2.5,3.5,4.5,5.5,6.5/' | sort -n) > u.csv; fluidact-fit inspect u.csv",
        0, r"#6 +e +\[NL/min\]",
    ),
    Case(
        "a line whose pressures are volts", "refused",
        "sed '1s/bar/V/g' datasets/line/trial1.csv > u.csv; fluidact-fit line u.csv --column 'inlet=p_valve (V)' --column 'outlet=p_chamber (V)' -o u.yaml",
        0, r"time_constant",
    ),
]  # fmt: skip
SOURCES = [
    Case(
        "a DataFrame", '"there is no such file"',
        "python -c 'import pandas as pd, fluidact_fit as ff; df = pd.read_csv(\"datasets/line/trial1.csv\"); print(ff.fit(\"line\", df, columns={\"inlet\": \"p_valve (bar)\", \"outlet\": \"p_chamber (bar)\"}).summary())'",
        0, r"time_constant",
    ),
    Case(
        "Parquet", "cannot be fitted",
        f"python -c 'import pandas as pd; pd.read_csv(\"datasets/line/trial1.csv\").to_parquet(\"t.parquet\")'; fluidact-fit line t.parquet {LINE} -o p.yaml",
        0, r"time_constant",
    ),
    Case(
        "a `.mat` file", "cannot be fitted",
        "python -c 'import pandas as pd; from scipy.io import savemat; t = pd.read_csv(\"datasets/line/trial1.csv\").to_numpy(float); savemat(\"t.mat\", dict(zip(\"tuy\", t.T)))'; fluidact-fit line t.mat --column time=t --unit time=ms --column inlet=u --column outlet=y --unit inlet=bar --unit outlet=bar -o p.yaml",
        0, r"time_constant",
    ),
    Case(
        "a pipe", "cannot be fitted",
        f"cat datasets/line/trial1.csv | fluidact-fit line - {LINE} -o p.yaml", 0, r"time_constant",
    ),
    Case(
        "dSPACE ControlDesk", "not understood",
        "(echo 'descriptions,Measurement,Name,Recording'; echo trace_size,1000; echo trace_names,,In1,In1; echo trace_units,,bar,bar; echo 'path,,Model Root/Valve/In1,Model Root/Line/In1'; echo flags,,1,1; echo min,,0,0; tail -n +2 datasets/line/trial1.csv | sed 's/,/e-3,/;s/^/,/;1s/^/trace_values/') > c.csv; fluidact-fit inspect c.csv",
        0, r"ControlDesk",
    ),
    Case(
        "leave out a run", "missing",
        f"(cat datasets/line/trial1.csv; tail -n +2 datasets/line/trial2.csv) > r.csv; fluidact-fit line r.csv {LINE} --exclude 2 -o p.yaml",
        0, r"1000 samples",
    ),
    Case(
        "leave out a stretch", "missing",
        f"fluidact-fit line datasets/line/trial1.csv {LINE} --exclude time=3:3.5 -o p.yaml",
        0, r"9\d\d samples",
    ),
]  # fmt: skip
FILES = [
    Case(
        "validity up to 1e308", "`inf.0f` in the C of its export",
        _changed("(inlet: .*high: )[0-9.e+]+", r"\11.0e+308"), 3, r"nothing in SI is above",
    ),
    Case(
        "50,000 %TAG directives before a file", "hangs",
        f"{FIT_LINE}; (seq 50000 | sed 's/.*/%TAG !t&! tag:a.org,2000:&/'; echo ---; cat line.yaml) > t.yaml; fluidact-fit report t.yaml",
        3, r"has a directive",
    ),
    Case(
        "rows of 4,000 semicolons behind a quote", "minutes",
        "python -c 'print((chr(34) + chr(59) * 4000 + chr(10)) * 60)' > q.csv; fluidact-fit inspect q.csv",
        3, r"no table of numbers",
    ),
    Case(
        "a file of logs at constants of their own, with one of them", "no longer fits, preload moved",
        "for x in 0 20 40; do awk -F, -v x=$x 'NR>1 {p=2e5-1.5e5*cos(NR/50); print NR/50 \",\" p \",\" 2e-4*p-0.5*x-3-(sin(NR/50)>0?2:-2)+0.1*sin(7.3*NR*NR)}' datasets/line/trial1.csv | (echo 'time,pressure,force'; head -900) > at$x.csv; done; fluidact-fit spring-cylinder at0.csv at20.csv at40.csv --set 'at0*:position=0 mm' --set 'at20*:position=20 mm' --set 'at40*:position=40 mm' -q -o s.yaml; fluidact-fit check s.yaml at40.csv",
        0, r"the model still fits",
    ),
    Case(
        "`validity.X.high: [5.0]`", "exit 1",
        _changed("(inlet: .*high: )[0-9.e+]+", r"\1[5.0]"), 3, r"validity",
    ),
    Case(
        "an unknown option", "loads",
        _changed("^options:", "options:\\n  colour: blue"), 3, r"colour",
    ),
    Case(
        "a gain in kg", "loads",
        _changed("(gain: .value: [^,]*, unit: )[^,]*,", r"\1kg,"), 3, r"kg",
    ),
    Case(
        "a negative rmse", "loads",
        _changed("rmse: .value: ", "rmse: {value: -"), 3, r"rmse",
    ),
    Case(
        "a `model` that is not of the parameters", "loads",
        _changed("(dead_time: )0[.][0-9]+([^,]*}$)", r"\10.5\2"), 3, r"model",
    ),
    Case(
        "a force map with one `input_offset`", "loads, and gives −370 V instead of 1.9 V",
        f"fluidact-fit force-map datasets/force-map/trial1.csv {FORCE} -o map.yaml -q; sed -i -E 's~(input_offset.*value: .)([^],]+),[^]]*~\\1\\2~' map.yaml; fluidact-fit check map.yaml datasets/force-map/trial1.csv {FORCE}",
        3, r"input_offset",
    ),
    Case(
        "200,000 unknown keys", "over 20 s",
        f"{FIT_LINE}; seq 1 200000 | sed 's/.*/key&: 1/' >> line.yaml; {CHECK_LINE}", 3, r"line.yaml",
    ),
    Case(
        "a text where options stand", "exit 1",
        _changed("^options:", "options: text\\nmore:"), 3, r"options",
    ),
    Case(
        "`sample_time: -1`", "exit 1 or loads",
        _changed("sample_time: [0-9.]+", "sample_time: -1"), 3, r"sample_time",
    ),
    Case(
        "a covariance of 1000 x 1000 texts", "over 20 s",
        f"{FIT_LINE}; sed -i '/^    - .[0-9]/d' line.yaml; python -c 'print(\"\\n\".join([\"    - [\" + \", \".join([\"x\"] * 1000) + \"]\"] * 1000))' > m; sed -i '/^  matrix:/r m' line.yaml; {CHECK_LINE}", 3, r"covariance|problem",
    ),
    Case(
        "a reversed `reading_range`", "loads",
        "fluidact-fit potentiometer datasets/potentiometer/trial1.csv --column reading=ADC --column 'reference=laser (mm)' -o p.yaml -q; sed -i -E 's~(reading_range: .*)\\[([0-9.]+), ([0-9.]+)\\]~\\1[\\3, \\2]~' p.yaml; fluidact-fit check p.yaml datasets/potentiometer/trial2.csv --column reading=ADC --column 'reference=laser (mm)'",
        3, r"reading_range",
    ),
    Case(
        "a million NaN", "65 MB of message",
        f"{FIT_LINE}; (echo 'more:'; yes -- '- .nan' | head -n 1000000) >> line.yaml; {CHECK_LINE}", 3, r"line.yaml",
    ),
]  # fmt: skip
ENDS = [
    Case(
        "`hydraulic-cylinder` on 120 rows", "exit 1, ValueError",
        f"head -n 121 datasets/hydraulic-cylinder/trial1.csv > s.csv; fluidact-fit hydraulic-cylinder s.csv {CYLINDER} --mass 14.54 -o p.yaml",
        0, r"not-identified",
    ),
    Case(
        "`--flow mlp` on thinned rows", "exit 1",
        f"awk 'NR == 1 || NR % 40 == 0' datasets/hydraulic-cylinder/trial1.csv > s.csv; fluidact-fit hydraulic-cylinder s.csv {CYLINDER} --mass 14.54 --flow mlp -o p.yaml",
        4, r"too slowly",
    ),
    Case("`--column inlet=#²`", "exit 1", "fluidact-fit line datasets/line/trial1.csv --column inlet=#² -o p.yaml", 3, r"no column '#²'"),
    Case("`--scale time=1e-320`", "exit 1", f"fluidact-fit line datasets/line/trial1.csv {LINE} --scale time=1e-320 -o p.yaml", 2, r"too small"),
    Case("`--controller-sample-time 1e308`", "exit 1", f"fluidact-fit line datasets/line/trial1.csv {LINE} --controller-sample-time 1e308 -o p.yaml", 2, r"controller-sample-time"),
    Case("`--mass 1e300`", 'blames "the document"', f"fluidact-fit hydraulic-cylinder datasets/hydraulic-cylinder/trial1.csv {CYLINDER} --mass 1e300 -o p.yaml", 2, r"mass"),
    Case("`--sound-speed 0`", "becomes the default", f"fluidact-fit line datasets/line/trial1.csv {LINE} --length 5 --sound-speed 0 -o p.yaml", 2, r"sound-speed"),
    Case("`-o nodir/`", "writes a file", f"fluidact-fit line datasets/line/trial1.csv {LINE} -o nodir/", 2, r"nodir/ names a directory"),
    Case(
        "`MPLBACKEND=nonsense`", "exit 1",
        f"MPLBACKEND=nonsense fluidact-fit line datasets/line/trial1.csv {LINE} -o p.yaml --plot p.png; ls p.png", 0, r"^p.png",
    ),
    Case(
        "standard output closed", 'the file is written, then "Nothing was written", exit 1',
        f"fluidact-fit line datasets/line/trial1.csv {LINE} -o p.yaml >&-; echo status $?; ls p.yaml", 0, r"status (0|141)",
    ),
    Case(
        "standard error closed", "exit 1 in silence",
        f"fluidact-fit line datasets/line/trial1.csv {LINE} -o p.yaml 2>&-", 0, r"written to p.yaml|time_constant",
    ),
    Case(
        "an interrupt during the imports", "8 tracebacks of 60",
        "for k in 1 2 3 4 5 6; do timeout -s INT 0.${k}5 fluidact-fit demo d 2>&1; done | grep -c Traceback; true", 0, r"^0$",
    ),
    Case(
        "escape sequences in a header", "reach the terminal",
        r"sed '1s/p_valve/\x1b[2Jp_valve/' datasets/line/trial1.csv > e.csv; fluidact-fit inspect e.csv | grep -c $'\x1b'; true", 0, r"^0$",
    ),
    Case(
        "two runs with one new `-o`", "both succeed",
        f"for k in 1 2; do (fluidact-fit line datasets/line/trial$k.csv {LINE} -o same.yaml -q; echo status $?) & done; wait", 0, r"status [1-9]",
    ),
]  # fmt: skip


def _table(times: str, options: str = "", head: str = "time") -> str:
    """A log of 200 rows whose instants awk prints, inspected; ``t`` is the row."""
    return (
        f"(echo '{head},p'; seq 0 199 | awk '{{t=$1; printf \"{times}; printf \",%d.5\\n\", t%7}}') "
        f"> t.csv; fluidact-fit inspect t.csv {options}"
    )


_HMS = "%02d:%02d:%02d"
_SPLIT = "seq 0 199 | awk '{n=873456789+$1*10000000; printf \"%d,%d,%d.5\\n\", 1717171717+int(n/1e9), n%1e9, 3*$1%7}'"
_ANGLE = (
    "(echo 'time [s],angle [deg],torque [N m]'; seq 0 2999 | awk '{k=int($1/500); v=(k%2?-1:1)*(170+170*int(k/2)); "
    "if ($1%500<20) {v*=($1%500)/20}; a+=v/100; w=a-360*int(a/360); if (w<0) w+=360; "
    'printf "%.2f,%.5f,%.6f\\n", $1/100, WHAT, (v>0)*0.05-(v<0)*0.05+2e-5*v+1e-4*(($1*7919)%13-6)}\') > a.csv'
)
_FRICTION = "fluidact-fit cylinder-friction a.csv --offset=none -o f.yaml"
_HOLES = "awk -F, -v OFS=, 'NR>1 && NR%25==0 {$2=\"\"} 1' datasets/line/trial1.csv > n.csv"
TIMES = [
    Case(
        "`0:00:58:21`, days before the hours", "hours, 1 s read as 10 ms",
        _table(f'0:{_HMS}\", (3500+t)/3600, (3500+t)/60%60, (3500+t)%60'),
        0, r"0 to 199 s, every 1 s",
    ),
    Case(
        "IRIG `123:11:56:40`", "the same",
        _table(f'123:{_HMS}\", 11, 56+t/60, t%60'), 0, r"0 to 199 s, every 1 s",
    ),
    Case(
        "`0:00:07:00`, every minute, may be hours, minutes and seconds", "every 1 s",
        _table(f'0:{_HMS}\", t/60, t%60, 0'), 0, r"may be days, hours, minutes and seconds, or",
    ),
    Case(
        "frames of a video, 25 a second", "hundredths of a second",
        _table(f'{_HMS}:%02d\", 1, 0, t/25, t%25'), 0, r"end with frames, 25 to a second",
    ),
    Case(
        "`12:00:01:5` of `%d:%d:%d:%d`, in ms", "half a second",
        _table('12:0:%d:%d\", t/20, t%20*50'), 0, r"0 to 9.95 s, every 0.05 s",
    ),
    Case(
        "digits `115659` of a clock", "skips of 41 s",
        _table('%02d%02d%02d\", 11, 56+t/60, t%60'), 0, r"as the digits of a clock \(HHMMSS\) do",
    ),
    Case(
        "a clock in summer and in winter time by name", "not read",
        _table(f'2024-10-27 {_HMS} %s\", 2, 50+t/60, t%60, t<99 ? \"CEST\" : \"CET\"'),
        0, r"name several zones \(CEST, CET\)",
    ),
    Case(
        "`header.stamp.secs` and `nsecs`", "advice `--column time=#2`, 9 runs",
        f"(echo 'header.stamp.secs,header.stamp.nsecs,p'; {_SPLIT}) > t.csv; fluidact-fit inspect t.csv",
        0, r"column #1, unit s: 1 run\(s\), 0 to 1.99 s, every 0.01 s",
    ),
    Case(
        "the same without a header", "the same advice",
        f"({_SPLIT}) > t.csv; fluidact-fit line t.csv --column inlet=#3 --column outlet=#3 --column time=#2 -o l.yaml",
        3, r"column '#2' starts again wherever column '#1' goes up by one",
    ),
    Case(
        "`inspect` of nanoseconds since 1970", "shown as seconds",
        _table('1717171717%09d\", t*5000000', head="__time"), 0, r"unit ns \(assumed\).* every 0.005 s",
    ),
    Case(
        "FILETIME, 100 ns since 1601", "seconds",
        _table('1336164531712%05d\", t*100'), 0, r"unit 100 ns \(assumed\)",
    ),
    Case(
        "a counter of 16 bits overflows", "two runs",
        _table('%d\", (65000+t*10)%65536', head="time [ms]"), 0, r"overflowed \(2\^16\) and was continued",
    ),
    Case(
        "`micros() / 1e6` overflows", "two runs",
        _table('%.6f\", (4294.9+t/1000)%4294.967296', head="time [s]"),
        0, r"overflowed \(4294.967296\) and was continued",
    ),
    Case(
        "cycles of 100 rows start again", "runs, as they should be",
        _table('%d\", t%100', head="time [ms]"), 0, r"2 run\(s\)",
    ),
    Case(
        "an angle that begins again after 360 degrees", "half the samples vanish",
        f"{_ANGLE.replace('WHAT', 'w')}; {_FRICTION}",
        0, r"begins again after 360 deg in \d+ places .* and was continued",
    ),
    Case(
        "the same by its unit of radians", "a friction of another machine",
        f"{_ANGLE.replace('WHAT', 'w')}; sed -i '1s/deg/rad/' a.csv; {_FRICTION}",
        3, r"seems to begin again after about 360 rad",
    ),
    Case(
        "the same with `--unwrap angle=none`", "no such option",
        f"{_ANGLE.replace('WHAT', 'a')}; {_FRICTION} --unwrap angle=none",
        0, r"coulomb_positive +49\.9",
    ),
    Case(
        "cells without a number in 40 rows", "wants 40 `--exclude`",
        f"{_HOLES}; fluidact-fit line n.csv {LINE} -o n.yaml", 3, r"--invalid=drop to leave such rows out",
    ),
    Case(
        "the same with `--invalid drop`", "no such option",
        f"{_HOLES}; fluidact-fit line n.csv {LINE} -o n.yaml --invalid drop",
        0, r"rows with a missing or non-numeric cell left out",
    ),
]  # fmt: skip


def _made(script: str, file: str, then: str = "") -> str:
    """A recording that a few lines of Python make, and what is asked of it."""
    head = "import numpy as np; t = 0.01 * np.arange(200); "
    return f"python -c {shlex.quote(head + script)} && fluidact-fit {then or 'inspect'} {file}"


_MDF = "import asammdf as a; f = a.MDF(); S = a.Signal; "
_TDMS = "import nptdms as n; from nptdms import ChannelObject as C; w = {'wf_increment': 0.01}; at = lambda s: {**w, 'wf_start_time': np.datetime64('2024-05-31T12:00:00', 'us') + np.timedelta64(round(1e6 * s), 'us')}; "
_TDMS_END = "; o = n.TdmsWriter('r.tdms'); o.open(); o.write_segment(c); o.close()"
_HDF5 = "import h5py; f = h5py.File('r.h5', 'w'); f['t'] = t; "
_MAT = "from scipy.io import savemat; from scipy import sparse; "
RECORDINGS = [
    Case(
        "MDF samples that are marked invalid", "1e6 read as data",
        _made(_MDF + "b = np.arange(200) < 10; f.append([S(np.where(b, 1e6, t), t, name='x', invalidation_bits=b)]); f.save('r.mf4')", "r.mf4"),
        0, r"0.1 to 1.99.*; 10 invalid cells",
    ),
    Case(
        "an MDF file with one damaged bit", "the process is killed (139)",
        _made(_MDF + "f.append([S(t, t, name='x')]); f.save('r.mf4'); b = bytearray(open('r.mf4', 'rb').read()); b[88] ^= 255; b[89] ^= 255; open('r.mf4', 'wb').write(b)", "r.mf4"),
        3, r"cannot be read|damaged|no vectors",
    ),
    Case(
        "an MDF file that is cut", "a traceback behind the message",
        _made(_MDF + "f.append([S(t, t, name='x')]); f.save('r.mf4'); b = open('r.mf4', 'rb').read(); open('r.mf4', 'wb').write(b[:900])", "r.mf4"),
        3, r"cannot be read",
    ),
    Case(
        "TDMS channels that begin 5 s apart", "laid side by side",
        _made(_TDMS + "c = [C('a', 'x', t, at(0)), C('b', 'y', t, at(5))]" + _TDMS_END, "r.tdms"),
        0, r"400 rows",
    ),
    Case(
        "TDMS instants in a channel", "dropped",
        _made(_TDMS + "c = [C('a', 'Stamp', np.datetime64('2024-05-31T12:00:00', 'us') + (1e6 * t).astype('m8[us]')), C('a', 'y', t)]" + _TDMS_END, "r.tdms"),
        0, r"time in column #1, unit s.* every 0.01 s",
    ),
    Case(
        "a TDMS file that is cut", "half of it read without a word",
        _made(_TDMS + "c = [C('a', 'x', t, at(0)), C('a', 'y', t, at(0))]" + _TDMS_END + "; b = open('r.tdms', 'rb').read(); open('r.tdms', 'wb').write(b[:-900])", "r.tdms"),
        0, r"recording-cut",
    ),
    Case(
        "`scale_factor`, `add_offset`, `_FillValue`, `units` in HDF5", "ignored",
        _made(_HDF5 + "d = f.create_dataset('p', data=np.arange(-1, 199, dtype='i2')); d.attrs.update(scale_factor=0.01, add_offset=5.0, _FillValue=np.int16(-1), units='bar')", "r.h5"),
        0, r"5 to 6.98 bar.*; 1 invalid cell$",
    ),
    Case(
        "an HDF5 dataset in another file", "any file of the machine is read",
        _made(_HDF5 + "f.create_dataset('x', (200,), 'u1', external=[('/etc/passwd', 0, 200)])", "r.h5"),
        3, r"'x' lies in another file",
    ),
    Case(
        "a virtual HDF5 dataset of itself", "never returns",
        _made(_HDF5 + "v = h5py.VirtualLayout((200,), 'f8'); v[:] = h5py.VirtualSource('.', 'x', (200,))[:]; f.create_virtual_dataset('x', v)", "r.h5"),
        3, r"'x' is put together of other datasets",
    ),
    Case(
        "an HDF5 link to another file", "followed",
        _made(_HDF5 + "f['x'] = h5py.ExternalLink('/etc/x.h5', 'x')", "r.h5"),
        3, r"'x' stands in another file",
    ),
    Case(
        "complex numbers, cells and objects in a `.mat` file", "dropped without a word",
        _made(_MAT + "savemat('r.mat', {'t': t, 'z': t + 1j, 'cube': np.ones((200, 2, 3)), 'wide': np.ones((200, 5000))})", "r.mat"),
        0, r"variables-left-out.*cube \(an array of 3 axes.*wide \(a table of 5000 columns.*|variables-left-out.*z \(complex",
    ),
    Case(
        "a Simulink structure with two signals", "the time alone",
        _made(_MAT + "savemat('r.mat', {'simout': {'time': t, 'signals': [{'values': t, 'label': 'Force'}, {'values': t, 'label': 'Pos'}]}})", "r.mat"),
        0, r"#3 +Pos",
    ),
    Case(
        "two structures with times of their own", "one table",
        _made(_MAT + "savemat('r.mat', {'a': {'time': t, 'x': t}, 'b': {'time': t + 0.005, 'x': t}})", "r.mat"),
        0, r"400 rows, 3 columns",
    ),
    Case(
        "4 samples of 6 channels", "6 samples of 4 channels",
        _made(_MAT + "savemat('r.mat', {'data': np.arange(24.0).reshape(4, 6)})", "r.mat"),
        0, r"4 rows, 6 columns",
    ),
    Case(
        "a MATLAB 4 file", '"a binary file"',
        _made(_MAT + "savemat('r.mat', {'t': t, 'x': t**2}, format='4')", "r.mat"), 0, r"#2 +x",
    ),
    Case(
        "a Parquet footer that states four times the rows", "memory is read as data",
        _made("import pyarrow as pa; from pyarrow import parquet as p; p.write_table(pa.table({'x': np.random.rand(1000)}), 'r.parquet', write_statistics=False); b = open('r.parquet', 'rb').read(); n = 8 + int.from_bytes(b[-8:-4], 'little'); open('r.parquet', 'wb').write(b[:-n] + b[-n:].replace(bytes([208, 15]), bytes([192, 62])))", "r.parquet"),
        3, r"says that it has 4000 rows",
    ),
    Case(
        "29 kB of bzip2 that hold gigabytes", "6 GB and 93 s",
        _made("import bz2; open('r.csv.bz2', 'wb').write(bz2.compress(b'0.5;0.25\\n' * 100_000) * 400)", "r.csv.bz2"),
        3, r"the archive holds more than 67 MB",
    ),
    Case(
        "a small `.gz` where memory is short", "4 GB asked for",
        f"gzip -c datasets/line/trial1.csv > r.csv.gz; ulimit -v 1500000; fluidact-fit line r.csv.gz {LINE} -o r.yaml",
        0, r"time_constant",
    ),
]  # fmt: skip
STRUCTURE = [
    Case(
        "a last column that is empty in every row", "names and units gone, ms become s",
        f"sed 's/$/,/; 1s/$/comment/' datasets/line/trial1.csv > e.csv; fluidact-fit line e.csv {LINE} -o e.yaml",
        0, r"time_constant +(119\.\d+ .* ms|0\.119\d+ .* s) ",
    ),
    Case(
        "a header with a name too many", "names and units gone",
        "sed '1s/$/,comment/' datasets/line/trial1.csv > e.csv; fluidact-fit inspect e.csv",
        3, r"4 names above rows of 3 cells",
    ),
    Case(
        "units beside names below other names", "time 1000 times too slow",
        "(echo 'Time,Analog 1,Analog 2'; echo 'ms,Feed pressure,Outlet pressure'; tail -n +2 datasets/line/trial1.csv) > m.csv; fluidact-fit line m.csv --column 'inlet=Feed pressure' --unit inlet=bar --column 'outlet=Analog 2' --unit outlet=bar -o m.yaml",
        0, r"time_constant +(119\.\d+ .* ms|0\.119\d+ .* s) ",
    ),
    Case(
        "rows of statistics below the table", "fitted as samples",
        "(cat datasets/line/trial1.csv; echo 'Mean,459.9,30.002'; echo 'Std,275.7,18.054'; echo 'Min,42,-0.009'; echo 'Max,939,60.037') > s.csv; fluidact-fit inspect s.csv",
        0, r"4 rows with statistics of the others left out",
    ),
    Case(
        "the same in German, behind an empty line", "fitted as samples",
        "(cat datasets/valve/trial1.csv; echo; echo 'Mittelwert;0,5;1,5'; echo 'Standardabweichung;0,1;0,2') > s.csv; fluidact-fit inspect s.csv",
        0, r"line 100\d left out: statistics",
    ),
    Case(
        "a first row of words for no value that are units", "taken for units, not named",
        "sed '2s/.*/0,N,A/; 1s/ ([a-z]*)//g' datasets/line/trial1.csv > w.csv; fluidact-fit inspect w.csv",
        0, r"1001 lines: 1 above the data, 1000 data",
    ),
    Case(
        "`***` in the first row", "taken for the header",
        "sed '2s/.*/***,***,***/' datasets/line/trial1.csv > w.csv; fluidact-fit inspect w.csv",
        0, r"#2 +p_valve",
    ),
    Case(
        "a CODESYS trace: one channel below the other", "one table of runs",
        "(echo '[key]; [value]'; echo 'Name; Trace'; for k in 2 3; do echo \"$((k-2)).Variable; GVL.c$k\"; echo \"$((k-2)).Data; \"; tail -n +2 datasets/line/trial1.csv | cut -d, -f1,$k | sed 's/,/; /; s/^/; /'; done) > t.trace.csv; fluidact-fit line t.trace.csv --column inlet=GVL.c2 --unit inlet=bar --column outlet=GVL.c3 --unit outlet=bar -o t.yaml",
        0, r"time_constant +(119\.\d+ .* ms|0\.119\d+ .* s) ",
    ),
    Case(
        "`Channel 2` where `Channel 1` stood above the first block", "one table of runs",
        "(echo 'Channel 1'; cat datasets/line/trial1.csv; echo 'Channel 2'; cat datasets/line/trial2.csv) > t.csv; fluidact-fit inspect t.csv",
        3, r"a second block begins here: 'Channel 2'; above the first one it is 'Channel 1'\.",
    ),
    Case(
        "a small table of another width below the first", "left out as partly written lines",
        "(cat datasets/line/trial1.csv; echo; echo f,amplitude; seq 1 9 | sed 's/$/,2/') > t.csv; fluidact-fit inspect t.csv",
        3, r"the columns change: 2 columns from here on, 3 above",
    ),
    Case(
        "LabChart text", "no names, no units",
        "(printf 'Interval=\\t0.01 s\\nTimeFormat=\\tStartOfBlock\\nDateFormat=\\t\\nChannelTitle=\\tFeed\\tEnd\\nRange=\\t10.000 bar\\t10.000 bar\\n'; tail -n +2 datasets/line/trial1.csv | awk -F, '{print $1 / 1000 \"\\t\" $2 \"\\t\" $3}') > l.txt; fluidact-fit line l.txt --column inlet=Feed --column outlet=End -o l.yaml",
        0, r"time_constant +(119\.\d+ .* ms|0\.119\d+ .* s) ",
    ),
    Case(
        "nanoseconds since 1970, a microsecond apart", "every 768 or 1024 ns",
        "(echo t,p; seq 0 400 | awk '{printf \"1700000000123%06d,%d\\n\", 1000 * $1, $1 % 7}') > n.csv; fluidact-fit inspect n.csv",
        0, r"every 1e-06 s",
    ),
    Case(
        "two levels of names, as pandas writes them", "the upper one lost",
        "python -c 'import pandas as pd; d = pd.read_csv(\"datasets/line/trial1.csv\").set_index(\"t (ms)\"); d.columns = pd.MultiIndex.from_tuples([(\"valve\", \"p (bar)\"), (\"chamber\", \"p (bar)\")]); d.to_csv(\"m.csv\")'; fluidact-fit line m.csv --column 'inlet=valve p' --column 'outlet=chamber p' -o m.yaml",
        0, r"time_constant +(119\.\d+ .* ms|0\.119\d+ .* s) ",
    ),
    Case(
        "JSON, one record per line", "no table",
        f"python -c 'import pandas as pd; pd.read_csv(\"datasets/line/trial1.csv\").to_json(\"j.json\", orient=\"records\", lines=True)'; fluidact-fit line j.json {LINE} -o j.yaml",
        0, r"time_constant +(119\.\d+ .* ms|0\.119\d+ .* s) ",
    ),
    Case(
        "an Excel workbook", "refused",
        f"python -c 'import pandas as pd; pd.read_csv(\"datasets/line/trial1.csv\").to_excel(\"x.xlsx\", index=False)'; fluidact-fit line x.xlsx {LINE} -o x.yaml",
        0, r"time_constant +(119\.\d+ .* ms|0\.119\d+ .* s) ",
    ),
    Case(
        "`name=value` in another order in every other line", "half of the lines lost",
        "tail -n +2 datasets/line/trial1.csv | awk -F, '{if (NR % 2) print \"t=\" $1 \"ms a=\" $2 \"bar b=\" $3 \"bar\"; else print \"b=\" $3 \"bar a=\" $2 \"bar t=\" $1 \"ms\"}' > k.log; fluidact-fit line k.log --column inlet=a --column outlet=b -o k.yaml",
        0, r"time_constant +(119\.\d+ .* ms|0\.119\d+ .* s) ",
    ),
]  # fmt: skip
CASES = [*ROWS, *STRUCTURE, *UNITS, *SOURCES, *FILES, *ENDS, *TIMES, *RECORDINGS]


class Outcome(NamedTuple):
    """How a command ended, and the line that says what was wanted (``None`` without one)."""

    status: int
    line: str | None
    text: str

    def fits(self, case: Case) -> bool:
        """Whether it is what the case asks for."""
        return self.status == case.status and self.line is not None and "Traceback" not in self.text


def run(case: Case) -> Outcome:
    """Run the command of a case in a folder of its own."""
    programs = str(Path(sys.executable).parent)
    environment = {**os.environ, "PATH": programs + os.pathsep + os.environ["PATH"]}
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "datasets").symlink_to(ROOT / "datasets")
        try:
            done = subprocess.run(
                ["bash", "-c", f"ulimit -t {_LONGEST}; {case.command}"], cwd=folder, env=environment, check=False,
                stdout=subprocess.PIPE, stderr=subprocess.STDOUT, timeout=_WAIT,
            )  # fmt: skip
        except subprocess.TimeoutExpired:
            return Outcome(-1, None, f"it hangs: no end after {_WAIT:g} s")
    text = done.stdout.decode(errors="replace")
    lines = [line for line in text.splitlines() if re.search(case.says, line)]
    return Outcome(done.returncode, lines[0].strip() if lines else None, text)


def _short(text: str, most: int = 140) -> str:
    text = text.replace("|", "\\|")
    return text if len(text) <= most else text[: most - 1] + "…"


def _shown(command: str) -> str:
    for words in (BARE, LINE, CYLINDER, FORCE):
        command = command.replace(words, "COLUMNS")
    return command


def main() -> None:
    """Run the cases, print or write the page; exit 1 where one is not as it should be."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--write", action="store_true", help="write the page")
    parser.add_argument("--only", default="", help="cases whose name holds this")
    given = parser.parse_args()
    rows, commands, failed = [], [], 0
    for number, case in enumerate((c for c in CASES if given.only in c.name), start=1):
        outcome = run(case)
        if not outcome.fits(case):
            failed += 1
            print(f"{case.name}: status {outcome.status}, {case.status} wanted, {case.says!r}\n"
                  f"{case.command}\n{outcome.text[:1500]}", file=sys.stderr)  # fmt: skip
        said = _short(outcome.line or "not what it should")
        rows.append(f"| {number}. {case.name} | {case.before} | exit {outcome.status} | `{said}` |")
        commands.append(f"{number}. `{_shown(case.command)}`")
    page = _EXPLAINED + "\n".join(rows) + "\n\n## Commands\n\n" + "\n".join(commands) + "\n"
    if given.write and not failed:
        PAGE.write_text(page, encoding="utf-8")
    else:
        print(page)
    print(f"{len(rows)} cases, {failed} not as they should be", file=sys.stderr)
    sys.exit(1 if failed else 0)


if __name__ == "__main__":
    main()
