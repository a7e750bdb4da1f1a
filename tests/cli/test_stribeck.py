"""``ball-screw --stribeck estimate``: from a log that shows it to the code of a controller."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from drive_reference import drive_log


def test_friction_that_falls_is_asked_for_fitted_and_exported(
    apart: Callable[..., Any], inside: Path
) -> None:
    """Every command in a process of its own."""
    log = Path("drive.csv")
    run = drive_log(1, "foh")
    np.savetxt(log, np.column_stack((run.time, run["torque"], run["angle"])), delimiter=",",
               header="time [s],torque [N m],angle [rad]", comments="", fmt="%.9g")  # fmt: skip
    plain = apart("ball-screw", log.name, "--hold", "torque=foh", "-o", "plain.yaml", cwd=inside)
    assert plain.status == 0
    assert "--stribeck=estimate" in plain.err
    done = apart("ball-screw", log.name, "--hold", "torque=foh", "--stribeck", "estimate",
                 "-o", "drive.yaml", cwd=inside)  # fmt: skip
    assert done.status == 0, done.err
    assert done.err.count("warning") == 0, done.err
    speed = yaml.safe_load((inside / "drive.yaml").read_text())["parameters"]["stribeck_speed"]
    assert speed["status"] == "estimated"
    assert speed["unit"] == "rad/s"
    assert abs(speed["value"] - 4.0) < 4.0 * speed["std_error"]
    assert apart("check", "drive.yaml", log.name, cwd=inside).status == 0
    assert apart("export", "drive.yaml", "--to", "c", "-o", "c", cwd=inside).status == 0
    assert "expf(" in (inside / "c" / "drive.c").read_text()
    refused = apart("export", "drive.yaml", "--to", "fmu", "-o", "fmu", cwd=inside)
    assert refused.status == 2
    assert "falls with the speed" in refused.err
    assert not (inside / "fmu").exists()
