"""Backlash: the play between a drive and the load behind it, both positions recorded.

    load = path + offset
    path_k = min(max(path_(k-1), ratio drive_k - play / 2), ratio drive_k + play / 2)

The play operator [1]_: the load rests while the drive crosses the play and then follows it on the
other side, as it does where friction dominates and motion is slow. With ``u`` the drive at the last
contact and ``s`` the side that pushed (1 upwards, -1 downwards) the path is ``ratio u - s play /
2``, which gives all derivatives. The right inverse [2]_ takes the drive across the play at once
where the wanted load turns back.

A drive that turns between two rows goes farther than either, and the load with it: by as much as
the readings on both sides tell (:func:`.turns_between`), if that explains the load better than a
turn at a row.

References
----------
.. [1] M. Brokate, J. Sprekels, Hysteresis and Phase Transitions, 1996, section 2.1.
.. [2] G. Tao, P. Kokotovic, Adaptive Control of Systems with Actuator and Sensor Nonlinearities,
   1996, chapter 2.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from math import sqrt
from typing import Any

import numpy as np
import numpy.typing as npt

from ..block import SteppedBlock
from ..errors import Notice
from ..estimation.blocks import joined
from ..estimation.named_model import NamedModel, Values, check_request, make_unknowns
from ..estimation.noise import common_step, noise_floor, white_noise
from ..estimation.parametric import Fitted, fit_named
from ..estimation.problem import Basis
from ..estimation.recursion import behind_play, clamped
from ..estimation.results import undetermined_error
from ..estimation.uncertainty import covariance, widen_by
from ..experiment import Experiment, FloatArray, Hold, IndexArray, Signal
from ..family import (
    Curve,
    Excitation,
    Family,
    FamilyOptions,
    NoiseLevel,
    NoiseModel,
    ParameterSpec,
    Plant,
    Request,
    Role,
    Runs,
    Simulated,
    Solution,
    StaticView,
    UnmodelledEffect,
    Variant,
    make_solution,
)
from ..options import settled
from ..routines import Argument, Draft, Routine, by_sign, choose, constant, maximum, minimum
from ..signals import rise_and_fall, turns_between

_SHARES = (0.0, 0.003, 0.01, 0.03, 0.1, 0.3, 0.6)  # of the range of the drive, to begin with
_SURE = 10.0  # times its noise, from which a way back of the load is none of it
_LED = 0.5  # of the squared residual: what a negative play leaves at most where the load leads
_DRAWS = 12  # of the errors of the drive's readings
_COUNTS = 0.1  # of a variance, from which on a profile of the cost says too little
_CODES = 3.0  # steps of a converter that a motion goes at once, unless it was commanded in them
_CLEAR = 6.0  # times the error of a reading that a turn between two lies beyond both
_MATTERS = 0.25  # half-widths of the interval by which noise may shift it
_POWER = 0.1  # relative standard error of the power of the drive's noise
_BACK = "Move the drive both ways, slowly, each time by several times the play."


@dataclass(frozen=True)
class BacklashOptions(FamilyOptions):
    """Whose the offset is, and where the drive turns; settled by the fit."""

    offset_of: str | None = settled(
        "choice", "whether each log has an output offset of its own, about that of the file",
        choices=("log", "file"),
    )  # fmt: skip
    turns: str | None = settled(
        "choice", "whether the drive turns at a row, or between two rows",
        choices=("row", "between"),
    )  # fmt: skip


@dataclass(frozen=True)
class Followed:
    """Motion of a load that follows a drive through a play.

    Attributes
    ----------
    path
        Load without its offset, shape ``(n,)`` [unit of the load].
    side
        1 where the drive pushed it last upwards, -1 downwards, 0 while it never did.
    contact
        Sample of that push.
    begins
        First sample at which they were in contact: before it the load rests anywhere in the play.
    """

    path: FloatArray
    side: FloatArray
    contact: IndexArray
    begins: int


Reach = tuple[FloatArray, FloatArray]  # least and largest drive since the row before, (n,) each


def reach_of(e: Experiment) -> Reach:
    """Least and largest drive since the row before: it may have turned between two rows.

    A drive that is held turned at none.
    """
    drive, x = e.signals["drive"], e.sampled("drive")
    low, high = x.copy(), x.copy()
    if drive.hold == "zoh" or drive.values.size < 2:
        return low, high
    rows = e.time if e.time.size else np.arange(x.size, dtype=float)
    time = drive.time if e.time.size else rows
    codes = common_step(np.diff(drive.values)) / sqrt(12.0)
    error = max(white_noise(drive.values, e.uneven if drive.values.size == x.size else None), codes)
    turned, there = turns_between(time, drive.values, _CLEAR * error)
    time, values = np.append(time, turned), np.append(drive.values, there)
    at = np.searchsorted(rows, time)
    inside = (at > 0) & (at < rows.size)
    np.minimum.at(low, at[inside], values[inside])
    np.maximum.at(high, at[inside], values[inside])
    return low, high


def follow(
    drive: FloatArray, ratio: float, backlash: float, load: FloatArray | None = None,
    reach: Reach | None = None,
) -> Followed:  # fmt: skip
    """Let a load follow a drive, shape ``(n,)`` each, which may have been farther between rows.

    It begins in the middle of the play or, where it was recorded, in the state that explains the
    record best: pushed from either side, at once or later. The play forgets that state once it was
    crossed.
    """
    u, half = ratio * drive, 0.5 * backlash
    ends = [ratio * x for x in reach or (drive, drive)]
    low, high = ends if ratio > 0.0 else ends[::-1]
    now = np.arange(u.size)

    def run(start: float, side: float, begins: int) -> Followed:
        path = clamped(start, high - half, np.maximum(low + half, u - half), 0.0, u.size)
        step = np.diff(path, prepend=path[0])
        pushed = np.sign(step)
        pushed[high - u > backlash], pushed[u - low > backlash] = -1.0, 1.0  # and came back
        contact = np.maximum.accumulate(np.where(step != 0.0, now, 0))
        sides = np.where(contact > 0, pushed[contact], side)
        return Followed(path, sides, contact, begins)

    if load is None:
        return run(float(u[0]), 0.0, 0)
    sides = [run(-side * np.inf, side, 0) for side in (1.0, -1.0)]
    crossed = int(np.count_nonzero(sides[0].path != sides[1].path))
    best, least = sides[0], np.inf
    for end in sides:
        moved = np.unique(end.contact[:crossed])
        at = np.unique(np.concatenate(([0], moved, [crossed])))
        cost = _two_levels(load, load - end.path, at)
        k = int(np.argmin(cost))
        if cost[k] < least:
            least = float(cost[k])
            best = Followed(end.path, end.side, end.contact, int(at[k]))
    return best


def _two_levels(before: FloatArray, after: FloatArray, at: IndexArray) -> FloatArray:
    """Squares about the means of ``before[:k]`` and ``after[k:]`` for every ``k`` of ``at``."""
    total = np.zeros(at.size)
    for values, cut in ((before, at), (after[::-1], after.size - at)):
        v = values - values.mean()
        first, second = (np.concatenate(([0.0], np.cumsum(p)))[cut] for p in (v, v**2))
        total += second - first**2 / np.maximum(cut, 1)
    return total


@dataclass(frozen=True)
class PlayModel:
    """Positions of all runs, as the estimation takes the model; see :class:`.NamedModel`.

    The offset of all of them is a given ``level``, or each run has its own.
    """

    drives: Sequence[FloatArray]
    loads: Sequence[FloatArray]
    reaches: Sequence[Reach | None]
    level: float | None = None

    def slopes(self, index: int, values: Values, names: Sequence[str]) -> tuple[Basis, FloatArray]:
        """Path of a run and its derivatives; its first position is its own, as its offset is."""
        x, y = self.drives[index], self.loads[index]
        ratio, play = float(values["ratio"]), float(values["play"])
        f = follow(x, ratio, play, y, self.reaches[index])
        after = np.arange(x.size) >= f.begins
        own = [after, ~after] if self.level is None else [~after]
        local = [part.astype(float) for part in own if part.any()]
        pushing = (f.path + 0.5 * play * f.side) / (ratio or 1.0)  # the drive at the last contact
        by = {"ratio": after * pushing, "play": -0.5 * after * f.side}
        table = np.array([by[n] for n in names]).reshape(len(names), x.size)
        known = after * (f.path + (self.level or 0.0))
        return Basis(known, local=local), table

    def columns(self, index: int, values: Values) -> Basis:
        """Path of a run."""
        return self.slopes(index, values, ())[0]

    def offset(self, fitted: Fitted) -> tuple[float, FloatArray]:
        """Mean offset of all samples, and its covariances with the estimated values and itself.

        Shape ``(q + 1,)``. It moves with the path that the values give, and by the noise of every
        run or, where that is more, as the runs differ.
        """
        table = np.zeros(len(fitted.names))
        levels, errors, sizes = [], [], []
        for k, y in enumerate(self.loads):
            basis, slopes = self.slopes(k, fitted.values, fitted.names)
            seen = basis.local[0] > 0.0
            rest = (y - basis.known)[seen]
            levels.append(float(rest.mean()))
            errors.append(
                covariance([np.ones((rest.size, 1))], [rest - levels[-1]]).covariance[0, 0]
            )
            sizes.append(rest.size)
            table -= slopes[:, seen].sum(axis=1)
        share = np.array(sizes) / sum(sizes)
        mean = float(share @ levels)
        own = [float(share**2 @ errors)]
        if len(sizes) > 1:
            own.append(float(share @ np.square(np.array(levels) - mean)) / (len(sizes) - 1))
        shared = fitted.covariance @ (table / sum(sizes))
        return mean, np.append(shared, table @ shared / sum(sizes) + max(own))

    def start(self, share: float) -> tuple[dict[str, float], float]:
        """Ratio that fits best behind a play of some share of the range, and what it leaves."""
        width = share * max(float(np.ptp(x)) for x in self.drives)
        paths = [behind_play(x, width) for x in self.drives]
        w = np.concatenate([p - p.mean() for p in paths])
        y = np.concatenate([p - p.mean() for p in self.loads])
        ratio = float(w @ y / max(w @ w, 1e-300))
        rest = y - ratio * w
        return {"ratio": ratio, "play": abs(ratio) * width}, float(rest @ rest)


# --------------------------------------------------------------------- what a controller runs


class BacklashBlock(SteppedBlock):
    """Load behind the play, and the drive that takes it to a wanted place.

    :meth:`step` and :meth:`drive_for` each keep their own side of the play, call by call. Where
    the side is known, calling the block and :meth:`inverse` take it: ``direction`` is 1 where the
    drive pushes upwards, as the load counts, -1 downwards, 0 in the middle of the play.
    """

    def _begin(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget both sides: the next step finds the load in the middle of the play."""
        self._path: float | None = None
        self._wanted, self._side = np.nan, 0.0

    def __call__(self, drive: npt.ArrayLike, direction: float = 0.0) -> FloatArray:
        """Load on a side of the play, shape of ``drive``."""
        self.watch(drive=drive)
        v, x = self.numbers(), np.asarray(drive, dtype=float)
        return np.asarray(v["ratio"] * x + v["offset"] - 0.5 * np.sign(direction) * v["play"])

    def inverse(self, load: npt.ArrayLike, direction: float = 0.0) -> FloatArray:
        """Drive that holds a load on a side of the play, shape of ``load``."""
        self.watch(load=load)
        v, y = self.numbers(), np.asarray(load, dtype=float)
        away = 0.5 * np.sign(direction) * v["play"] - v["offset"]
        return np.asarray((y + away) / v["ratio"])

    def _step(self, value: float) -> float:
        """Advance the load; see :meth:`.SteppedBlock.step`."""
        v = self.numbers()
        u, half = v["ratio"] * value, 0.5 * v["play"]
        self._path = u if self._path is None else min(max(self._path, u - half), u + half)
        return self._path + v["offset"]

    def drive_for(self, load: float) -> float:
        """Drive that takes the load to the next wanted position: the right inverse of the play.

        It crosses the play where the wanted position turns back, and stays on its side while that
        rests; in the middle of the play until it has moved.
        """
        wanted = self.sample("load", load)
        if wanted != self._wanted:
            self._side = float(np.sign(np.nan_to_num(wanted - self._wanted)))
        self._wanted = wanted
        return float(self.inverse(wanted, self._side))

    def predict(self, experiment: Experiment) -> FloatArray:
        """Load of a recording from its drive; see :meth:`.Block.predict`."""
        v, x = self.numbers(), experiment.sampled("drive")
        farther = (self.document.options or {}).get("turns") == "between"
        reach = reach_of(experiment) if farther else None
        return follow(x, v["ratio"], v["play"], reach=reach).path + v["offset"]

    def methods(self) -> Mapping[str, Callable[..., Any]]:
        """All of them; see :meth:`.Block.methods`."""
        return {"step": self.step, "drive_for": self.drive_for,
                "load_at": self, "drive_at": self.inverse}  # fmt: skip

    def routines(self) -> Sequence[Routine]:
        """Both ways: with the side of the play kept from call to call, and on a given one."""
        v = self.numbers()
        offset, ratio = constant("offset", v["offset"]), constant("ratio", v["ratio"])
        half = constant("half_width", 0.5 * v["play"])
        drive = self.argument("drive", "position of the drive")
        load = self.argument("load", "wanted position of the load")
        way = Argument(
            "direction", "1", "1 pushed up, -1 down, 0 in the middle of the play", -1.0, 1.0
        )
        step = Draft("step", "Load behind the play, which is kept between calls.", load.unit)
        u = step.let("pushed", step.argument(drive) * ratio)
        path, begun = step.state("path"), step.state("begun")
        step.put(path, choose(begun, ">", 0.0, minimum(maximum(path, u - half), u + half), u))
        step.put(begun, 1.0)
        there = Draft("drive_for", "Drive for the next wanted load; its side is kept.", drive.unit)
        wanted = there.argument(replace(load, held=True))
        last, side, known = there.state("last"), there.state("side"), there.state("known")
        turned = by_sign(wanted - last, half, -half, side, jumps=True)
        there.put(side, choose(known, ">", 0.0, turned, 0.0))
        there.put(last, wanted)
        there.put(known, 1.0)
        at = Draft("load_at", "Load on a side of the play.", load.unit)
        moved, pushed = at.argument(drive) * ratio, by_sign(at.argument(way), half, -half)
        back = Draft("drive_at", "Drive that holds a load on a side of the play.", drive.unit)
        y, pushing = back.argument(load), by_sign(back.argument(way), half, -half)
        per = constant("per_ratio", 1.0 / v["ratio"])
        return (
            step.returns(path + offset), there.returns((wanted - offset + side) * per),
            at.returns(moved + offset - pushed), back.returns((y - offset + pushing) * per),
        )  # fmt: skip


