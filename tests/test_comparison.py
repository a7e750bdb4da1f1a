"""Parameter files and logs beside each other."""

from __future__ import annotations

import re
from math import hypot
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.stats import kstest

import fluidact_fit as ff
from fluidact_fit.comparison import (
    Comparison,
    Recordings,
    compare_documents,
    compare_recordings,
)
from fluidact_fit.demo import load_dataset
from fluidact_fit.errors import UsageError
from fluidact_fit.parameters.draws import with_values

DATA = Path(__file__).parents[1] / "datasets"
COLUMNS = {"time": "#1", "command": "#2", "outlet": "#3"}
NAMES = ("gain", "natural_frequency", "damping_ratio")


def fit(log: str) -> Any:
    return ff.fit("valve", DATA / "valve" / log, columns=COLUMNS).document


@pytest.fixture(scope="module")
def files() -> list[tuple[str, Any]]:
    return [(f"v{k}.yaml", fit(f"trial{k}.csv")) for k in (1, 2)]


def test_a_difference_is_in_standard_errors_of_the_difference(files: Any) -> None:
    found = compare_documents(files)
    one, two = (d.parameters["gain"] for _, d in files)
    gain = next(p for p in found.parameters if p.name == "gain")
    wanted = (two.value - one.value) / hypot(one.std_error, two.std_error)
    assert gain.deviations == (None, pytest.approx(wanted))
    fixed = next(p for p in found.parameters if p.name == "dead_time")
    assert fixed.deviations == (None, None)
    assert not found.together[0].shared_logs
    assert found.together[0].degrees == 3


def test_chance_alone_gives_every_probability_alike(files: Any) -> None:
    name, document = files[0]
    rng, order = np.random.default_rng(4), list(document.covariance.order)
    mean = np.array([document.parameters[n].value for n in order])
    found = []
    for _ in range(300):
        drawn = rng.multivariate_normal(mean, np.array(document.covariance.matrix), size=2)
        pair = [(name, with_values(document, dict(zip(order, d)))) for d in drawn]
        found.append(compare_documents(pair).together[0].p_value)
    assert kstest(found, "uniform").pvalue > 1e-3


def test_parameters_may_each_agree_and_not_together(files: Any) -> None:
    """Along the short axis of two numbers that their data hardly tell apart."""
    name, document = files[0]
    order, c = list(document.covariance.order), np.array(document.covariance.matrix)
    scale = np.sqrt(np.diag(c))
    values, vectors = np.linalg.eigh(c / np.outer(scale, scale))
    step = 6.0 * np.sqrt(2.0 * values[0]) * vectors[:, 0] * scale
    moved = {n: document.parameters[n].value + by for n, by in zip(order, step)}
    found = compare_documents([(name, document), ("moved", with_values(document, moved))])
    assert found.together[0].statistic == pytest.approx(36.0)
    assert found.together[0].differs
    assert max(abs(p.deviations[1] or 0.0) for p in found.parameters) < 6.0
    assert found.together[0].shared_logs == ("trial1.csv",)
    assert "differs by more than chance" in found.together[0].words


def test_what_cannot_be_compared_is_refused(files: Any) -> None:
    line = ff.fit("line", DATA / "line/trial1.csv",
                  columns={"time": "#1", "inlet": "#2", "outlet": "#3"}).document  # fmt: skip
    with pytest.raises(UsageError, match="line"):
        compare_documents([files[0], ("line.yaml", line)])
    with pytest.raises(UsageError, match="nothing to compare"):
        compare_documents(files[:1])


def test_logs_differ_in_columns_units_ranges_and_sampling(tmp_path: Path) -> None:
    t = np.arange(100) * 0.01
    head = {"a": "t [s],u [V],p [bar]", "b": "t [s],u [mV],q [bar]", "c": "t [s],u [V],p [bar]"}
    for name, header in head.items():
        time, size = (2.0 * t[:-1], 10.0) if name == "c" else (t, 1.0)
        rows = [f"{a:.2f},{size * np.sin(9.0 * a):.4f},{a:.3f}" for a in time]
        (tmp_path / f"{name}.csv").write_text("\n".join([header, *rows]), encoding="utf-8")
    logs = [(n, ff.read_log(tmp_path / f"{n}.csv")) for n in (*head, "a")]
    found = compare_recordings(logs).findings
    for words in ("b has no column 'p'", "b has a column 'q'", "'u' is in mV in b, in V in a",
                  "'u' covers 19.99 V in c, 1.999 V in a",
                  "c was sampled every 0.02 s, a every 0.01 s",
                  "c has 99 rows, a has 100",
                  "a and a are the same to the byte"):  # fmt: skip
        assert any(words in f for f in found), (words, found)
    assert len(found) == 7


def test_a_range_apart_from_the_other_is_named_by_the_header_of_the_log() -> None:
    t = np.arange(100) * 0.01
    tables = [{"t [s]": t, "P1 [bar]": np.sin(9.0 * t) + level} for level in (0.0, 5.0)]
    found = compare_recordings([(f"log{k}", ff.read_log(x)) for k, x in enumerate(tables)])
    (apart,) = found.findings
    assert re.fullmatch(r"'P1' is 4\S* … [56]\S* bar in log1, -\S+ … \S+ bar in log0", apart)
    assert "P1" in [row[0] for row in found.table().rows]


def test_results_models_and_files_are_compared_alike(tmp_path: Path) -> None:
    data = load_dataset("line")
    result = ff.fit("line", data.read(), **data.options)
    path = result.save(tmp_path / "line.yaml")
    found = ff.compare(result, ff.load(path), path)
    assert isinstance(found, Comparison)
    assert found.files == ("#1", "#2", str(path))
    assert {d for p in found.parameters for d in p.deviations if d is not None} == {0.0}
    for text in (found.summary(), found._repr_html_()):
        assert "time_constant" in text
        assert "does not differ beyond chance" in text
    logs = ff.compare(*data.logs)
    assert isinstance(logs, Recordings)
    assert logs.conclusions[0] in logs.summary()


def test_a_list_is_as_good_as_one_by_one() -> None:
    logs = [DATA / "valve" / f"trial{k}.csv" for k in (1, 2)]
    assert ff.compare(logs) == ff.compare(*logs)


def test_parameters_are_not_compared_with_logs(tmp_path: Path) -> None:
    path = Path(__file__).parent / "golden" / ff.__version__ / "line.yaml"
    with pytest.raises(ff.UsageError, match="cannot be compared with each other"):
        ff.compare(path, {"time": np.arange(9.0)})
    with pytest.raises(ff.UsageError, match="units is about logs"):
        ff.compare(path, path, units={"inlet": "bar"})
