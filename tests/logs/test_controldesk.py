"""ControlDesk recordings: their header, names that repeat, and signals of several rasters."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from fluidact_fit import fit
from fluidact_fit.errors import LogError
from fluidact_fit.families import get_family
from fluidact_fit.logs import experiments, read_log

HEADER = """descriptions,Measurement,Name,"Recording 1
 on two lines"
,Measurement,Author,{author}
,Recording,Samples,3

trace_size,{rows}
trace_types,double,double,double,double
trace_names,,In1,In1,pressure,slow
trace_units,,V,,bar,
raster,,10ms,10ms,10ms,100ms
path,,Model Root/Valve/In1,Model Root/Place/In1,Model Root/p/Out1,Model Root/T/Out1
flags,,1,1,1,1
min,,-1.797693135e+308,0,0,0
max,,1.797693135e+308,0,0,0
"""


def recording(rows: list[str], author: str = "nobody") -> str:
    return HEADER.format(rows=len(rows), author=author) + "trace_values" + "\n".join(rows) + "\n"


ROWS = [f",{0.01 * k:.6f},{k % 5},{k % 7}.5,2.{k % 10},{'' if k % 10 else 20.5}" for k in range(50)]


@pytest.mark.parametrize(
    ("author", "encoding"),
    [("nobody", "utf-8"), ("M\u00fcller", "cp1252"), ("\uae40\ucca0\uc218", "cp949")],
)
def test_a_recording_is_read(tmp_path: Path, author: str, encoding: str) -> None:
    path = tmp_path / "rec.csv"
    path.write_bytes(recording(ROWS, author).encode(encoding))
    log = read_log(path)
    assert (log.dialect.name, log.dialect.encoding) == ("dSPACE ControlDesk", encoding)
    names = ["time", "Valve/In1", "Place/In1", "pressure", "slow"]
    assert [c.header for c in log.columns] == names
    assert [c.unit for c in log.columns] == ["s", "V", None, "bar", None]
    assert (log.rows, log.account.header_lines, log.account.left_out) == (50, 14, ())
    assert log.columns[2].values[:3].tolist() == [0.5, 1.5, 2.5]
    assert log.columns[4].sparse
    assert np.isfinite(log.columns[4].values).sum() == 5


def test_a_hole_in_a_signal_of_text_is_no_sample(tmp_path: Path) -> None:
    path = tmp_path / "rec.csv"
    rows = [*ROWS[:7], ",0.070000,oops,1.5,2.1,", *ROWS[8:]]
    path.write_text(recording(rows))
    assert read_log(path).columns[1].bad == {7: "oops"}


def test_names_are_needed(tmp_path: Path) -> None:
    path = tmp_path / "rec.csv"
    path.write_text(recording(ROWS).replace("trace_names,,In1,In1,pressure,slow\n", ""))
    with pytest.raises(LogError, match="trace_names"):
        read_log(path)


def answer(t: np.ndarray, edges: np.ndarray, levels: np.ndarray) -> np.ndarray:
    """Critically damped answer of 20 rad/s to steps, by superposition."""
    y = np.full(t.size, levels[0])
    for at, change in zip(edges, np.diff(levels)):
        late = np.maximum(t - at, 0.0) * 20.0
        y += change * (1.0 - (1.0 + late) * np.exp(-late))
    return y


def test_every_signal_is_used_at_its_own_instants(tmp_path: Path) -> None:
    """A command every 10 ms and an outlet every 7 ms, never in one row but every 70 ms."""
    edges, rng = np.arange(0.5, 20.0, 0.5), np.random.default_rng(3)
    levels = 1.0 + 2.0 * (np.arange(edges.size + 1) % 2)
    rows = []
    t = np.arange(20_000) / 1000.0
    y = answer(t, edges, levels) + 0.01 * rng.standard_normal(t.size)
    u = levels[np.searchsorted(edges, t, side="right")]
    for k in range(t.size):
        if k % 10 == 0 or k % 7 == 0:
            command = f"{u[k]}" if k % 10 == 0 else ""
            outlet = f"{y[k]:.5f}" if k % 7 == 0 else ""
            rows.append(f",{t[k]:.3f},{command},,{outlet},")
    path = tmp_path / "rec.csv"
    path.write_text(recording(rows))
    bound = {"command": "Valve/In1", "outlet": "pressure"}
    log = read_log(path, columns=bound)
    (run,), notices = experiments(log, get_family("valve").variants[0])
    assert run.sample_time == pytest.approx(0.007)
    assert run.signals["command"].time[1] == pytest.approx(0.01)
    assert "time-bases" in [n.code for n in notices]
    found = fit("valve", log).parameters
    for name, truth in {"natural_frequency": 20.0, "damping_ratio": 1.0, "gain": 1e5}.items():
        assert abs(found[name].value - truth) < 4.0 * found[name].std_error, name
    assert found["natural_frequency"].std_error < 0.05