# ------------------------------------------------------------------------------- the family


class Backlash(Family[BacklashOptions]):
    """Play between a drive and its load, and their ratio, from slow strokes both ways."""

    name = "backlash"
    title = "Backlash: play and lost motion between a drive and its load"
    equation = (
        "load = path + offset, "
        "path = min(max(path before, ratio drive - play / 2), ratio drive + play / 2)"
    )
    variants = (
        Variant(
            "backlash",
            (
                Role("time", "s", "time of each sample", required=False),
                Role("drive", "m", "position of the drive, before the play", hold="foh",
                     alternatives=("rad", "1", "V")),
                Role("load", "m", "position of the load, behind the play", output=True,
                     alternatives=("rad", "1", "V")),
            ),
            (
                ParameterSpec(
                    "play", "m", "width of the play, as the load moves", minimum=0.0,
                    ratio=("load", "1"), remedy=_BACK,
                ),
                ParameterSpec(
                    "ratio", "1", "way of the load per way of the drive in contact",
                    ratio=("load", "drive"),
                    remedy="Move the drive by many times the play.",
                ),
                ParameterSpec(
                    "offset", "m", "load where the drive is at zero, in the middle of the play",
                    ratio=("load", "1"), searched=False,
                ),
            ),
        ),
    )  # fmt: skip
    options_type = BacklashOptions
    block_type = BacklashBlock
    next_experiment = Excitation(
        "none", "any slow strokes in both directions, far longer than the play, will do"
    )

    def estimate(
        self, variant: Variant, experiments: Sequence[Experiment], request: Request[BacklashOptions]
    ) -> Solution[BacklashOptions]:
        """Fit play, ratio and offset; see :meth:`Family.estimate`."""
        check_request(variant.parameters, request)
        level = request.fixed.get("offset")
        model = PlayModel(
            [e.sampled("drive") for e in experiments], [e.sampled("load") for e in experiments],
            [None for _ in experiments], level,
        )  # fmt: skip
        _refuse_rest(model, variant, experiments[0], request.fixed)
        tried = sorted((model.start(share) for share in _SHARES), key=lambda found: found[1])
        starts = [start for start, _ in tried[:3]]
        size = abs(starts[0]["ratio"])
        span = size * max(float(np.ptp(x)) for x in model.drives)
        names = ("play", "ratio")

        def fit(model: PlayModel) -> Fitted:
            return fit_named(
                NamedModel(
                    names, (), model.columns, model.loads, model.slopes,
                    resolutions=[e.signals["load"].resolution for e in experiments],
                    logs=[e.log for e in experiments],
                ),
                variant.parameters, request,
                make_unknowns(variant.parameters, names, {"play": 0.01 * span, "ratio": size},
                              request, {"play": (0.0, 2.0 * span)}),
                starts, max_half_widths={"play": 0.25 * span},
                no_effect_at={"play": size * max(map(_way_back, model.drives))},
            )  # fmt: skip

        fitted, turns = fit(model), "row"
        reaches = [reach_of(e) for e in experiments]
        if any(np.any(low != high) for low, high in reaches):  # the load tells how far it went
            farther = replace(model, reaches=reaches)
            other = fit(farther)
            if other.solution.cost < fitted.solution.cost:
                model, fitted, turns = farther, other, "between"
        _refuse_lead(fitted, variant)
        errors = [_reading_errors(e) for e in experiments]
        fitted = _allow_for_readings(model, fitted, errors, experiments[0].signals["drive"])
        units = experiments[0].units
        whole = _with_offset(fitted, model)
        parameters, order, matrix = whole.quantities(variant.parameters, units)
        logs, notices = fitted.compare_logs(experiments)
        noise = max(noise for noise, _ in errors)
        of_drive = {"drive": NoiseLevel(noise, _POWER)} if noise else {}

        return make_solution(
            self.simulate, experiments, variant,
            replace(request.options, offset_of="log" if level is None else "file", turns=turns),
            parameters, order, NoiseModel(matrix, fitted.independent, of_drive),
            jacobians=[{"load": j} for j in fitted.sensitivity()],
            derived=fitted.derive(
                {"lost_motion": units["drive"]}, lambda v: self.derived(v, request.options)
            ),
            notices=[*fitted.notices, *notices], details={**fitted.details(), **logs},
        )  # fmt: skip

    def derived(self, values: Values, options: BacklashOptions) -> dict[str, Any]:
        """Way of the drive from one side of the play to the other; see :meth:`Family.derived`."""
        ratio = values["ratio"]
        return {"lost_motion": values["play"] / (ratio * np.sign(np.real(ratio)))}

    def simulate(
        self,
        plant: Plant[BacklashOptions],
        experiments: Sequence[Experiment],
        offset: float | None = None,
    ) -> list[Simulated]:
        """Load from drive; see :meth:`Family.simulate`."""
        out = []
        for e in experiments:
            y = e.sampled("load") if "load" in e else None
            f, level = _follow(plant, e, y), plant.numbers["offset"]
            if y is None:
                output = f.path + level
            else:
                if plant.options.offset_of == "log":
                    level = float(np.mean((y - f.path)[f.begins :] if f.begins < y.size else y))
                output = f.path + level
                output[: f.begins] = np.mean(y[: f.begins]) if f.begins else 0.0
            out.append(Simulated(output, offset=level))
        return out

    def unmodelled_effects(self, plant: Plant[BacklashOptions]) -> Sequence[UnmodelledEffect]:
        """A load that moves inside the play; see :meth:`Family.unmodelled_effects`."""
        return [
            UnmodelledEffect(
                "motion inside the play", "the load moves while the drive crosses the play",
                "Look for a spring or friction between drive and load, wind-up of the shaft, or a "
                "load that coasts: move more slowly, and load the axis less.",
                partial(_inside, plant),
            )
        ]  # fmt: skip

    def model(
        self, plant: Plant[BacklashOptions], sample_time: float, hold: Hold
    ) -> dict[str, Any]:
        """The play as a controller runs it."""
        v = plant.numbers
        numbers = {"half_width": 0.5 * v["play"], "ratio": v["ratio"], "offset": v["offset"]}
        return {"play": {**numbers, "lost_motion": v["play"] / abs(v["ratio"])}}

    def static_view(self, plant: Plant[BacklashOptions], runs: Runs) -> StaticView:
        """Load less what it would be without play, over the drive, and both sides of the play."""
        v, view = plant.numbers, StaticView.over(runs, "drive", "load", ())
        free = v["ratio"] * view.x + joined([np.full(s.output.size, s.offset) for _, s in runs])
        ends, half = np.array([view.x.min(), view.x.max()]), np.full(2, 0.5 * v["play"])
        return replace(
            view, y_name="load - ratio drive", measured=view.measured - free,
            fitted=view.fitted - free,
            curves=[Curve("pushed up", ends, -half), Curve("pushed down", ends, half)],
        )  # fmt: skip


