"""Processes that are killed, interrupted or cut off, full disks, and two writers at once.

Every case fits a short log of a pneumatic line in a process of its own, mostly over a parameter
file that is there already: that file, or a whole new one, has to be there afterwards.
"""

from __future__ import annotations

import contextlib
import os
import random
import resource
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any

from fluidact_fit import FluidactError, read_document

from . import program
from .case import EXIT_1, HANG, TRACEBACK, WRONG, Case, Part, Result

_OLD = Path(__file__).parents[2] / "tests" / "golden" / "0.1.0" / "line.yaml"
PROGRAM = (sys.executable, "-m", "fluidact_fit_cli.main")
_ROWS = 150
# Ends its own process before the n-th thing that it does to a file of this folder.
_KILLER = """
import os, signal, sys
from fluidact_fit_cli.main import main
folder, left = sys.argv.pop(1), int(sys.argv.pop(1))
def hook(event, args):
    global left
    if event in ("open", "os.rename", "os.chmod", "os.remove", "os.link", "os.listdir") and any(
        isinstance(a, str) and a.startswith(folder) and not a.endswith("log.csv") for a in args
    ):
        left -= 1
        if left < 0:
            os.kill(os.getpid(), signal.SIGKILL)
sys.addaudithook(hook)
main()
"""
# Waits, before a file takes its name, for another process that is as far as this one.
_MEETER = """
import os, sys, time
from fluidact_fit_cli.main import main
folder = sys.argv.pop(1)
def hook(event, args):
    if event in ("os.rename", "os.link") and str(args[1]).endswith("out.yaml"):
        os.mkdir(os.path.join(folder, str(os.getpid())))
        for _ in range(300):
            if len(os.listdir(folder)) > 1:
                break
            time.sleep(0.01)
sys.addaudithook(hook)
main()
"""


@cache
def _old() -> bytes:
    return _OLD.read_bytes()


def _prepare(existing: bool = True) -> list[str]:
    """Write the log, and the file that is there already; returns the words of the fit."""
    program.write_log("line", Path("log.csv"), _ROWS)
    if existing:
        Path("out.yaml").write_bytes(_old())
    force = ["-f"] if existing else []
    output = str(Path("out.yaml").resolve())
    return ["line", "log.csv", *program.arguments("line"), "-o", output, *force]


def start(words: Sequence[str], **how: Any) -> subprocess.Popen[bytes]:
    how.setdefault("stdout", subprocess.PIPE)
    how.setdefault("stderr", subprocess.PIPE)
    how.setdefault("stdin", subprocess.DEVNULL)
    return subprocess.Popen(words, **how)


def wait(process: subprocess.Popen[bytes], case: Case, result: Result) -> str:
    """Wait for the end of a process; returns what it printed."""
    try:
        out, err = process.communicate(timeout=6 * case.limit)
    except subprocess.TimeoutExpired:
        process.kill()
        out, err = process.communicate()
        result.fail(HANG, "the process does not end")
    text = ((out or b"") + (err or b"")).decode(errors="replace")
    result.message = text
    result.outcome = str(process.returncode)
    if "Traceback (most recent" in text or "Exception ignored" in text:
        result.fail(TRACEBACK, text.strip().splitlines()[-1])
    if process.returncode == 1:
        result.fail(EXIT_1, text.strip()[-200:] or "without a word")
    return text


@cache
def _duration() -> float:
    """Seconds that an undisturbed fit takes now."""
    words = _prepare()
    began = time.perf_counter()
    subprocess.run([*PROGRAM, *words], check=True, capture_output=True)
    return time.perf_counter() - began


def judge_file(path: Path, old: bytes | None, result: Result) -> str:
    """Add what is wrong with what stands where the file was to be; returns what does."""
    if not path.exists():
        if old is not None:
            result.fail(WRONG, "the file that was there is lost")
        return "none"
    content = path.read_bytes()
    if content == old:
        return "old"
    try:
        read_document(path)
    except FluidactError as error:
        result.fail(WRONG, f"the file is half written: {str(error)[:200]}")
        return "broken"
    return "new"


def kill(case: Case) -> Result:
    """End the process for good: at any instant, or before any of the steps of writing."""
    words = _prepare()
    result = Result("")
    log = Path("log.csv").read_bytes()
    if case.rng.random() < 0.5:
        instant = case.rng.uniform(0.0, 1.1) * _duration()
        _prepare()
        case.tell(f"killed after {instant:.3f} s")
        process = start([*PROGRAM, *words])
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(instant)
        process.kill()
    else:
        step = case.rng.randrange(6)
        case.tell(f"killed before step {step} of writing")
        process = start([sys.executable, "-c", _KILLER, str(Path.cwd()), str(step), *words])
    wait(process, case, result)
    result.outcome = judge_file(Path("out.yaml"), _old(), result)
    if Path("log.csv").read_bytes() != log:
        result.fail(WRONG, "the log was changed")
    _judge_rest(words, result)
    return result


