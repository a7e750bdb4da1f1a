"""``fluidact-fit compare --structures FAMILY LOG...``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import click

from .. import options
from ..errors import Invocation
from ..family_help import chosen_options, family_options
from ..outputs import refuse_twice
from ..progress import Progress
from ..show import echo, echo_json, echo_table, echo_text, format_number
from .fit_family import PARAMETERS

if TYPE_CHECKING:
    from fluidact_fit.family import Family, FamilyOptions
    from fluidact_fit.structures import StructureComparison, StructureFit

# Words of this command that a fit does not have.
_FLAGS = dict.fromkeys(("--json", "--quiet", "-q", "--verbose", "-v", "--debug"), False)


def family_params(family: Family[FamilyOptions]) -> list[click.Parameter]:
    """Options of the family's fit that hold for every structure."""
    return [*family_options(family), *PARAMETERS]


def run(
    name: str,
    files: Sequence[str],
    as_json: bool,
    params: Mapping[str, Any],
    invocation: Invocation | None,
) -> None:
    """Fit and judge the structures, and show the table with the command to run next."""
    from fluidact_fit.structures import compare_structures

    refuse_twice(files)
    with Progress(params["quiet"], params["verbose"]) as progress:
        progress("reading")
        found = compare_structures(
            name, options.read_logs(files, params), fixed=params["fix"], start=params["start"],
            bounds=params["bounds"], noise=params["noise"], progress=progress,
            **chosen_options(params),
        )  # fmt: skip
    invocation = invocation or Invocation(("compare", "--structures", name, *files))
    commands = next_commands(found, invocation, params["fix"])
    if as_json:
        echo_json({**found.to_dict(), "command": commands.get(found.recommended or "", ""),
                   "commands": commands})  # fmt: skip
    elif not params["quiet"]:
        _show(found, commands)


def next_commands(
    found: StructureComparison, invocation: Invocation, fixed: Mapping[str, float]
) -> dict[str, str]:
    """Structures to fit next, each with its command as a shell takes it.

    That is the recommended one, or the two between which the judges disagree. What the user has
    ``fixed`` stands among the words already.
    """
    names = (found.recommended,) if found.recommended else found.preferred
    return {
        one.name: _command(found.family, one, invocation, fixed, apart=len(names) > 1)
        for one in found.structures if one.name in names
    }  # fmt: skip


def _command(
    family: str, one: StructureFit, invocation: Invocation, fixed: Mapping[str, float], *,
    apart: bool,
) -> str:  # fmt: skip
    """The command that fits one structure, into a file of its own where it stands ``apart``."""
    from fluidact_fit.files import shell_command

    chosen = dict.fromkeys(("--structures", *(o for o, _ in one.settings)), True)
    kept = options.typed_words(invocation, "compare", {**_FLAGS, **chosen})
    selected = [w for setting in one.settings for w in setting]
    held = [w for name, value in one.fixed.items() if name not in fixed
            for w in ("--fix", f"{name}={value!r}")]  # fmt: skip
    own = "-" + "-".join(one.name.replace(",", "").split()) if apart else ""
    return shell_command(["fluidact-fit", family, *kept, *selected, *held,
                          "-o", f"{family}{own}.yaml"])  # fmt: skip


def _show(found: StructureComparison, commands: Mapping[str, str]) -> None:
    head = ["structure", "k", "fit", "held out", "verdict", "ΔBIC"]
    echo_table([head, *map(_row, found.structures)], right=(1, 2, 3, 5))
    for one in found.structures:
        if one.reason:
            echo_text(f"{one.name}: {one.reason}")
    reference = found.recommended or next(iter(found.preferred), None)
    if reference is None:
        echo("\nall structures were refused")
        return
    echo()
    echo_text(
        f"k: estimated parameters; ΔBIC: relative to the lowest, on all {found.samples} samples"
    )
    if found.held_out:
        echo_text(f"held out: {found.held_out}, predicted by a fit to the rest")
    moved = [(one, m) for one in found.structures for m in one.moved]
    if moved:
        echo()
        head = ["structure", "parameter", "value", "reference", "unit", "std errors"]
        rows = [
            [one.name, m.name, format_number(m.value, m.std_error),
             format_number(m.recommended, m.std_error), m.unit, f"{m.deviation:+.1f}"]
            for one, m in moved
        ]  # fmt: skip
        echo_table([head, *rows], right=(2, 3, 5))
        echo_text(f"listed are differences of more than 2 standard errors from '{reference}'")
    echo()
    if found.recommended is None:
        by_criterion, by_held_out = found.preferred
        echo_text(
            f"no recommendation: the criterion is lowest for '{by_criterion}', but '{by_held_out}' "
            "predicts the held-out logs better. Something lasts in the residuals that none of them "
            "describes: fit both, look at the pictures (--plot) and at the warnings."
        )
    for name, command in commands.items():
        echo(f"{'recommended: ' if found.recommended else ''}{name}\n  {command}")


def _row(one: StructureFit) -> list[str]:
    from fluidact_fit.tables import percent_text

    if one.bic_difference is None:
        return [one.name, "-", "-", "-", "REFUSED", "-"]
    return [
        one.name, str(one.parameters), percent_text(one.fit_percent),
        percent_text(one.held_out_percent), one.verdict.upper(), f"{one.bic_difference:.1f}",
    ]  # fmt: skip
