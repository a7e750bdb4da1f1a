"""Figures and the HTML page."""

from __future__ import annotations

import hashlib
import re
import subprocess
import sys
from base64 import b64encode
from collections.abc import Callable
from dataclasses import replace
from html import escape
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import fluidact_fit as ff
from fluidact_fit.demo import load_dataset
from fluidact_fit.errors import Notice, OutputError, UsageError
from fluidact_fit.experiment import Experiment, Signal
from fluidact_fit.families import get_family
from fluidact_fit.family import Curve, NoiseModel, Quantity, StaticView, make_solution
from fluidact_fit.outcome import Simulation
from fluidact_fit.report import (
    plot_result,
    plot_validation,
    save_figure,
    write_document_html,
    write_html,
)
from fluidact_fit.report.numbers import (
    choose_scale,
    percent,
    plain,
    pretty_unit,
    scaled,
    short,
    show,
)
from fluidact_fit.report.page import result_page
from fluidact_fit.report.panels import correlation
from fluidact_fit.report.reading import picture
from fluidact_fit.report.responses import responses_picture
from fluidact_fit.report.runs import envelope
from fluidact_fit.result import FitResult

ROOT = Path(__file__).parents[2]
EVIL = '<script>alert(1)</script>&"$x_1$\u4e2d.csv'


def make(
    samples: int = 300,
    runs: int = 1,
    *,
    spans: Callable[[int], float] = lambda k: 3.0,
    validation: bool = False,
    name: str = "run",
    verdict: str = "pass",
) -> FitResult:
    """A result of a line made without a fit."""
    rng = np.random.default_rng(0)
    variant = get_family("line").variants[0]
    fitted = []
    for k in range(runs):
        t = np.linspace(0.0, spans(k), samples)
        u = 4e5 * (np.sin(3.0 * t) > 0.0)
        model = 4e5 * (1.0 - np.exp(-t / 0.4))
        y = model + 2e3 * (k + 1) * rng.standard_normal(samples)
        signals = {
            "inlet": Signal("inlet", t, u, "Pa", "zoh"),
            "outlet": Signal("outlet", t, y, "Pa"),
        }
        run = Experiment(f"{name}{k}", k, t, signals, t[1], True)
        fitted.append(Simulation(run, model, y))
    parameters = {
        "gain": Quantity(1.0, "1", "estimated", 0.01, [0.98, 1.02]),
        "time_constant": Quantity(0.4, "s", "estimated", 0.002, [0.396, 0.404]),
        "dead_time": Quantity(0.0, "s", "not_identified"),
    }
    covariance = np.array([[1e-4, -1e-5], [-1e-5, 4e-6]])
    family = get_family("line")
    options = family.options_type()
    logs = [s.experiment for s in fitted]
    noise, names = NoiseModel(covariance), ("gain", "time_constant")
    estimate = make_solution(family.simulate, logs, variant, options, parameters, names, noise)
    document = {
        "format": "fluidact-parameters",
        "format_version": 1,
        "family": "line",
        "variant": "line",
        "parameters": parameters,
        "covariance": {"order": ["gain", "time_constant"], "matrix": covariance},
        "model": family.model(estimate.plant, 0.01, "zoh"),
        "validity": {"inlet": {"low": 0.0, "high": 4e5, "unit": "Pa"}},
        "fit": {
            "samples": samples * runs,
            "rmse": {"value": 2e3, "unit": "Pa"},
            "fit_percent": 98.5,
            "residual_whiteness": {"statistic": 20.0, "p_value": 0.4, "lags": 20},
            "verdict": verdict,
            "logs": [
                {"file": s.experiment.name, "samples": samples, "fit_percent": 98.0} for s in fitted
            ],
        },
        "warnings": [{"code": "not-identified", "message": f"{EVIL} -> do <this>."}],
        "provenance": {
            "tool": {"name": "fluidact-fit", "version": "0.1.0"},
            "created": "2026-11-20T22:00:00Z",
            "command": f"fluidact-fit line '{EVIL}'",
            "logs": [
                {
                    "file": EVIL,
                    "sha256": "0" * 64,
                    "rows": samples,
                    "columns": {"inlet": {"header": "<b>p</b>", "unit": "Pa"}},
                }
            ],
        },
    }
    from fluidact_fit.parameters import make_document

    judged = fitted[:1] if validation else []
    made = make_document(document, get_family)
    return FitResult("line", variant, estimate, fitted, judged, made, (), None)


def texts(figure: Any) -> str:
    from matplotlib.text import Text

    return "\n".join(t.get_text() for t in figure.findobj(Text))