def _with_offset(fitted: Fitted, model: PlayModel) -> Fitted:
    """The fit with the mean offset of its logs among its values, the last of them."""
    if model.level is not None:
        given = {"offset": model.level}
        return replace(fitted, values={**fitted.values, **given}, fixed={**fitted.fixed, **given})
    offset, column = model.offset(fitted)
    matrix = np.vstack((np.column_stack((fitted.covariance, column[:-1])), column))
    return replace(
        fitted, values={**fitted.values, "offset": offset}, names=(*fitted.names, "offset"),
        covariance=matrix,
    )  # fmt: skip


def _follow(plant: Plant[Any], e: Experiment, load: FloatArray | None = None) -> Followed:
    v = plant.numbers
    reach = reach_of(e) if plant.options.turns == "between" else None
    return follow(e.sampled("drive"), v["ratio"], v["play"], load, reach)


def _allow_for_readings(
    model: PlayModel, fitted: Fitted, errors: Sequence[tuple[float, float]], drive: Signal
) -> Fitted:
    """Add to the covariance what errors of the drive's readings do; warn where they shift the play.

    The readings are disturbed once more by as much as they are already, and the parameters explain
    how the load moves then. Profiled intervals are dropped where these errors count.
    """
    if not fitted.names:
        return fitted
    rng, table = np.random.default_rng(0), np.vstack(fitted.sensitivity())
    changes = (np.concatenate(_disturbed(model, fitted, errors, rng)) for _ in range(_DRAWS))
    moved = np.array([np.linalg.lstsq(table, change, rcond=None)[0] for change in changes])
    spread = np.atleast_2d(np.cov(moved.T))
    total = widen_by(fitted.covariance + spread, moved.mean(axis=0))
    counts = bool(np.any(np.diag(total - fitted.covariance) > _COUNTS * np.diag(total)))
    out = replace(fitted, covariance=total, intervals={} if counts else fitted.intervals)
    # a load that follows more noise lies higher: the estimate makes up for it
    shift = -dict(zip(fitted.names, moved.mean(axis=0).tolist())).get("play", 0.0)
    if not shift or abs(shift) <= _MATTERS * (sure := out.half_width("play")):
        return out
    noise = drive.text(max(map(max, errors)), ".2g")
    text = (
        f"'drive' carries noise of about {noise} rms, which pushes the load like motion: "
        f"backlash comes out too {'wide' if shift > 0.0 else 'narrow'} by {abs(shift):.2g} or "
        f"more, with an interval of ± {sure:.2g}. Record the drive with a cleaner sensor, or "
        "let it move further than its noise from one sample to the next."
    )
    return replace(out, notices=[*out.notices, Notice("input-noise-left", text)])


