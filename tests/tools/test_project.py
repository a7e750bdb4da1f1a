"""What stands beside ``pyproject.toml`` and has to agree with it."""

from __future__ import annotations

import re
import subprocess
import tomllib
from pathlib import Path

import pytest
import yaml

import fluidact_fit as ff
import locked as locked_tools
import oldest

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
LOCK = tomllib.loads((ROOT / "uv.lock").read_text(encoding="utf-8"))
MAKEFILE = (ROOT / "Makefile").read_text(encoding="utf-8")


def locked(name: str) -> dict[str, object]:
    (package,) = (package for package in LOCK["package"] if package["name"] == name)
    return package


def normal(requirement: str) -> tuple[str, str]:
    name, specifier = re.fullmatch(r"([\w.-]+)(.*)", requirement).groups()
    return name.lower().replace("_", "-"), specifier


def test_lock_is_of_these_requirements() -> None:
    metadata = locked("fluidact-fit")["metadata"]
    held = {(entry["name"], entry["specifier"]) for entry in metadata["requires-dist"]}
    extras = [r for extra in PROJECT["project"]["optional-dependencies"].values() for r in extra]
    wanted = {*map(normal, [*PROJECT["project"]["dependencies"], *extras])}
    assert held == wanted, "run: make lock"
    for group, held in metadata["requires-dev"].items():
        wanted = {normal(r) for r in PROJECT["dependency-groups"][group] if isinstance(r, str)}
        assert wanted <= {(entry["name"], entry["specifier"]) for entry in held}, "run: make lock"


def test_lock_names_public_addresses_only() -> None:
    text = (ROOT / "uv.lock").read_text(encoding="utf-8")
    hosts = {*re.findall(r'"((?:https?|file)://[^/"]*)', text)}
    assert hosts == {"https://pypi.org", "https://files.pythonhosted.org"}


def test_oldest_pins_every_dependency() -> None:
    pins = oldest.oldest(PROJECT["project"]["dependencies"])
    assert len(pins) == len(PROJECT["project"]["dependencies"])
    assert oldest.oldest(["numpy>=1.26"]) == ["numpy==1.26"]
    with pytest.raises(ValueError, match="name>=version"):
        oldest.oldest(["numpy~=1.26"])


def test_tools_of_developers_are_pinned() -> None:
    pins = dict(pin.split("==") for pin in locked_tools.locked(LOCK))
    groups = PROJECT["dependency-groups"].values()
    wanted = {normal(r)[0] for group in groups for r in group if isinstance(r, str)}
    assert wanted == {*pins}
    assert all(re.fullmatch(r"[0-9][0-9a-z.]*", version) for version in pins.values())
    environments, unpinned = MAKEFILE.count("--group "), 1  # test-matrix takes the newest
    pinned = sum(MAKEFILE.count(f"tools/{name}.py >") for name in ("locked", "oldest"))
    assert pinned == environments - unpinned == 2


def test_oldest_environment_pins_extras_too_and_nothing_twice(
    capsys: pytest.CaptureFixture[str],
) -> None:
    oldest.main()
    pins = capsys.readouterr().out.split()
    names = [normal(oldest.name_of(pin))[0] for pin in pins]
    assert len(set(names)) == len(names)
    extras = PROJECT["project"]["optional-dependencies"].values()
    assert {p.replace(">=", "==") for e in extras for p in e} <= {*pins}


def test_help_names_every_target() -> None:
    (phony,) = re.findall(r"^\.PHONY: (.*)$", MAKEFILE, re.MULTILINE)
    done = subprocess.run(["make", "help"], cwd=ROOT, capture_output=True, text=True, check=True)
    named = {*re.findall(r"^make (\S+)", done.stdout, re.MULTILINE)}
    assert named == {*phony.split()} - {"help"}


HOSTED = [*(f".github/workflows/{n}.yml" for n in ("test", "release")), ".pre-commit-config.yaml"]


@pytest.mark.parametrize("path", HOSTED)
def test_hosted_checks_call_make(path: str) -> None:
    text = (ROOT / path).read_text(encoding="utf-8")
    assert yaml.safe_load(text)
    targets = {*re.findall(r"\bmake ([\w-]+)", text)}
    assert targets <= {*re.findall(r"^([\w-]+):", MAKEFILE, re.MULTILINE)}
    assert targets


def test_version_and_dependencies_are_the_same_everywhere() -> None:
    recipe = (ROOT / "packaging" / "conda" / "recipe.yaml").read_text(encoding="utf-8")
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert citation["version"] == ff.__version__
    assert f'version: "{ff.__version__}"' in recipe
    run = {
        d.replace("matplotlib-base", "matplotlib")
        for d in yaml.safe_load(recipe)["requirements"]["run"]
    }
    wanted = {re.sub(r"(?=>=)", " ", d) for d in PROJECT["project"]["dependencies"]}
    assert run == {*wanted, f"python {PROJECT['project']['requires-python']}"}


def test_addresses_agree() -> None:
    source = PROJECT["project"]["urls"]["Source"]
    for path in ("CITATION.cff", "packaging/conda/recipe.yaml"):
        assert source in (ROOT / path).read_text(encoding="utf-8"), path
