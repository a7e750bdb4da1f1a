"""Thresholds of the examination, in one table: when a warning is raised, or a cause named.

Thresholds of warnings that a family or an estimator gives stand in their modules, as do the
tolerances of algorithms.
"""

from __future__ import annotations

from typing import Self

from ..estimation import results


class Threshold(float):
    """A number that decides about a warning, with its meaning and the study or test behind it."""

    meaning: str
    evidence: str

    def __new__(cls, value: float, meaning: str, evidence: str) -> Self:
        """Give a number its meaning and evidence."""
        self = super().__new__(cls, value)
        self.meaning, self.evidence = meaning, evidence
        return self


_TERMS = "tests/assessment/test_examinations.py; docs/evidence/red-team.md"
_SHAPES = "tests/assessment/test_shapes.py"
_INFLUENCE = "tests/assessment/test_influence.py, test_outliers.py"

# fmt: off
# the score test of one more term
TERM_SEEN = Threshold(
    3.0, "standard errors from which a term counts where a parameter changes noticeably", _TERMS)
TERM_CERTAIN = Threshold(4.0, "standard errors from which a term counts in any case", _TERMS)
TERM_ONE_SIDED = Threshold(
    0.4, "standard errors taken off where a term has only one possible sign", _TERMS)
TERM_MOVES = Threshold(2.0, "standard errors by which a term has to move a parameter", _TERMS)
TERM_MOVES_ONE_SIDED = Threshold(
    1.0, "the same for a significant term with only one possible sign", _TERMS)
NOTICEABLE = Threshold(0.01, "relative change of a parameter that is noticeable", _TERMS)
LEAST = Threshold(
    5e-4, "relative change of a parameter that no bench can tell",
    "tests/assessment/test_examinations.py: clean strokes")
LEAST_BY_SHAPE = Threshold(
    5e-3, "the same for the shape of a channel, since none is quite straight", _SHAPES)
CURVED = Threshold(
    0.02, "share of its range by which an input may depart from a straight line",
    "tests/assessment/test_shapes.py: a dead zone within the range of a valve")
PREFER_PARAMETER = Threshold(
    0.8, "share of the best significance from which a parameter of the family is named instead",
    "tests/assessment/test_examinations.py: a delay")
DIRECTION_LEFT = Threshold(
    1e-3, "share of a direction that the parameters have to leave unexplained", _TERMS)
HIDDEN = Threshold(0.8, "share of the terms that noise of an input hides", _TERMS)
FARTHEST_LAG = Threshold(
    10.0, "multiple of the lag tried beyond which an estimated lag is not believed", _TERMS)
# dependence on given and held numbers
HELD_MOVES = Threshold(
    5.0, "standard errors by which a parameter may depend on one that was held",
    "tests/assessment/test_examinations.py: a value that nobody knows")
TIMING_MOVES = Threshold(
    0.02, "relative change of a parameter by a channel one sample late that goes unseen",
    "tests/families/test_spring_cylinder.py: a late position")
ANYTHING = Threshold(
    results.ANYTHING, "relative half-width from which an interval is unbounded in practice",
    "wording")
# samples and parts of the data
ODD = Threshold(
    1e-6, "probability, among all samples, of a residual that makes a sample odd", _INFLUENCE)
ODD_MOVES = Threshold(
    0.5, "standard errors by which an odd sample may move a parameter", _INFLUENCE)
ANY_MOVES = Threshold(3.0, "standard errors by which any sample may move a parameter", _INFLUENCE)
FAR = Threshold(10.0, "standard deviations of a residual that noise does not reach", _INFLUENCE)
OUTLIER_SHARE = Threshold(0.005, "largest share of the samples that can be outliers", _INFLUENCE)
OUTLIERS = Threshold(100.0, "largest number of samples that can be outliers", _INFLUENCE)
OUTLIER_LEVERAGE = Threshold(
    0.05, "leverage from which a sample determines a parameter alone", _INFLUENCE)
HALVES = Threshold(
    1e-4, "p-value of a difference between halves of the data, or of structure in a channel",
    "tests/assessment/test_examinations.py: halves")
HALVES_DIFFER = Threshold(
    0.02, "relative difference of a parameter that halves may have",
    "tests/assessment/test_examinations.py: halves")
HALVES_KNOW = Threshold(
    0.04, "share of the information on a parameter that each half has to contain",
    "tests/assessment/test_examinations.py: halves")
FEW = Threshold(
    50.0, "number of samples from which residuals are judged", "Ljung-Box needs some tens")
# residuals
CHANCE = Threshold(
    1e-5, "p-value below which it is not chance",
    "tests/assessment/test_slow_errors.py, tests/test_feedback_and_spikes.py")
ONE_SIDED = Threshold(
    1.5, "ratio of the correlation with later input to that with earlier input under feedback",
    "tests/test_feedback_and_spikes.py")
FEEDBACK_BY_NOISE = Threshold(
    0.7, "correlation within the sample that noise of an input never causes",
    "tests/test_feedback_and_spikes.py: a regulator")
FEEDBACK_MOVES = Threshold(
    0.5, "standard errors by which noise that came back has to move a parameter",
    "tests/test_feedback_and_spikes.py; tests/families/test_ball_screw_records.py: a controller")
INDEPENDENT = Threshold(
    results.FEW_INDEPENDENT,
    "independent samples per unknown: with fewer, errors of 4 standard errors were seen",
    "tests/assessment/test_examinations.py: errors that last")