def _reading_errors(e: Experiment) -> tuple[float, float]:
    """White noise of a drive, and the step of its codes, 0 where it shows none [its unit]."""
    readings = e.sampled("drive")
    steps = np.abs(np.diff(readings))
    steps = steps[steps != 0.0]
    step, noise = common_step(steps), white_noise(readings, e.uneven)
    coded = steps.size and step > noise and np.median(steps) >= _CODES * step
    return noise, step if coded else 0.0


def _disturbed(
    model: PlayModel, fitted: Fitted, errors: Sequence[tuple[float, float]],
    rng: np.random.Generator,
) -> list[FloatArray]:  # fmt: skip
    """Change of every load, shape ``(n,)``, with other errors of its drive; the mean left out."""
    ratio, backlash = fitted.values["ratio"], fitted.values["play"]
    out = []
    for x, y, reach, (noise, step) in zip(model.drives, model.loads, model.reaches, errors):
        now = follow(x, ratio, backlash, y, reach)
        # strokes of one speed meet codes in a pattern: all readings of a direction share an error
        coding = step * rng.uniform(-0.5, 0.5, 2)[(np.gradient(x) > 0.0).astype(int)]
        drawn = x + coding + noise * rng.standard_normal(x.size)
        other = None if reach is None else (reach[0] + drawn - x, reach[1] + drawn - x)
        moved = follow(drawn, ratio, backlash, now.path, other).path - now.path
        moved[: now.begins] = np.mean(moved[now.begins :]) if now.begins < x.size else 0.0
        out.append(moved - np.mean(moved))
    return out