def _judge_rest(words: Sequence[str], result: Result) -> None:
    """What a killed process left in the folder has to go with the next run, a day later."""
    left = _strangers()
    if not left:
        return
    for path in left:
        os.utime(path, (time.time() - 100_000,) * 2)
    subprocess.run([*PROGRAM, *words], check=True, capture_output=True)
    if _strangers():
        result.fail(WRONG, "a temporary file is left for ever")


def _strangers() -> list[Path]:
    return [p for p in Path().iterdir() if p.name not in ("log.csv", "out.yaml")]


def interrupt(case: Case) -> Result:
    """Press Ctrl-C at any instant."""
    words = _prepare()
    instant = case.rng.uniform(0.03, 1.05) * _duration()
    _prepare()
    case.tell(f"interrupted after {instant:.3f} s")
    result = Result("")
    process = start([*PROGRAM, *words])
    with contextlib.suppress(subprocess.TimeoutExpired):
        process.wait(instant)
    process.send_signal(signal.SIGINT)
    wait(process, case, result)
    found = judge_file(Path("out.yaml"), _old(), result)
    if process.returncode not in (0, 130, -signal.SIGINT):
        result.fail(WRONG, f"exit status {process.returncode}")
    if "Nothing was written" in result.message and found == "new":
        result.fail(WRONG, "says that nothing was written, and the file is there")
    if _strangers():
        result.fail(WRONG, "a temporary file is left")
    return result


_COMMANDS: Mapping[str, list[str]] = {
    "fit": [], "fit --json": ["--json"], "fit -v": ["-v"], "fit -q": ["-q"],
    "fit of nothing": ["--column", "inlet=nothing"],
    "inspect": ["inspect", "log.csv"], "help": ["--help"], "version": ["--version"],
    "schema": ["schema"], "help of a command": ["line", "--help"], "wrong usage": ["nothing"],
    "simulate": ["simulate", str(_OLD), "log.csv", "--column", "inlet=#2", "--column", "outlet=#3"],
}  # fmt: skip


def streams(case: Case) -> Result:
    """Close standard output and error, or let them lead nowhere."""
    name = case.rng.choice(list(_COMMANDS))
    words = _prepare(existing=False)
    words = words + _COMMANDS[name] if name.startswith("fit") else _COMMANDS[name]
    how = {n: case.rng.choice(("kept", "closed", "full", "cut")) for n in (1, 2)}
    case.tell(f"{name}, standard output {how[1]}, standard error {how[2]}")
    result = Result("")
    with contextlib.ExitStack() as stack:
        ends = {n: stack.enter_context(_stream(way)) for n, way in how.items()}
        closed = [n for n, way in how.items() if way == "closed"]
        process = start([*PROGRAM, *words], stdout=ends[1], stderr=ends[2],
                         preexec_fn=lambda: [os.close(n) for n in closed])  # fmt: skip
        wait(process, case, result)
    found = judge_file(Path("out.yaml"), None, result)
    if process.returncode not in (0, 1, 2, 3, 4, 141):
        result.fail(WRONG, f"exit status {process.returncode}")
    if name in ("fit", "fit -v", "fit -q") and process.returncode == 0 and found != "new":
        result.fail(WRONG, "exit status 0 without a file")
    if "Nothing was written" in result.message and found == "new":
        result.fail(WRONG, "says that nothing was written, and the file is there")
    return result


@contextlib.contextmanager
def _stream(way: str) -> Iterator[int | None]:
    """A descriptor for a stream that is kept, full or cut off."""
    if way in ("kept", "closed"):
        yield subprocess.PIPE
        return
    if way == "full":
        descriptor = os.open("/dev/full", os.O_WRONLY)
    else:
        reading, descriptor = os.pipe()
        os.close(reading)
    try:
        yield descriptor
    finally:
        os.close(descriptor)


_ENVIRONMENTS: Sequence[Mapping[str, str]] = (
    {"MPLBACKEND": "nonsense"}, {"MPLCONFIGDIR": "/nonexistent"}, {"HOME": "/nonexistent"},
    {"LC_ALL": "C"}, {"LC_ALL": "nonsense"}, {"PYTHONIOENCODING": "ascii"}, {"COLUMNS": "0"},
    {"COLUMNS": "-5"}, {"COLUMNS": "wide"}, {"TERM": ""}, {"TERM": "nonsense"}, {"PYTHONUTF8": "0"},
    {"PYTHONOPTIMIZE": "2"}, {"TMPDIR": "/nonexistent"}, {"OMP_NUM_THREADS": "nonsense"},
    {"OPENBLAS_NUM_THREADS": "0"}, {"PYTHONHASHSEED": "1"}, {"LINES": "0"}, {"NO_COLOR": "1"},
    {"TZ": "nonsense"}, {"LANG": "de_DE.ISO-8859-1", "PYTHONUTF8": "0"},
)  # fmt: skip


