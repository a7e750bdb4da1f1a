"""Lists of jobs: what they mean, and what is refused with its place."""

from __future__ import annotations

import contextlib
import os
from glob import glob
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from fluidact_fit.batch import Job, group_logs, read_jobs
from fluidact_fit.batch.patterns import expand
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
        (HEAD + "a,line,b.csv," + "0" * 30_000, "line 2: the options have 30000 characters"),
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
        ("&a [*a]", "is not YAML.*has an alias"),
        ("- {job: a, job: b, family: line, logs: b}", "duplicate key"),
        ("- {job: a, family: line, logs: b}\n---\n[]", "second document"),
    ],
)
def test_hostile_yaml(text: str, found: str, tmp_path: Path) -> None:
    with pytest.raises(JobsFileError, match=found):
        read_jobs(_file(tmp_path, text, "jobs.yaml"))


def test_yaml_keeps_every_word_as_it_is_written(tmp_path: Path) -> None:
    words = ["0017", "1.50", "1e3", "0x1F", "1_000", "2026-01-02", "yes", "no", "on", "0o17", "+7"]
    more = ["12:30", "2026-01-02T03:04:05Z", ".5", "1.", "9" * 5000]  # none of them can be a file's
    rows = [f"- {{job: {w}, family: {w}, logs: [{w}], options: [--x, {w}]}}" for w in words]
    rows += [f"- job: j{k}\n  family: line\n  logs: {w}\n" for k, w in enumerate(more)]
    jobs = read_jobs(_file(tmp_path, "\n".join(rows), "jobs.yaml"))
    assert jobs[: len(words)] == [Job(w, w, (w,), ("--x", w)) for w in words]
    assert [job.logs for job in jobs[len(words) :]] == [(w,) for w in more]


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


def test_names_that_look_like_options_stay_names(tmp_path: Path) -> None:
    _logs(tmp_path, "--scale=outlet=-3", "-", "-o.csv", "u/-x.csv")
    job = Job("j", "line", ("*", "--strict", "u/-*"))
    assert job.found_logs(tmp_path) == (
        "./-", "./--scale=outlet=-3", "./-o.csv", "u", "./--strict", "u/-x.csv",
    )  # fmt: skip
    jobs = group_logs("line", ["-*.csv"], "file", "", tmp_path)
    assert [(job.name, job.logs) for job in jobs] == [("-o", ("./-o.csv",))]


@pytest.mark.skipif(os.name != "posix", reason="links")
def test_links_in_circles_are_followed_once(tmp_path: Path) -> None:
    _logs(tmp_path, "a/1.csv", "b/2.csv", "b/c/3.csv")
    for at, to in (("a/up", ".."), ("a/self", "."), ("a/other", "../b"), ("b/other", "../a"),
                   ("b/c/top", "../.."), ("b/loop", "loop")):  # fmt: skip
        (tmp_path / at).symlink_to(to)
    every = Job("j", "line", ("**/*.csv",)).found_logs(tmp_path)
    assert every == ("a/1.csv", "b/2.csv", "b/c/3.csv")
    deep = "/".join(["*"] * 40 + ["*.csv"])
    assert len(Job("j", "line", (deep,)).found_logs(tmp_path)) == 3
    assert Job("j", "line", ("a/**/*.csv",)).found_logs(tmp_path) == (
        "a/1.csv", "a/other/2.csv", "a/other/c/3.csv",
    )  # fmt: skip


@pytest.mark.parametrize("pattern", [
    "*.csv", "**", "**/*.csv", "u*/*", "./u1/../*/[ab].csv", "u?/**/a*", "*", ".*/*.csv",
    "u1/a.csv", "u1/*/", "/**/none*/x.csv", "**/deep/*", "[", "u1/**/", "*/*/*",
])  # fmt: skip
def test_patterns_find_what_glob_finds(pattern: str, tmp_path: Path) -> None:
    _logs(tmp_path, "a.csv", "u1/a.csv", "u1/b.csv", "u1/deep/a.csv", "u2/c.csv", ".hidden/d.csv",
          "u2/.e.csv", "u2/deep/er/f.csv")  # fmt: skip
    if pattern.startswith("/"):
        pattern = str(tmp_path) + pattern
    found = glob(pattern, root_dir=tmp_path, recursive=True)
    folders = {p for p in found if (tmp_path / p).is_dir()} if pattern.endswith("**") else set()
    assert expand(pattern, tmp_path) == sorted({*found} - folders)


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