def _inside(plant: Plant[Any], experiments: Sequence[Experiment], simulate: Any) -> list[Any]:
    """Distance of the drive from the middle of the play: a spring takes a share of it along."""
    out = []
    for e in experiments:
        f = _follow(plant, e, e.sampled("load"))
        place = plant.numbers["ratio"] * e.sampled("drive") - f.path
        place[: f.begins] = 0.0
        out.append({"load": place})
    return out


def _way_back(values: FloatArray) -> float:
    """Largest way that is gone in both directions."""
    return min(rise_and_fall(values))


def _refuse_rest(model: PlayModel, variant: Variant, e: Experiment, given: Values) -> None:
    """Refuse logs in which drive or load never move, or the load never moves back."""
    if given.get("ratio") == 0.0:
        raise undetermined_error(
            variant.parameter("ratio"), "a drive with a ratio of 0 moves no load."
        )
    least = [_SURE * noise_floor(y) for y in model.loads]
    if not any(map(np.ptp, model.drives)) or all(
        map(np.less_equal, map(np.ptp, model.loads), least)
    ):
        raise undetermined_error(
            variant.parameter("ratio"), "the drive or the load rests in every log."
        )
    if "play" not in given and all(map(np.less_equal, map(_way_back, model.loads), least)):
        back = e.signals["drive"].text(max(map(_way_back, model.drives)))
        raise undetermined_error(
            variant.parameter("play"), "in no log does the load go both ways. The drive turns "
            f"back by {back} at most, which does not cross the play.",
        )  # fmt: skip


def _refuse_lead(fitted: Fitted, variant: Variant) -> None:
    """Refuse a width of zero that explains little because the load turns back before the drive."""
    if "play" not in fitted.names or fitted.values["play"] > 0.0:
        return
    k, found = fitted.names.index("play"), fitted.solution
    table, rest = np.vstack(found.jacobian), np.concatenate(found.residuals)
    free = np.linalg.lstsq(table, rest, rcond=None)[0]
    if free[k] < 0.0 and np.sum((rest - table @ free) ** 2) < _LED * np.sum(rest**2):
        raise undetermined_error(
            variant.parameter("play"), "the load turns back before the drive does. Are the two "
            "columns swapped, or is the drive recorded late?",
        )  # fmt: skip