def environment(case: Case) -> Result:
    """Set odd variables of the environment."""
    words = [*_prepare(existing=False), "--plot", "plot.png", "--report", "report.html"]
    chosen = case.rng.choice(_ENVIRONMENTS)
    words = case.rng.choice((words, ["line", "--help"], ["inspect", "log.csv"]))
    case.tell(f"{chosen}: {words[:2]}")
    result = Result("")
    process = start([*PROGRAM, *words], env={**os.environ, **chosen})
    wait(process, case, result)
    if process.returncode > 1:
        result.fail(WRONG, f"exit status {process.returncode}")
    return result


def disk(case: Case) -> Result:
    """Let the disk be full at any size of the file."""
    with small_disk(case.rng) as (folder, limit, what):
        os.chdir(folder)
        try:
            return _fit_on(case, limit, what)
        finally:
            os.chdir(case.folder)


def _fit_on(case: Case, limit: Callable[[], None] | None, what: str) -> Result:
    existing = case.rng.random() < 0.7
    try:
        words = _prepare(existing)
    except OSError:  # not even the log has room
        return Result("no room for the log")
    more = case.rng.choice(([], ["--plot", "plot.png"], ["--report", "report.html"]))
    case.tell(f"{what}, {'over' if existing else 'without'} a file, {' '.join(more)}")
    log = Path("log.csv").read_bytes()
    result = Result("")
    process = start([*PROGRAM, *words, *more, "-q"], preexec_fn=limit)
    wait(process, case, result)
    found = judge_file(Path("out.yaml"), _old() if existing else None, result)
    if process.returncode not in (0, 1, 3):
        result.fail(WRONG, f"exit status {process.returncode}")
    elif (process.returncode == 0) is not (found == "new") and process.returncode != 1:
        result.fail(WRONG, f"exit status {process.returncode}, and the {found} file is there")
    if _strangers() and process.returncode:
        result.fail(WRONG, f"left behind: {', '.join(p.name for p in _strangers())}")
    if Path("log.csv").read_bytes() != log:
        result.fail(WRONG, "the log was changed")
    return result


@contextlib.contextmanager
def small_disk(rng: random.Random) -> Iterator[tuple[Path, Callable[[], None] | None, str]]:
    """A folder on a disk of few pages; where none can be mounted, a limit to the size of files."""
    here, pages = Path.cwd(), rng.randrange(6, 14)
    place = here / "disk"
    place.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", f"size={4096 * pages}", "tmpfs", str(place)]
    mounted = False
    if rng.random() < 0.7:
        with contextlib.suppress(OSError):
            mounted = subprocess.run(mount, capture_output=True).returncode == 0
    if mounted:
        try:
            yield place, None, f"disk of {pages} pages"
        finally:
            subprocess.run(["umount", "--lazy", str(place)], check=True, capture_output=True)
        return
    size = rng.choice((0, 1, rng.randrange(6000), rng.randrange(60_000)))
    yield (
        place,
        lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (size, size)),
        f"files of at most {size} bytes",
    )


def writers(case: Case) -> Result:
    """Let two processes write one file at once."""
    existing = case.rng.random() < 0.3
    words = _prepare(existing)
    meet = case.rng.random() < 0.6
    how = "to the instant" if meet else "by chance"
    case.tell(f"two writers at once {how}, {'over' if existing else 'without'} a file")
    result, ended = Result(""), []
    meeting = case.folder.parent / f"meeting-{case.folder.name}"
    meeting.mkdir()
    program = [sys.executable, "-c", _MEETER, str(meeting)] if meet else PROGRAM
    first = start([*program, *words, "--seed", "1"])
    second = start([*program, *words, "--seed", "2"])
    for process in (first, second):
        wait(process, case, result)
        ended.append(process.returncode)
    result.outcome = " and ".join(map(str, sorted(ended)))
    found = judge_file(Path("out.yaml"), None, result)
    if found != "new":
        result.fail(WRONG, f"the {found} file is there")
    elif not existing and sorted(ended) != [0, 3]:
        result.fail(WRONG, f"two new files of one name: exit statuses {sorted(ended)}")
    elif not existing and f"seed: {1 + ended.index(0)}" not in Path("out.yaml").read_text():
        result.fail(WRONG, "the file is not of the process that succeeded")
    elif existing and ended != [0, 0]:
        result.fail(WRONG, f"exit statuses {ended}")
    if _strangers():
        result.fail(WRONG, "a temporary file is left")
    return result


PATIENCE = {"limit": 10.0, "wait": 300.0}
PARTS = (
    Part("kill", "kills", 250, kill, **PATIENCE),
    Part("interrupt", "interrupts", 60, interrupt, **PATIENCE),
    Part("streams", "closed, full and cut streams", 100, streams, **PATIENCE),
    Part("environment", "odd environments", 60, environment, **PATIENCE),
    Part("disk", "full disks", 60, disk, **PATIENCE),
    Part("writers", "two writers at once", 20, writers, **PATIENCE),
)
