"""Faults, interrupts and closed pipes end tidily."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import fluidact_fit.fitting

Run = Callable[..., Any]


@pytest.fixture
def failing(monkeypatch: pytest.MonkeyPatch, inside: Path, valve: Callable[..., Path]) -> Any:
    """Make every fit end with an exception."""

    def arm(error: BaseException) -> Path:
        def fit(*_: object, **__: object) -> None:
            raise error

        monkeypatch.setattr(fluidact_fit.fitting, "fit", fit)
        return valve()

    return arm


def test_a_fault_apologises_and_shows_no_traceback(here: Run, failing: Any, inside: Path) -> None:
    log = failing(ZeroDivisionError("float division"))
    done = here("valve", log)
    assert done.status == 1
    assert "ZeroDivisionError: float division" in done.err
    assert "--debug" in done.err
    assert "Traceback" not in done.err
    assert not (inside / "valve.yaml").exists()
    assert "Traceback" in here("valve", log, "--debug").err
    assert "Traceback" in here("--debug", "valve", log).err


@pytest.mark.parametrize(
    ("error", "status", "told"),
    [
        (KeyboardInterrupt(), 130, "Interrupted"),
        (MemoryError(), 1, "memory"),
        (OSError(5, "Input/output error", "disk"), 3, "disk: Input/output error"),
        (RecursionError("deep"), 1, "RecursionError"),
        (np.linalg.LinAlgError("Singular matrix"), 1, "Singular matrix"),
    ],
)
def test_statuses(
    error: BaseException, status: int, told: str, here: Run, failing: Any, inside: Path
) -> None:
    done = here("valve", failing(error))
    assert done.status == status
    assert told in done.err
    assert done.out == ""
    assert "Traceback" not in done.err


def test_numpy_warnings_do_not_reach_the_user(
    here: Run, inside: Path, valve: Callable[..., Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    real = fluidact_fit.fitting.fit

    def noisy(*args: Any, **kwargs: Any) -> Any:
        np.log(np.zeros(2))
        return real(*args, **kwargs)

    monkeypatch.setattr(fluidact_fit.fitting, "fit", noisy)
    done = here("valve", valve())
    assert done.status == 0
    assert "RuntimeWarning" not in done.err


@pytest.mark.skipif(os.name == "nt", reason="pipes differ")
def test_closed_pipe_is_tidy(inside: Path, valve: Callable[..., Path]) -> None:
    valve()
    program = [sys.executable, "-m", "fluidact_fit_cli.main", "schema"]
    reader, writer = os.pipe()
    os.close(reader)
    done = subprocess.run(program, stdout=writer, stderr=subprocess.PIPE, text=True, check=False)
    os.close(writer)
    assert done.returncode == 141
    assert done.stderr == ""


@pytest.mark.skipif(os.name == "nt", reason="signals differ")
def test_interrupt_is_tidy(inside: Path, valve: Callable[..., Path]) -> None:
    valve()
    code = (
        "import fluidact_fit.fitting, os, signal, sys\n"
        # a shell that runs the tests in the background has them ignore the signal
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "fluidact_fit.fitting.fit = lambda *a, **k: os.kill(os.getpid(), signal.SIGINT)\n"
        "from fluidact_fit_cli.main import run\n"
        "sys.exit(run(['valve', 'valve.csv']))\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=False, timeout=60
    )
    assert done.returncode == 130
    assert done.stderr.strip() == "Interrupted. Nothing was written."
    assert not (inside / "valve.yaml").exists()


@pytest.mark.parametrize(
    ("terminal", "options", "shown"),
    [(True, {}, "first"), (False, {}, ""), (False, {"verbose": True}, "first\n"),
     (True, {"quiet": True}, "")],
)  # fmt: skip
def test_progress(
    terminal: bool, options: dict[str, bool], shown: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    import io

    from fluidact_fit_cli.progress import Progress

    stream = io.StringIO()
    monkeypatch.setattr(stream, "isatty", lambda: terminal, raising=False)
    monkeypatch.setattr(sys, "stderr", stream)
    progress = Progress(**options)
    progress("first")
    progress.close()
    text = stream.getvalue()
    assert shown in text if shown else text == ""
    if terminal and shown:
        assert text.endswith("\r\x1b[K")


def test_progress_goes_on_while_a_stage_lasts(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    from fluidact_fit_cli import progress as module

    drawn = threading.Event()
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True, raising=False)
    monkeypatch.setattr(module, "_TICK", 0.01)
    monkeypatch.setenv("COLUMNS", "45")
    progress = module.Progress(stages=("reading", "fitting", "writing"))
    monkeypatch.setattr(progress, "_draw", lambda draw=progress._draw: (draw(), drawn.set()))
    progress("reading")
    progress("fitting")
    progress("comparing speed and acceleration of everything too")
    drawn.clear()
    assert drawn.wait(10.0)
    progress.close()
    *lines, last = capsys.readouterr().err.split("\r\x1b[K")[1:]
    assert last == ""
    assert lines[0].startswith("1/3 reading ... 0.")
    assert any(line.startswith("2/3 comparing speed") for line in lines)
    assert max(map(len, lines)) < 45


def test_a_batch_shows_lines_where_there_is_no_terminal(
    capsys: pytest.CaptureFixture[str],
) -> None:
    from fluidact_fit_cli.progress import Progress

    progress = Progress(lines=True)
    progress("first")
    progress.last -= 3.0
    progress("later")
    progress.close()
    assert capsys.readouterr().err.startswith("later ... (")


def test_an_ascii_terminal_is_no_fault(inside: Path, valve: Callable[..., Path]) -> None:
    valve()
    done = subprocess.run(
        [sys.executable, "-m", "fluidact_fit_cli.main", "valve", "valve.csv"],
        env={**os.environ, "PYTHONIOENCODING": "ascii"}, capture_output=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert b"written to valve.yaml" in done.stdout


def test_a_file_that_begins_with_a_dash_is_named(here: Run, valve: Any, inside: Path) -> None:
    os.rename(valve(), inside / "-dash.csv")
    done = here("valve", "-dash.csv")
    assert done.status == 2
    assert "Give './-dash.csv' if the file is meant" in done.err
    assert here("valve", "./-dash.csv", "-q").status == 0


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("valve", "valve.csv", "--exclude-rows", "0"), "--exclude-rows 0 is not understood"),
        (("batch", "jobs.csv", "-o", "x", "--workers", "x"), "'x' is not a whole number."),
        (("check", "valve.yaml", "valve.csv", "./valve.csv"), "./valve.csv is given twice"),
    ],
)
def test_what_was_typed_is_named(
    words: tuple[str, ...], told: str, here: Run, valve: Any, inside: Path
) -> None:
    valve()
    assert here("valve", "valve.csv", "-q").status == 0
    done = here(*words)
    assert done.status == 2
    assert told in done.err


def test_one_row_is_not_several(here: Run, valve: Any, inside: Path) -> None:
    lines = valve().read_text(encoding="utf-8").splitlines()[:2]
    Path("one.csv").write_text("\n".join([*lines, ""]), encoding="utf-8")
    assert "one.csv: 1 row, 3 columns" in here("inspect", "one.csv").out
    assert "1 run, 0 to " in here("inspect", "valve.csv").out
