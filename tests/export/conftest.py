"""Parameter files of this version: one of every family, changed ones, and all as C."""

from __future__ import annotations

import copy
import shutil
import subprocess
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
import yaml

import fluidact_fit as ff
from fluidact_fit.export.c import write, write_code
from fluidact_fit.export.c.fixed import Fixed, fixed
from fluidact_fit.export.target import Arithmetic, Code, Job
from fluidact_fit.routines import Routine

GOLDEN = Path(__file__).parents[1] / "golden" / ff.__version__
STRICT = ("-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic", "-Wconversion")
REPORT = """
#include <avr/interrupt.h>
#include <avr/io.h>
#include <avr/sleep.h>
int selftest(void);
int main(void)
{
    const char result = (char)('0' + selftest());
    UCSR0B = 1 << TXEN0;
    while (!(UCSR0A & (1 << UDRE0)));
    UDR0 = (unsigned char)result;
    while (!(UCSR0A & (1 << UDRE0)));
    UDR0 = '!';
    while (!(UCSR0A & (1 << UDRE0)));
    UDR0 = '\\n';
    while (!(UCSR0A & (1 << UDRE0)));
    cli();
    sleep_enable();
    sleep_cpu();
    return 0;
}
"""


@pytest.fixture(params=ff.family_names())
def parameter_file(request: pytest.FixtureRequest) -> Path:
    """The parameter file of a family."""
    return GOLDEN / f"{request.param}.yaml"


@pytest.fixture
def edited(tmp_path: Path) -> Callable[..., Path]:
    """Writes a changed copy of a parameter file."""

    def make(
        family: str, change: Callable[[dict[str, Any]], object], name: str = "edited.yaml"
    ) -> Path:
        text = (GOLDEN / f"{family}.yaml").read_text(encoding="utf-8")
        document = copy.deepcopy(yaml.safe_load(text))
        change(document)
        path = tmp_path / name
        path.write_text(yaml.safe_dump(document, sort_keys=False), encoding="utf-8")
        return path

    return make


@pytest.fixture(autouse=True)
def _with_what_a_target_needs(request: pytest.FixtureRequest) -> None:
    """Skip the exports that compile where there is no compiler."""
    call = getattr(request.node, "callspec", None)
    if call is not None and call.params.get("to") == "fmu" and shutil.which("gcc") is None:
        pytest.skip("gcc is not installed")


def need(*programs: str) -> None:
    """Skip where a program is missing."""
    missing = [p for p in programs if shutil.which(p) is None]
    if missing:
        pytest.skip(f"needs {' and '.join(missing)}, which is not installed")


@dataclass(frozen=True)
class Export:
    """The three files of a block in a folder of their own."""

    folder: Path
    name: str
    arithmetic: Arithmetic
    block: Any

    def file(self, end: str) -> Path:
        return self.folder / f"{self.name}{end}"

    def compile(self, *flags: str, sources: tuple[str, ...] = (), to: str = "test") -> Path:
        need("gcc")
        names = sources or (f"{self.name}.c", f"{self.name}_selftest.c")
        command = ["gcc", *STRICT, *flags, *names, "-lm", "-o", to]
        done = subprocess.run(
            command, cwd=self.folder, capture_output=True, text=True, check=False, timeout=120
        )
        assert done.returncode == 0, done.stderr
        return self.folder / to

    def self_test(self, *flags: str) -> int:
        """Exit status of the self-test on this machine; what it says is nothing."""
        program = self.compile(*flags)
        done = subprocess.run([program], capture_output=True, text=True, check=False, timeout=60)
        assert done.stderr == ""
        return done.returncode

    def self_test_on_avr(self) -> str:
        """What the self-test returns on a simulated ATmega328P."""
        need("avr-gcc", "simavr")
        (self.folder / "report.c").write_text(REPORT)
        chip = ["avr-gcc", "-mmcu=atmega328p", "-O2", "-DF_CPU=16000000UL"]
        steps = (
            [*chip, *STRICT, "-c", f"{self.name}.c", "-o", "model.o"],
            [*chip, *STRICT, "-Dmain=selftest", "-c", f"{self.name}_selftest.c", "-o", "test.o"],
            [*chip, "report.c", "model.o", "test.o", "-lm", "-o", "test.elf"],
        )
        for step in steps:
            done = subprocess.run(
                step, cwd=self.folder, capture_output=True, text=True, check=False, timeout=120
            )
            assert done.returncode == 0, done.stderr
        run = subprocess.run(
            ["simavr", "-m", "atmega328p", "-f", "16000000", "test.elf"],
            cwd=self.folder, capture_output=True, text=True, check=False, timeout=300,
        )  # fmt: skip
        return next((w for w in (run.stdout + run.stderr).split() if "!" in w), "nothing")


Exporter = Callable[[str, Arithmetic], Export]


@pytest.fixture(scope="session")
def as_c(tmp_path_factory: pytest.TempPathFactory) -> Exporter:
    """Write a golden file as C, once for every arithmetic."""
    done: dict[tuple[str, str], Export] = {}

    def make(family: str, arithmetic: Arithmetic) -> Export:
        if (family, arithmetic) not in done:
            block: Any = ff.load(GOLDEN / f"{family}.yaml", accept_not_identified=True)
            if getattr(block, "sample_time", 1.0) == 0.0:
                block = block.with_sample_time(0.01)
            name = family.replace("-", "_")
            folder = tmp_path_factory.mktemp(f"{name}_{arithmetic}")
            for file, content in write(Job(name, block, arithmetic)).items():
                (folder / file).write_bytes(content)
            done[family, arithmetic] = Export(folder, name, arithmetic, block)
        return done[family, arithmetic]

    return make


@pytest.fixture
def written_as_c(tmp_path: Path) -> Callable[[Any, Arithmetic], Export]:
    """The files of a block that a test made."""

    def make(block: Any, arithmetic: Arithmetic) -> Export:
        for file, content in write(Job("map", block, arithmetic)).items():
            (tmp_path / file).write_bytes(content)
        return Export(tmp_path, "map", arithmetic, block)

    return make


@pytest.fixture
def compiled(tmp_path: Path) -> Callable[[Routine], Fixed]:
    """Fixed point of a routine made by hand, after its self-test has passed."""

    def make(routine: Routine) -> Fixed:
        code = Code("hand", "hand", "by hand", (routine,), "q15")
        for file, content in write_code(code).items():
            (tmp_path / file).write_bytes(content)
        flags = ("-O1", "-fsanitize=address,undefined", "-fno-sanitize-recover=all")
        assert Export(tmp_path, "hand", "q15", None).self_test(*flags) == 0
        found = fixed(routine, "hand")
        assert isinstance(found, Fixed)
        return found

    return make
