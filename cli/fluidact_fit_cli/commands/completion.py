"""``fluidact-fit completion``."""

from __future__ import annotations

import click

from ..completion import SCRIPTS
from ..options import DEBUG, Command
from ..show import echo_result


@click.command(
    "completion",
    cls=Command,
    params=[click.Argument(["shell"], type=click.Choice(list(SCRIPTS))), DEBUG],
)
def command(shell: str) -> None:
    """Print the script that lets SHELL complete families, options, roles and headers.

    \b
    bash        eval "$(fluidact-fit completion bash)" in ~/.bashrc
    zsh         eval "$(fluidact-fit completion zsh)" in ~/.zshrc, after compinit
    fish        fluidact-fit completion fish > ~/.config/fish/completions/fluidact-fit.fish
    powershell  fluidact-fit completion powershell | Out-String | Invoke-Expression
                in the file that $PROFILE names

    Behind --column ROLE= the headers of the first log on the line are offered.
    """
    echo_result(SCRIPTS[shell])