WIDER = Threshold(
    1.5, "ratio of the standard error that blocks of rows show to that of the fit",
    "tests/assessment/test_slow_errors.py")
CHANNEL_MISSED = Threshold(
    1.15, "ratio of the residual of a channel to its noise from which it is missed",
    "docs/evidence/red-team.md")
HOLD_EVIDENCE = Threshold(
    7.0, "difference of log-likelihoods that tells holds apart: a thousand to one",
    "tests/families/test_transfer.py: the wrong hold")
HOLD_EXPLAINS = Threshold(
    0.7, "share of a residual with forces in it that another hold may leave",
    "tests/families/test_transfer.py")
HOLD_MOVES = Threshold(
    0.2, "share of the samples at which a command moves that may not be held",
    "tests/families/test_transfer.py")
HOLD_JUMP = Threshold(
    0.25, "share of its range that an input crosses in one sample when it jumps",
    "tests/families/test_transfer.py")
# causes that are named where a fit is refused
_CAUSES = "tests/assessment/test_refusal_causes.py"
CAUSE_SAMPLES = Threshold(
    200.0, "number of samples from which a log is searched for causes", _CAUSES)
LEADS_AGREE = Threshold(
    0.5, "share of the largest correlation from which two signals agree", _CAUSES)
LEADS_LATER = Threshold(
    3.0, "ratio of the two lags that tells which signal is first", _CAUSES)
LEADS_CHANCE = Threshold(
    5.0, "standard deviations that a correlation by chance does not reach", _CAUSES)
SIGN_CORRELATION = Threshold(0.5, "correlation with the input that tells its sign", _CAUSES)
SIGN_ASIDE = Threshold(
    0.8, "largest share of that correlation for the opposite sign", _CAUSES)
SIDES_DIFFER = Threshold(
    1.5, "ratio of the responses to both signs that equal sides do not show", _CAUSES)
ONE_SIGNAL = Threshold(
    0.004, "share of its range by which two sensors of one quantity differ at least", _CAUSES)
WRAP_JUMPS = Threshold(
    0.6, "share of its range by which a counter jumps where it begins again", _CAUSES)
WRAP_OTHERWISE = Threshold(
    0.2, "share of its range that all other steps of a counter stay below", _CAUSES)
WRAP_BEYOND = Threshold(
    1.1, "multiple of its range that a counter covers without its jumps", _CAUSES)
SAME_NOISE = Threshold(6.0, "standard deviations within which values count as equal", _CAUSES)
SAME_BAND = Threshold(0.01, "share of its range within which values count as equal", _CAUSES)
STOP_SAMPLES = Threshold(
    0.05, "share of the samples at one end of the range that indicates a stop", _CAUSES)
STOP_INPUT = Threshold(0.25, "share of its range that the input covers meanwhile", _CAUSES)
STOP_MOVING = Threshold(0.05, "share of the largest speed from which something moves", _CAUSES)
STOP_PUSHED = Threshold(
    0.2, "share of the time at the stop in which the input pushes towards it", _CAUSES)
# numbers that no actuator has
_UNITS = "tests/assessment/test_implausible.py"
LARGEST_AREA = Threshold(
    0.5, "piston area [m2] (0.8 m across) above which it is in another unit", _UNITS)
LARGEST_VOLUME = Threshold(0.5, "dead volume [m3] above which it is in another unit", _UNITS)
LONGEST_WAY = Threshold(8.0, "stroke of an actuator [m] above which it is in another unit", _UNITS)
FASTEST = Threshold(20.0, "change of speed [m/s] above which it is in another unit", _UNITS)
LEAST_PRESSURE = Threshold(
    3e3, "highest pressure of a chamber [Pa] below which it is in another unit", _UNITS)
LEAST_GIVEN = Threshold(
    1e3, "given pressure [Pa] below which it is in another unit", _UNITS)
VACUUM = Threshold(1.2e5, "pressure below atmosphere [Pa] that is impossible", _UNITS)
# logs that were not fitted: of --validate, and of check
LOG_MISSED = Threshold(
    2.0, "ratio of the rmse of another log to that of a fitted one from which it is missed",
    "tests/cli/test_fit.py; docs/evidence/middle.md")
LOG_SPREADS = Threshold(
    2.0, "multiple of the effect of parameter errors on the output (RMS) that is allowed for",
    "tests/contract/test_check.py")
# verdict
STRUCTURED = Threshold(1e-3, "p-value below which a residual is not white", "tests/test_outcome.py")
TIMES_NOISE = Threshold(
    3.0, "ratio of a structured residual to the noise that is accepted", "tests/test_outcome.py")
FIT_CLOSE = Threshold(99.0, "fit [%] from which that no longer matters", "tests/test_outcome.py")
FIT_WEAK = Threshold(60.0, "fit [%] below which a fit is weak", "tests/test_outcome.py")
FIT_POOR = Threshold(
    30.0, "fit [%] below which a fit has failed: it explains less than half of the variance",
    "tests/test_outcome.py")
NOISE_ALONE = Threshold(
    1.3, "ratio of a white residual to the noise up to which a poor fit has not failed",
    "tests/test_outcome.py")
# fmt: on

POLICY = {n.lower(): t for n, t in globals().items() if isinstance(t, Threshold)}
