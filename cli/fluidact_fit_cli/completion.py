"""Completion of a partly typed command, and the shell scripts that ask for it.

Every shell asks alike: it runs the program with ``VARIABLE`` set to its name and the line so far in
``COMP_LINE``, and reads a value, a tab and a description a line.
"""

from __future__ import annotations

import os
import shlex
from collections.abc import Iterator
from typing import TYPE_CHECKING

import click
from click.shell_completion import CompletionItem, ShellComplete

from fluidact_fit.families import family_names, family_title, get_family

if TYPE_CHECKING:
    from fluidact_fit.specification import Variant

VARIABLE = "_FLUIDACT_FIT_COMPLETE"

_BASH = """\
_fluidact_fit() {
    local line
    COMPREPLY=()
    while IFS= read -r line; do
        COMPREPLY+=("${line%%$'\\t'*}")
    done < <(COMP_LINE="${COMP_LINE:0:COMP_POINT}" VARIABLE=bash "$1")
    [[ ${COMPREPLY[0]} == *= ]] && compopt -o nospace
    return 0
}
complete -o bashdefault -o default -F _fluidact_fit fluidact-fit
"""
_ZSH = """\
#compdef fluidact-fit
_fluidact_fit() {
    local line suffix=' '
    local -a values shown
    for line in "${(@f)$(COMP_LINE="${(j: :)words[1,CURRENT]}" VARIABLE=zsh ${words[1]})}"; do
        [[ -n $line ]] || continue
        values+=("${line%%$'\\t'*}")
        shown+=("${line/$'\\t'/  -- }")
    done
    (( $#values )) || { _files; return }
    [[ ${values[1]} == *= ]] && suffix=''
    compadd -S "$suffix" -l -d shown -a values
}
if [[ $zsh_eval_context[-1] == loadautofunc ]]; then
    _fluidact_fit "$@"
else
    compdef _fluidact_fit fluidact-fit
fi
"""
_FISH = """\
function __fluidact_fit
    env COMP_LINE=(commandline -cp | string collect) VARIABLE=fish fluidact-fit
end
complete --command fluidact-fit --arguments "(__fluidact_fit)"
"""
_POWERSHELL = """\
Register-ArgumentCompleter -Native -CommandName fluidact-fit -ScriptBlock {
    param($word, $ast, $cursor)
    $length = $cursor - $ast.Extent.StartOffset
    $env:COMP_LINE = $ast.ToString().PadRight($length).Substring(0, $length)
    $env:VARIABLE = 'powershell'
    try { $lines = & fluidact-fit } finally { Remove-Item Env:COMP_LINE, Env:VARIABLE }
    foreach ($line in $lines) {
        $value, $help = $line -split "`t", 2
        if (-not $help) { $help = $value }
        [System.Management.Automation.CompletionResult]::new(
                $value, $value, 'ParameterValue', $help)
    }
}
"""
SCRIPTS = {
    shell: script.replace("VARIABLE", VARIABLE)
    for shell, script in {
        "bash": _BASH, "zsh": _ZSH, "fish": _FISH, "powershell": _POWERSHELL,
    }.items()
}  # fmt: skip
_BY_ROLE = ("column", "unit", "scale", "hold", "step", "set", "noise", "unwrap", "from_name")
_BY_NAME = ("fix", "start", "bounds")


def complete(program: click.Group, shell: str) -> None:
    """Print what fits at the end of ``COMP_LINE``; nothing where anything is wrong with it."""
    line = os.environ.get("COMP_LINE", "")
    try:
        words, incomplete, tail = _split(line, shell)
        option = incomplete[: incomplete.find("=") + 1] if incomplete.startswith("--") else ""
        *before, asked = [*words[1:], incomplete]
        if before and before[-1].startswith("--"):  # which would keep click from the arguments
            asked = f"{before.pop()}={asked}"
        items = ShellComplete(program, {}, "fluidact-fit", VARIABLE).get_completions(before, asked)
        values = [(option + item.value if option else item.value, item.help) for item in items]
    except Exception:  # a traceback among the words of the user helps nobody
        return
    for value, help_text in values:
        if value.isprintable():
            shown = _as_typed(value, incomplete, tail, shell)
            click.echo(f"{shown}\t{' '.join((help_text or '').split())}")


def _split(line: str, shell: str) -> tuple[list[str], str, str | None]:
    """Complete words, the incomplete one, and what of it stands behind an open quote."""
    lexer = shlex.shlex(line, posix=True)
    lexer.whitespace_split, lexer.commenters = True, ""
    if shell == "powershell":
        lexer.escape = ""  # a backslash is part of a path
    words: list[str] = []
    tail = None
    try:
        words.extend(lexer)
    except ValueError:  # an open quote
        words.append(lexer.token)
        tail = line.rpartition(getattr(lexer, "state", None) or "'")[2]
    else:
        if not line or line[-1].isspace():
            words.append("")
    return words[:-1], words[-1], tail


def _as_typed(value: str, incomplete: str, tail: str | None, shell: str) -> str:
    """A value as the shell has to have it; bash replaces only what stands behind ``=``."""
    if shell == "powershell":
        plain = all(c.isalnum() or c in "-_=.:/\\" for c in value)
        return value if plain else "'" + value.replace("'", "''") + "'"
    if shell != "bash":
        return value
    if tail is not None:
        return value.removeprefix(incomplete.removesuffix(tail))
    return shlex.quote(value.removeprefix(incomplete[: incomplete.rfind("=") + 1]))


def values_of(option: str, ctx: click.Context, incomplete: str) -> list[CompletionItem[str]]:
    """Complete an option ``KEY=VALUE``: roles or parameters, then headers or holds."""
    key, equals, _ = incomplete.partition("=")
    if option in _BY_ROLE and not equals:
        found = [(f"{role.name}=", role.description) for v in _variants(ctx) for role in v.roles]
    elif option in _BY_NAME and not equals:
        found = [(f"{p.name}=", p.description) for v in _variants(ctx) for p in v.parameters]
    elif option == "column":
        found = [(f"{key}={header}", "") for header in _headers(ctx)]
    elif option == "hold":
        found = [(f"{key}={hold}", "") for hold in ("zoh", "foh", "smooth", "auto")]
    elif option == "family":
        found = [(name, family_title(name)) for name in family_names()]
    else:
        return []
    return [CompletionItem(value, help=text) for value, text in dict(found).items()
            if value.startswith(incomplete)]  # fmt: skip


def _variants(ctx: click.Context) -> Iterator[Variant]:
    for name in (ctx.info_name, ctx.params.get("family")):
        if name in family_names():
            yield from get_family(str(name)).variants


def _headers(ctx: click.Context) -> list[str]:
    """Names of the columns of the first log on the line."""
    from fluidact_fit.logs import read_log

    logs = ctx.params.get("logs") or ()
    if not logs or not os.path.isfile(logs[0]):  # not standard input, which would wait
        return []
    return [column.name for column in read_log(logs[0]).columns if column.name]