@pytest.mark.parametrize(
    ("runs", "kind"), [(1, "png"), (2, "svg"), (3, "pdf"), (12, "png"), (90, "svg")]
)
def test_every_number_of_runs_is_drawn_and_said(runs: int, kind: str, tmp_path: Path) -> None:
    figure = plot_result(make(60, runs))
    path = save_figure(figure, tmp_path / f"fit.{kind}")
    assert path.stat().st_size > 5000
    found = texts(figure)
    assert "PASS" in found
    assert "98.50 %" in found
    assert "not identified" in found
    assert "outlet [bar]" in found
    if runs == 12:
        assert "all 12 runs overlaid" in found
    if runs == 90:
        assert "60 of 90 runs overlaid" in found


def test_many_runs_of_different_length_show_the_extremes() -> None:
    figure = plot_result(make(60, 7, spans=lambda k: 30.0 if k == 3 else 3.0))
    assert "3 of 7 runs: the best, the middle and the worst fit" in texts(figure)


@pytest.mark.parametrize("runs", [1, 2, 3, 12])
def test_no_text_overlaps_other_text(runs: int) -> None:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.text import Text

    figure = plot_result(make(200, runs, name="a_rather_long_name_of_a_recorded_log_file.csv#"))
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    shown = [t for t in figure.findobj(Text) if t.get_visible() and t.get_text().strip()]
    # tick labels of hidden axes keep their text; those are not drawn
    hidden = set().union(*(_hidden_ticks(axes) for axes in figure.axes))
    boxes = [(t.get_text(), t.get_window_extent()) for t in shown if t not in hidden]
    assert len(boxes) > 30
    for i, (a, first) in enumerate(boxes):
        for b, second in boxes[i + 1 :]:
            assert not first.padded(-1.0).overlaps(second.padded(-1.0)), (a, b)


def _hidden_ticks(axes: Any) -> set[Any]:
    hidden: set[Any] = set()
    for axis in (axes.xaxis, axes.yaxis):
        low, high = sorted(axis.get_view_interval())
        current = axis.get_major_ticks()
        for tick in (*axis.majorTicks, *axis.minorTicks):  # some are left over from before
            drawn = tick in current and axes.axison and low <= tick.get_loc() <= high
            hidden |= {tick.label2} if drawn else {tick.label1, tick.label2}
    return hidden


def test_a_warning_is_named_under_the_badge() -> None:
    passed = plot_result(make(verdict="pass"))
    assert "not identified" not in [t.get_text() for t in passed.texts]
    result = make(verdict="warn")
    figure = plot_result(result)
    badge = next(t for t in figure.texts if t.get_text() == "WARN")
    named = next(t for t in figure.texts if t.get_text() == "not identified")
    assert named.get_position()[1] < badge.get_position()[1]


def test_panels_have_the_range_of_what_they_show() -> None:
    result = make(400, 2)
    first, second = result.fitted
    raised = replace(second, measured=second.measured + 5e6, simulated=second.simulated + 5e6)
    figure = plot_result(replace(result, fitted=[first, raised]))
    upper, other = figure.axes[:2]
    assert upper.get_ylim()[1] < 10.0 < 40.0 < other.get_ylim()[0]  # bar
    residuals = figure.axes[2:4]
    assert residuals[0].get_ylim() == residuals[1].get_ylim()
    correlations = next(a for a in figure.axes if "autocorrelation" in a.get_title(loc="left"))
    assert correlations.get_ylim()[1] < 0.3


def test_the_worst_sample_is_seen_close_up() -> None:
    result = make(1000)
    (run,) = result.fitted
    measured = run.measured.copy()
    measured[700] += 9e4
    figure = plot_result(replace(result, fitted=[replace(run, measured=measured)]))
    close = next(a for a in figure.axes if "largest residual" in a.get_title(loc="left"))
    assert "0.9" in close.get_title(loc="left")
    low, high = close.get_xlim()
    at = float(run.experiment.time[700])
    assert low < at < high
    assert high - low < 0.1 * float(run.experiment.time[-1])
    edge = next(a for a in figure.axes if "sharpest edge" in a.get_title(loc="left"))
    low, high = edge.get_xlim()
    jumps = run.experiment.time[1:][np.diff(run.experiment["inlet"]) != 0.0]
    assert ((jumps > low) & (jumps < high)).any()


def test_same_result_gives_the_same_bytes(tmp_path: Path) -> None:
    for kind in ("png", "svg", "pdf"):
        first = save_figure(plot_result(make()), tmp_path / f"a.{kind}").read_bytes()
        second = save_figure(plot_result(make()), tmp_path / f"b.{kind}").read_bytes()
        assert first == second
    assert write_html(make(), tmp_path / "a.html").read_bytes() == (
        write_html(make(), tmp_path / "b.html").read_bytes()
    )


