"""Lists of jobs: what they mean, and what is refused with its place."""

from __future__ import annotations

import contextlib
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from fluidact_fit.batch import Job, group_logs, read_jobs
from fluidact_fit.errors import JobsFileError, UsageError


def _file(folder: Path, text: str, name: str = "jobs.csv") -> Path:
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


EXPECTED = [
    Job("a 1", "valve", ("x/t1.csv", "x/t2.csv"), ("--column", "outlet=p [bar]", "--strict")),
    Job("b", "line", ("y*.csv",)),
]
CSV = (
    "job,family,logs,options\n"
    "a 1,valve,x/t1.csv; x/t2.csv,\"--column 'outlet=p [bar]' --strict\"\n"
    "\n"
    "b,line,y*.csv,\n"
)
SEMICOLONS = (
    "\ufeffJob;Family;Logs;Options\r\n"
    'a 1;valve;"x/t1.csv;x/t2.csv";"--column \'outlet=p [bar]\' --strict"\r\n'
    "b;line;y*.csv;\r\n"
)
YAML = """\
jobs:
- job: a 1
  family: valve
  logs: [x/t1.csv, x/t2.csv]
  options: [--column, "outlet=p [bar]", --strict]
- {job: b, family: line, logs: y*.csv}
"""


@pytest.mark.parametrize(
    ("name", "text"), [("j.csv", CSV), ("j.txt", SEMICOLONS), ("j.yaml", YAML), ("j.yml", YAML[6:])]
)
def test_a_list_of_jobs_in_every_form(name: str, text: str, tmp_path: Path) -> None:
    assert read_jobs(_file(tmp_path, text, name)) == EXPECTED


HEAD = "job,family,logs,options\n"


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("", "holds no job"),
        (HEAD, "holds no job"),
        ("job,family,logs,option\na,line,b.csv,\n", "Did you mean 'options'"),
        ("job,family\na,line\n", "has no 'logs'"),
        (HEAD + "a,line\n", "line 2: holds 2 cells"),
        (HEAD + "a,line,,\n", "'logs' is empty"),
        (HEAD + "a,line, ; ,\n", "names no log"),
        (HEAD + "a,line,-,\n", "name of no file"),
        (HEAD + 'a,line,b.csv,"--unit \'x"\n', "No closing quotation"),
        (HEAD + 'a,line,"b.csv,\n', "is not CSV"),
        (HEAD + "../a,line,b.csv,\n", "cannot be that of a file"),
        (HEAD + ".a,line,b.csv,\n", "cannot be that of a file"),
        (HEAD + "NUL,line,b.csv,\n", "cannot be that of a file"),
        (HEAD + "a\x1b[2J,line,b.csv,\n", r"'a\x1b[2J'"),
        (HEAD + "a,line,b.csv,\na,line,c.csv,\n", "two jobs are named 'a'"),
        (HEAD + "a,line,b.csv,\nA,line,c.csv,\n", "the same file on some systems"),
    ],
)
def test_what_is_wrong_is_said_with_its_place(text: str, found: str, tmp_path: Path) -> None:
    with pytest.raises(JobsFileError) as error:
        read_jobs(_file(tmp_path, text))
    assert found in error.value.text
    assert "jobs.csv" in error.value.text
    assert error.value.remedy


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("a: 1", "is not a list of jobs"),
        ("- 1", "job 1: is not a mapping"),
        ("- {job: a, family: line, logs: [[b]]}", "'logs' is no text"),
        ("- {job: a, family: line, logs: !!python/name:os.system x}", "is not YAML"),
        ("[" * 5000, "is not YAML"),
        ("- {job: true, family: line, logs: b}", "'job' is no text"),
        ("&a [*a]", "is not a mapping"),
    ],
)
def test_hostile_yaml(text: str, found: str, tmp_path: Path) -> None:
    with pytest.raises(JobsFileError, match=found):
        read_jobs(_file(tmp_path, text, "jobs.yaml"))


@given(text=st.text(max_size=200))
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=200)
def test_any_text_is_jobs_or_refused(text: str, tmp_path: Path) -> None:
    for name, head in (("jobs.csv", HEAD), ("jobs.csv", ""), ("jobs.yaml", "")):
        path = tmp_path / name
        path.write_bytes((head + text).encode("utf-8", "surrogatepass"))
        with contextlib.suppress(JobsFileError):
            assert read_jobs(path)


def _logs(folder: Path, *names: str) -> None:
    for name in names:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).touch()


def test_patterns_find_logs_in_order_and_once(tmp_path: Path) -> None:
    _logs(tmp_path, "u/b.csv", "u/a.csv", "u/deep/c.csv", "log[1].csv")
    job = Job("j", "line", ("u/*.csv", "u/a.csv", "u/**/*.csv", "log[1].csv", "none*.csv"))
    assert job.found_logs(tmp_path) == (
        "u/a.csv", "u/b.csv", "u/deep/c.csv", "log[1].csv", "none*.csv",
    )  # fmt: skip


@pytest.mark.parametrize(
    ("group_by", "expected"),
    [
        ("file", {"u1_t1": 1, "u1_t2": 1, "u2_t1": 1}),
        ("folder", {"u1": 2, "u2": 1}),
        ("{job}.csv", {"t1": 2, "t2": 1}),
        ("t{job}.*", {"1": 2, "2": 1}),
    ],
)
def test_logs_are_grouped(group_by: str, expected: dict[str, int], tmp_path: Path) -> None:
    _logs(tmp_path, "u1/t1.csv", "u1/t2.csv", "u2/t1.csv")
    jobs = group_logs("line", ["*/*.csv"], group_by, "--unit 'inlet=bar'", tmp_path)
    assert {job.name: len(job.logs) for job in jobs} == expected
    assert {job.options for job in jobs} == {("--unit", "inlet=bar")}


@pytest.mark.parametrize(
    ("pattern", "group_by", "found"),
    [
        ("*.dat", "file", "no file matches"),
        ("*.csv", "unit", "is not understood"),
        ("*.csv", "x{job}.csv", "does not match a.csv"),
    ],
)
def test_grouping_that_cannot_be(pattern: str, group_by: str, found: str, tmp_path: Path) -> None:
    _logs(tmp_path, "a.csv", "b.csv")
    with pytest.raises(UsageError, match=found):
        group_logs("line", [pattern], group_by, "", tmp_path)


def test_two_logs_that_would_share_a_file(tmp_path: Path) -> None:
    _logs(tmp_path, "a.csv", "a.txt")
    with pytest.raises(UsageError, match="would be jobs of one name"):
        group_logs("line", ["a.*"], "file", "", tmp_path)
