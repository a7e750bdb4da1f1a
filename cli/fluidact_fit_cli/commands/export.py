"""``fluidact-fit export``."""

from __future__ import annotations

from typing import Any

import click

from ..messages import echo_notices, tell_message
from ..options import FORCE, VERBOSITY, Command, Option, flag
from ..outputs import check_folder, note_written
from ..show import echo

_ACCEPTED = "Overriding safety checks"


@click.command(
    "export",
    cls=Command,
    params=[
        click.Argument(["params_files"], metavar="PARAMS...", nargs=-1, required=True),
        Option(["--to"], metavar="c|st|ros2|matlab|fmu|json", required=True, group="Output",
               help="Language or format."),
        Option(["--output", "-o", "folder"], metavar="FOLDER", default=".", group="Output",
               help="Folder for the files (default: here); created if it does not exist."),
        FORCE,
        Option(["--arithmetic"], type=click.Choice(["float32", "q15"]), group="Output",
               help="Floating point, or 16-bit fixed point for static maps, of the languages "
               "that know both (default: float32)."),
        Option(["--controller"], metavar="FILE", group="Output",
               help="A controller file: with --to c, st or ros2 it is exported instead, for the "
               "machine that PARAMS together describe."),
        flag("--accept-failed", group=_ACCEPTED,
             help="Export a file whose verdict is FAIL; the export says so."),
        Option(["--accept-not-identified", "accepted"], metavar="NAME|all", multiple=True,
               group=_ACCEPTED, help="Export the value of a parameter that the data could not "
               "determine; the export says so. Repeatable."),
        *VERBOSITY,
    ],
)  # fmt: skip
def command(
    params_files: tuple[str, ...], to: str, folder: str, accepted: tuple[str, ...], **params: Any
) -> None:
    """Export code or configuration for a controller from the parameter files PARAMS.

    \b
    c       NAME.h, NAME.c: what a controller calls; NAME_selftest.c
    st      NAME.st: constants and function blocks for TwinCAT, with a self-test
    ros2    NAME.ros2.yaml, NAME.declaration.yaml (for generate_parameter_library),
            NAME.metadata.yaml
    matlab  NAME.m: a function that makes the model; NAME.mat: the numbers
    fmu     NAME.fmu: a unit for FMI 2.0 co-simulation, for Linux on x86-64
    json    NAME.json: the whole document

    NAME is the name of the parameter file; functions and variables are called by it as an
    identifier: ball-screw.yaml as ball_screw, and so are the files for MATLAB. The files of one
    parameter file are written all or none; their names go to standard
    output, one per line. Where a language cannot hold one of several files, the others are written
    and the exit status is 2.

    \b
    Examples:
      fluidact-fit export valve.yaml --to matlab -o controller
      fluidact-fit export *.yaml --to ros2 -o config -f
      fluidact-fit export line.yaml --controller pd.yaml --to c -o firmware
    """
    from fluidact_fit.export import NotExportedError, export, renamed

    check_folder(folder)
    controller = params["controller"]
    try:
        written = export(
            params_files, to, folder,
            overwrite=params["force"], arithmetic=params["arithmetic"],
            accept_failed=params["accept_failed"],
            accept_not_identified=True if "all" in accepted else accepted,
            controller=controller,
        )  # fmt: skip
        failed = None
    except NotExportedError as error:
        written, failed = error.written, error
    note_written(map(str, written))
    if not params["quiet"]:
        for path in written:
            echo(str(path))
        for file in [controller] if controller else params_files:
            if note := renamed(file):
                tell_message("note", note)
        echo_notices(written.notices)
    if failed is not None:
        raise failed
