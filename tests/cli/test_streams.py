"""Closed and full standard streams, interrupts at any moment, text that acts on a terminal."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml

from fluidact_fit import read_document

Run = Callable[..., Any]
Log = Callable[..., Path]
pytestmark = pytest.mark.skipif(os.name != "posix", reason="POSIX shells, signals and devices")


def shell(redirections: str, *args: str, **more: Any) -> subprocess.CompletedProcess[str]:
    """Run the program with the redirections of a shell."""
    program = f'exec "{sys.executable}" -m fluidact_fit_cli.main "$@" {redirections}'
    return subprocess.run(
        ["sh", "-c", program, "sh", *args], capture_output=True, text=True, check=False,
        timeout=60, **more,
    )  # fmt: skip


def test_a_log_from_a_closed_standard_input_is_refused(tmp_path: Path) -> None:
    done = shell("0<&-", "line", "-", "-o", "line.yaml", cwd=tmp_path)
    assert done.returncode == 3
    assert "standard input is closed" in done.stderr
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("redirections", "options", "status", "told"),
    [
        (">&-", [], 0, ""),
        ("2>&-", [], 0, ""),
        ("0<&- >&- 2>&-", ["-v"], 0, ""),
        ("2>/dev/full", ["-v"], 0, ""),
        (">&-", ["--json"], 3, "standard output is closed"),
        (">/dev/full", ["--json"], 3, "standard output cannot be written: No space left"),
        (">/dev/full", [], 3, "Written before that: v.yaml."),
    ],
)
def test_a_fit_whose_streams_are_closed_or_full(
    redirections: str, options: list[str], status: int, told: str, valve: Log, inside: Path
) -> None:
    valve()
    done = shell(redirections, "valve", "valve.csv", "-o", "v.yaml", *options)
    assert done.returncode == status, done.stderr
    assert told in done.stderr
    assert "Nothing was written" not in done.stderr
    assert "Exception ignored" not in done.stderr
    assert read_document(inside / "v.yaml").family == "valve"
    assert sorted(p.name for p in inside.iterdir()) == ["v.yaml", "valve.csv"]


def test_an_error_without_standard_error_keeps_its_status(inside: Path) -> None:
    assert shell("2>&-", "valve", "there-is-none.csv").returncode == 3


def test_help_and_schema_on_a_full_disk(inside: Path) -> None:
    for words in (["--help"], ["schema"], ["valve", "--help"]):
        done = shell(">/dev/full", *words)
        assert done.returncode == 3
        assert "No space left on device" in done.stderr
        assert "Traceback" not in done.stderr
        assert "ignored" not in done.stderr


@pytest.mark.parametrize("module", ["click", "datetime", "numpy", "scipy.linalg", "pydantic"])
def test_an_interrupt_while_a_module_is_imported(module: str, valve: Log, inside: Path) -> None:
    valve()
    # An audit hook interrupts when the file of the module is about to be opened.
    code = (
        "import os, signal, sys\n"
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "def hook(event, args):\n"
        f"    if event == 'import' and args[0] == {module!r}:\n"
        "        os.kill(os.getpid(), signal.SIGINT)\n"
        "sys.addaudithook(hook)\n"
        "sys.argv = ['fluidact-fit', 'valve', 'valve.csv']\n"
        "from fluidact_fit_cli.main import main\n"
        "main()\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=False, timeout=60
    )
    assert done.returncode == 130
    assert done.stderr.strip() in ("Interrupted.", "Interrupted. Nothing was written.")
    assert [p.name for p in inside.iterdir()] == ["valve.csv"]


@pytest.mark.parametrize("after", [1.5, 3.0, 5.0])
def test_an_interrupted_batch_says_so_and_nothing_else(
    after: float, valve: Log, inside: Path
) -> None:
    """Ctrl-C reaches all its processes, whatever they import or fit."""
    valve()
    rows = [f"job{k},valve,valve.csv,--seed {k}" for k in range(8)]
    (inside / "jobs.csv").write_text("\n".join(["job,family,logs,options", *rows]) + "\n")
    program = [sys.executable, "-m", "fluidact_fit_cli.main", "batch", "jobs.csv", "-o", "fleet"]
    run = subprocess.Popen(
        program, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
    )
    time.sleep(after)
    os.killpg(run.pid, signal.SIGINT)
    _, err = run.communicate(timeout=60)
    assert run.returncode in (0, 130)
    assert "Traceback" not in err
    assert "Interrupted." in err or run.returncode == 0


def test_an_interrupt_that_is_ignored_stays_ignored(valve: Log, inside: Path) -> None:
    valve()
    program = [sys.executable, "-m", "fluidact_fit_cli.main", "valve", "valve.csv"]
    run = subprocess.Popen(
        program, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_IGN),
    )  # fmt: skip
    while run.poll() is None:
        run.send_signal(signal.SIGINT)
        time.sleep(0.02)
    out, err = run.communicate()
    assert run.returncode == 0, err
    assert b"written to valve.yaml" in out


@pytest.mark.parametrize("words", [["--version"], ["schema"], ["line", "--help"]])
def test_an_output_cut_off_while_errors_are_closed(words: list[str], inside: Path) -> None:
    reading, writing = os.pipe()
    os.close(reading)
    done = subprocess.run(
        [sys.executable, "-m", "fluidact_fit_cli.main", *words],
        stdout=writing, preexec_fn=lambda: os.close(2), check=False, timeout=60,
    )  # fmt: skip
    os.close(writing)
    assert done.returncode == 141


@pytest.mark.parametrize("backend", ["nonsense", ""])
def test_pictures_need_no_backend(backend: str, valve: Log, inside: Path) -> None:
    valve()
    environment = {**os.environ, "MPLBACKEND": backend}
    done = shell("", "valve", "valve.csv", "--plot", "v.png", "--report", "v.html", env=environment)
    assert done.returncode == 0, done.stderr
    assert (inside / "v.png").read_bytes().startswith(b"\x89PNG")
    code = (
        "from fluidact_fit.report.style import load_matplotlib\n"
        "import os\n"
        "print(load_matplotlib().rcParams['backend'], os.environ['MPLBACKEND'])\n"
    )
    shown = subprocess.run(
        [sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True
    )
    assert shown.stdout.strip().endswith(backend)
    assert ("agg agg" in shown.stdout) == (backend == "agg")


# Colour, title of the window, an 8-bit control, the direction of writing, a mark nobody sees.
EVIL = "\x1b[31mred\x1b]0;owned\x07\x9b2J\u202etxt.exe\u2066\ufeff"
ACTING = re.compile("[\x00-\x09\x0b-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069\ufeff\u2028]")


def assert_harmless(*texts: str) -> None:
    for text in texts:
        found = ACTING.search(text)
        assert not found, text[max(found.start() - 80, 0) : found.end() + 20]


@pytest.fixture
def evil(valve: Log, inside: Path) -> str:
    """A log with a name and headers that act on a terminal."""
    path = valve("plain.csv")
    text = path.read_text().replace("command [V]", f"command{EVIL} [V]")
    name = f"v{EVIL}.csv"
    (inside / name).write_text(text, encoding="utf-8")
    path.unlink()
    return name


def test_text_from_outside_is_shown_harmlessly(
    apart: Run, here: Run, evil: str, inside: Path
) -> None:
    words = ["--column", f"command=command{EVIL}"]
    for args in (
        ["inspect", evil],
        ["inspect", evil, "--family", "valve"],
        ["valve", evil],
        ["valve", evil, *words, "-o", f"{EVIL}.yaml", "--report", "r.html", "--plot", "p.svg"],
        ["check", f"{EVIL}.yaml", evil],
        ["simulate", f"{EVIL}.yaml", evil],
        ["simulate", f"{EVIL}.yaml", evil, "-o", f"{EVIL}.csv"],
        ["export", f"{EVIL}.yaml", "--to", "json", "-o", f"{EVIL}"],
        ["export", f"{EVIL}.yaml", "--to", EVIL, "--accept-not-identified", EVIL],
        ["compare", f"{EVIL}.yaml", f"{EVIL}.yaml"],
        ["compare", evil, evil],
        ["report", f"{EVIL}.yaml", f"{EVIL}.yaml", "-o", "beside.html"],
        ["check-consumer", f"{EVIL}.yaml", evil],
        ["check-consumer", f"{EVIL}.yaml", f"{EVIL}.yaml"],
        ["design", "valve", "--from", f"{EVIL}.yaml", "-o", f"d{EVIL}.csv", "--duration", "0.5"],
        ["design", EVIL, "--from", f"{EVIL}.yaml"],
        ["demo", f"{evil}/{EVIL}"],
        [EVIL],
        ["valve", evil, f"--{EVIL}"],
        ["inspect", evil, "--family", EVIL],
        *(["valve", evil, *words, option, f"{left}{EVIL}"]
          for option in ("--column", "--unit", "--scale", "--step", "--hold", "--fix", "--noise",
                         "--bounds", "--start")
          for left in ("", "command=", f"{EVIL}=")),
        *(["valve", evil, *words, option, EVIL]
          for option in ("--plot", "--report", "--seed", "--window", "--sample-time", "--validate",
                         "--zero", "--dead-time", "--controller-sample-time")),
    ):  # fmt: skip
        # a process of its own has an encoding of its own, and takes a second
        done = apart(*args, cwd=inside) if "--report" in args else here(*args)
        assert done.status in (0, 2, 3, 4, 5), (args, done.err)
        assert_harmless(done.out, done.err)
    for page in ("r.html", "beside.html"):
        assert_harmless((inside / page).read_text(encoding="utf-8"))
    text = (inside / f"{EVIL}.yaml").read_text(encoding="utf-8")
    assert_harmless(text)
    # the file still holds the very header, so that check finds the column again
    header = yaml.safe_load(text)["provenance"]["logs"][0]["columns"]["command"]["header"]
    assert header.startswith(f"command{EVIL}")


def test_json_says_what_is_there(here: Run, evil: str) -> None:
    done = here("inspect", evil, "--json")
    assert_harmless(done.out)
    assert any(EVIL in (c["name"] or "") for c in json.loads(done.out)["columns"])


def test_keys_and_tags_of_a_parameter_file(here: Run, valve: Log, inside: Path) -> None:
    assert here("valve", valve(), "-q").status == 0
    good = (inside / "valve.yaml").read_text(encoding="utf-8")
    quoted = json.dumps(EVIL)
    for bad in (
        good + f"{quoted}: 1\n",
        good.replace("family: valve", f"family: {quoted}"),
        good.replace("gain:", f"{quoted}:", 1),
        good.replace("family: valve", f"family: !<{EVIL}> valve"),
        good.replace("family: valve", "family: !!python/%1B%5B31m valve"),
        good.replace("family: valve", f"family: *{EVIL}"),
        good + f"{EVIL}",
    ):
        (inside / "bad.yaml").write_text(bad, encoding="utf-8")
        done = here("check", "bad.yaml", "valve.csv")
        assert done.status == 3, done.err
        assert_harmless(done.out, done.err)


def test_an_error_in_python_is_harmless() -> None:
    from fluidact_fit import fit
    from fluidact_fit.errors import FluidactError, Notice

    with pytest.raises(FluidactError) as caught:
        fit("valve", f"{EVIL}.csv")
    assert_harmless(str(caught.value), caught.value.where)
    assert Notice("code", "a\x1b[0m").message == r"a\x1b[0m"