def test_a_users_own_style_changes_nothing(tmp_path: Path) -> None:
    import matplotlib

    before = dict(matplotlib.rcParams)
    first = save_figure(plot_result(make()), tmp_path / "a.png").read_bytes()
    assert dict(matplotlib.rcParams) == before
    with matplotlib.rc_context({"font.size": 25, "lines.linewidth": 9, "axes.grid": True}):
        second = save_figure(plot_result(make()), tmp_path / "b.png").read_bytes()
    assert first == second


def test_files_are_kept_and_suffixes_checked(tmp_path: Path) -> None:
    figure = plot_result(make())
    path = tmp_path / "fit.png"
    path.write_text("mine")
    with pytest.raises(OutputError):
        save_figure(figure, path)
    assert path.read_text() == "mine"
    save_figure(figure, path, overwrite=True)
    assert path.read_bytes().startswith(b"\x89PNG")
    for name in ("fit", "fit.jpg", "fit.html"):
        with pytest.raises(UsageError, match="png"):
            save_figure(figure, tmp_path / name)
    with pytest.raises(UsageError, match="html"):
        write_html(make(), tmp_path / "fit.txt")


def test_a_million_rows_are_thinned() -> None:
    result = make(1_000_000)
    figure = plot_result(result)
    drawn = sum(len(line.get_xdata()) for axes in figure.axes for line in axes.lines)
    assert drawn < 20_000


def test_envelope_keeps_peaks() -> None:
    x = np.arange(100_000.0)
    y = np.zeros(100_000)
    y[[17, 54_321, 99_999]] = 5.0, -7.0, 3.0
    y[200:220] = np.nan
    kept_x, kept_y = envelope(x, y, 500)
    assert kept_y.size <= 1002 + 500
    assert {17.0, 54_321.0, 0.0, 99_999.0} <= set(kept_x.tolist())
    assert np.nanmin(kept_y) == -7.0
    assert np.all(np.diff(kept_x) > 0.0)


def test_correlation_reaches_as_far_as_the_residuals_remember() -> None:
    rng = np.random.default_rng(2)
    lags, rho = correlation([rng.standard_normal(4000)])
    assert lags[-1] == 40
    assert np.abs(rho).max() < 0.08
    lags, rho = correlation([np.sin(np.arange(40_000) / 3000.0)])
    assert lags[-1] > 500
    assert correlation([np.zeros(3)])[0].size == 1
    assert correlation([])[0].size == 1


def test_left_out_samples_and_perfect_fits_are_drawn(tmp_path: Path) -> None:
    result = make()
    run = result.fitted[0]
    y = run.measured.copy()
    y[50:80] = np.nan
    for measured in (y, run.simulated):
        other = replace(result, fitted=[replace(run, measured=measured)])
        save_figure(plot_result(other), tmp_path / "gap.png", overwrite=True)


def test_static_maps_show_curve_points_and_what_was_left_out(tmp_path: Path) -> None:
    x = np.linspace(0.0, 1000.0, 2500)
    used = (x > 10.0) & (x < 990.0)
    y = 0.1 * (x / 1000.0) ** 2 + 1e-4 * np.sin(x)
    view = StaticView(
        "reading", "1", "reference", "m", x, y, 0.1 * (x / 1000.0) ** 2, used,
        [Curve("curve", x, 0.1 * (x / 1000.0) ** 2)],
        Curve("control points", np.array([0.0, 500.0, 1000.0]), np.array([0.0, 0.0, 0.1])),
    )  # fmt: skip
    figure = plot_result(replace(make(), static_view=view))
    found = texts(figure)
    for word in ("left out", "control points", "reference [mm]", "residual [mm]", "± 2 rmse"):
        assert word in found
    save_figure(figure, tmp_path / "map.svg")
    assert plot_validation(replace(make(validation=True), static_view=view)) is None


def test_validation_has_its_own_picture() -> None:
    assert plot_validation(make()) is None
    figure = plot_validation(make(validation=True))
    assert figure is not None
    assert "not fitted" in texts(figure)
    assert all(axes.get_position().y0 > 0.05 for axes in figure.axes)  # nothing is cut


class _Structure(HTMLParser):
    """Tags that are open, tags that were seen, and text."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.seen: set[str] = set()
        self.sources: list[str] = []
        self.text = ""

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.seen.add(tag)
        self.sources += [v or "" for k, v in attrs if k in ("src", "href")]
        assert not any(k.startswith("on") for k, _ in attrs)
        if tag not in {"meta", "img", "br", "wbr", "link", "input"}:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.text += data


@pytest.mark.parametrize("runs", [1, 20])
def test_page_is_whole_self_contained_and_escaped(tmp_path: Path, runs: int) -> None:
    path = write_html(
        make(60, runs, validation=True, name=EVIL, verdict="warn"), tmp_path / "r.html"
    )
    page = path.read_text(encoding="utf-8")
    found = _Structure()
    found.feed(page)
    assert found.open == []
    assert not found.seen & {"link", "iframe", "object", "b"}
    (script,) = re.findall("<script>(.*?)</script>", page, re.DOTALL)
    trusted = b64encode(hashlib.sha256(script.encode()).digest()).decode()
    assert f"script-src 'sha256-{trusted}'\"" in page
    # fit, validation, and responses where so short runs still tell one
    assert len(found.sources) == (3 if runs == 1 else 2)
    assert all(s.startswith("data:image/svg+xml;base64,") for s in found.sources)
    assert found.text.index("Warnings") < found.text.index("The model against")
    for word in (
        EVIL, "WARN", "0.4000 ± 0.0020 s", "not identified", "time_constant", "Provenance",
        "Correlation", "extrapolates", "−0.50", "sha256",
        "Record sharp steps", "-> do <this>", "400.0 ± 2.0",
    ):  # fmt: skip
        assert word in found.text, word


def test_page_of_a_file_alone(tmp_path: Path) -> None:
    result = make()
    file = result.save(tmp_path / "line.yaml")
    document = ff.read_document(file)
    path = write_document_html(document, tmp_path / "line.html")
    found = _Structure()
    found.feed(path.read_text(encoding="utf-8"))
    assert found.sources == []
    assert "<mi>time_constant</mi>" in path.read_text(encoding="utf-8")
    assert "second_time_constant" not in found.text  # a line of first order
    assert "time_constant" in found.text
    with pytest.raises(OutputError):
        write_document_html(document, path)


def test_pictures_are_told_in_words_and_tables_are_reached_by_keyboard() -> None:
    page = result_page(make(300, 2, validation=True))
    first, responses, second = re.findall('<img alt="([^"]*)"', page)
    assert "step response of the model is within its band" in responses
    for word in ("measured and simulated", "run0: fit ", "largest residual", "98.50 %", "PASS"):
        assert word in first, word
    assert "not fitted" in second
    scrolling = re.findall('<div class="(?:scroll|picture)[^>]*>', page)
    assert len(scrolling) > 5
    names = [re.search('aria-label="([^"]+)"', tag) for tag in scrolling]
    assert len({name[1] for name in names if name}) == len(scrolling)
    assert all('tabindex="0" role="region"' in tag for tag in scrolling)


def test_values_read_off_a_picture_are_those_that_were_drawn() -> None:
    result = make(50)
    made = picture(plot_result(result), "title", "words")
    upper = made.panels[0]
    assert (upper.x_label, upper.y_label) == (("time", "s"), ("outlet", "bar"))
    (name,) = [key for key, label in upper.lines if label == "simulated"]
    svg = made.svg.decode()
    view = re.search('viewBox="0 0 (\\S+) (\\S+)"', svg)
    group = svg[svg.index(f'id="{name}"') :]
    last = re.findall(r"L (\S+) (\S+)", group[: group.index("</g>")])[-1]
    assert view is not None
    x, y = (float(p) / float(size) for p, size in zip(last, view.groups(), strict=True))
    left, top, right, bottom = upper.box
    time = upper.x[0] + (x - left) / (right - left) * (upper.x[1] - upper.x[0])
    value = upper.y[0] + (bottom - y) / (bottom - top) * (upper.y[1] - upper.y[0])
    assert time == pytest.approx(3.0, abs=2e-3)
    assert value == pytest.approx(result.fitted[0].simulated[-1] / 1e5, abs=2e-3)
    residual = made.panels[1]
    assert [label for _, label in residual.lines] == ["residual"]


@pytest.mark.parametrize(
    ("value", "error", "text"),
    [
        (53.7123, 0.21, "53.71 ± 0.21"),
        (1.17112e-6, 4e-11, "1.171120×10⁻⁶ ± 4.0×10⁻¹¹"),
        (0.0, 0.02, "0 ± 0.020"),
        (-2.9986, 0.0017, "−2.9986 ± 0.0017"),
        (1234567.0, 1500.0, "1234567 ± 1500"),
        (12.0, None, "12"),
        (0.0, None, "0"),
    ],
)
def test_values_stand_with_their_errors(value: float, error: float | None, text: str) -> None:
    assert show(value, error) == text


def test_numbers_as_people_read_them() -> None:
    assert short(0.0001234) == "1.234×10⁻⁴"
    assert short(float("inf")) == "–"
    assert percent(99.9955) == "99.995 %" or percent(99.9955) == "99.996 %"
    assert percent(100.0) == "100.00 %"
    assert percent(99.999999) == "99.999999 %"
    assert percent(None) == "–"
    assert percent(-1e30) == "below −1000 %"
    assert pretty_unit("kg m2") == "kg·m²"
    assert pretty_unit("N s/m") == "N·s/m"
    assert pretty_unit("1") == ""
    assert pretty_unit("m3/(s V Pa^0.5)") == "m³/(s·V·√Pa)"
    assert scaled(5.02e-5, "m") == "0.0502 mm"
    assert scaled(14.6, "s") == "14.6 s"
    assert choose_scale("Pa", 4e5).label("outlet") == "outlet [bar]"
    assert choose_scale("m", 0.2).unit == "mm"
    assert choose_scale("1", 0.2).label("gain") == "gain"
    assert show([1.0, 2.0, 3.0]) == "3 values, 1.00 … 3.00"
    assert show([[1.0, 2.0], [3.0, 4.0]]).startswith("2 × 2 values")
    assert plain("a" * 100, 21) == "a" * 10 + "…" + "a" * 10
    assert plain("中\n") == "??"


def test_importing_the_package_loads_no_matplotlib() -> None:
    code = (
        "import sys, fluidact_fit.report, fluidact_fit.fitting; print('matplotlib' in sys.modules, "
        "'matplotlib.pyplot' in sys.modules)"
    )
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert out.stdout.split() == ["False", "False"]


def test_plotting_loads_no_pyplot(tmp_path: Path) -> None:
    code = (
        "import sys, fluidact_fit.report.save as s; from matplotlib.figure import Figure; "
        "f = Figure(); f.add_subplot(); s.save_figure(f, sys.argv[1]); "
        "print('matplotlib.pyplot' in sys.modules)"
    )
    out = subprocess.run(
        [sys.executable, "-c", code, str(tmp_path / "a.svg")],
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert out.stdout.strip() == "False"


def test_samples_that_were_replaced_are_drawn_as_they_were_recorded(tmp_path: Path) -> None:
    rows = (ROOT / "datasets/valve/trial1.csv").read_text(encoding="utf-8").splitlines()
    recorded = {299: 9.99, 499: 5.65}  # a spike, and one that only the model of the others tells
    for k, value in recorded.items():
        time, command, _ = rows[k + 1].split(";")
        rows[k + 1] = f"{time};{command};{value}".replace(".", ",")
    path = tmp_path / "log.csv"
    path.write_text("\n".join(rows), encoding="utf-8")
    columns = {"time": "#1", "command": "#2", "outlet": "#3"}
    result = ff.fit("valve", path, columns=columns)
    assert {"spikes", "outliers"} <= {n.code for n in result.notices}
    figure = plot_result(result)
    upper = figure.axes[0]
    marks = [line for line in upper.lines if line.get_marker() in ("x", "^")]
    assert [float(line.get_xdata()[0]) for line in marks] == pytest.approx([4.99, 2.99])
    at, beyond = (float(line.get_ydata()[0]) for line in marks)
    assert at == pytest.approx(recorded[499])
    assert beyond == upper.get_ylim()[1] < recorded[299]
    assert "left out" in texts(figure)


def test_page_shows_the_model_over_the_response_that_needs_no_model() -> None:
    columns = {"time": "#1", "command": "#2", "outlet": "#3"}
    result = ff.fit("valve", ROOT / "datasets/valve/trial1.csv", columns=columns)
    found = responses_picture(result)
    assert found is not None
    impulse, step, *_ = found.panels
    assert [name for _, name in step.lines] == ["recorded", "model"]
    assert step.x_label[1] == impulse.x_label[1]
    share = re.search(r"within its band at ([\d.]+) %", found.words)
    assert share is not None
    assert float(share[1]) > 80.0
    assert "warnings" not in found.title
    weak = replace(result, notices=[Notice("unmodelled-response", "a lag")])
    titled = responses_picture(weak)
    assert titled is not None
    assert "unmodelled-response" in titled.title
    assert escape(found.words) in result_page(result)
    static = load_dataset("potentiometer")
    assert responses_picture(ff.fit("potentiometer", static.read(), **static.options)) is None
