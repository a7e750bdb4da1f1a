"""Thresholds of the examination: when a warning is raised, or a cause named, in one table.

Those of warnings that a family or an estimator gives stand in their modules, as do the tolerances
of algorithms.
"""

from __future__ import annotations

from dataclasses import dataclass

from ..estimation.results import FEW_INDEPENDENT


@dataclass(frozen=True)
class Threshold:
    """A number that decides about a warning: what it means, and the study or test behind it."""

    value: float
    meaning: str
    evidence: str


_TERMS = "tests/assessment/test_examinations.py; docs/evidence/red-team.md"
_SHAPES = "tests/assessment/test_shapes.py"
_INFLUENCE = "tests/assessment/test_influence.py, test_outliers.py"

POLICY: dict[str, Threshold] = {}


def _declare(name: str, value: float, meaning: str, evidence: str) -> float:
    """Enter a threshold into the table; return its value."""
    POLICY[name] = Threshold(value, meaning, evidence)
    return value


# fmt: off
# the score test of one more term
TERM_SEEN = _declare(
    "term_seen",
    3.0, "standard errors of a term that counts where a parameter would change noticeably",
    _TERMS)
TERM_CERTAIN = _declare(
    "term_certain", 4.0, "standard errors of a term that counts anywhere", _TERMS)
TERM_ONE_SIDED = _declare(
    "term_one_sided",
    0.4, "standard errors fewer for a term that has one possible sign", _TERMS)
TERM_MOVES = _declare(
    "term_moves", 2.0, "standard errors by which a parameter would move", _TERMS)
TERM_MOVES_ONE_SIDED = _declare(
    "term_moves_one_sided",
    1.0, "the same for a term of one possible sign that is seen", _TERMS)
NOTICEABLE = _declare(
    "noticeable", 0.01, "part of a parameter whose change is noticeable", _TERMS)
LEAST = _declare(
    "least",
    5e-4, "part of a parameter whose change no bench can tell",
    "tests/assessment/test_examinations.py: clean strokes")
LEAST_BY_SHAPE = _declare(
    "least_by_shape",
    5e-3, "the same for the shape of a channel: none is quite straight", _SHAPES)
CURVED = _declare(
    "curved",
    0.02, "part of its range by which an input may depart from a line that has one gain",
    "tests/assessment/test_shapes.py: a dead zone within the range of a valve")
PREFER_PARAMETER = _declare(
    "prefer_parameter",
    0.8, "part of the best significance at which a parameter of the family is named instead",
    "tests/assessment/test_examinations.py: a delay")
DIRECTION_LEFT = _declare(
    "direction_left",
    1e-3, "part of a direction that the parameters leave over", _TERMS)
HIDDEN = _declare(
    "hidden", 0.8, "part of the terms that noise of an input hides", _TERMS)
FARTHEST_LAG = _declare(
    "farthest_lag", 10.0, "times a lag that was tried, beyond which nothing is known",
    _TERMS)
# what hangs on given and held numbers
HELD_MOVES = _declare(
    "held_moves",
    5.0, "standard errors by which a parameter hangs on one that was held",
    "tests/assessment/test_examinations.py: a value that nobody knows")
TIMING_MOVES = _declare(
    "timing_moves",
    0.02, "part of a parameter that a channel one sample late changes unseen",
    "tests/families/test_spring_cylinder.py: a late position")
ANYTHING = _declare(
    "anything", 10.0, "times its value that a parameter could be: anything", "wording")
# samples and parts of the data
ODD = _declare(
    "odd", 1e-6, "probability of a residual that large among all", _INFLUENCE)
ODD_MOVES = _declare(
    "odd_moves",
    0.5, "standard errors by which an odd sample may move a parameter", _INFLUENCE)
ANY_MOVES = _declare(
    "any_moves",
    3.0, "standard errors by which any sample may move a parameter", _INFLUENCE)
FAR = _declare(
    "far", 10.0, "standard deviations that no noise reaches", _INFLUENCE)
OUTLIER_SHARE = _declare(
    "outlier_share", 0.005, "largest part of the samples that can be outliers",
    _INFLUENCE)
OUTLIERS = _declare(
    "outliers", 100, "largest number of samples that can be outliers", _INFLUENCE)
OUTLIER_LEVERAGE = _declare(
    "outlier_leverage",
    0.05, "leverage beyond which a sample holds a parameter that no other does", _INFLUENCE)
HALVES = _declare(
    "halves",
    1e-4, "probability of a difference that large between parts of the data, or channels",
    "tests/assessment/test_examinations.py: halves")
HALVES_DIFFER = _declare(
    "halves_differ",
    0.02, "part of a parameter by which halves may differ",
    "tests/assessment/test_examinations.py: halves")
HALVES_KNOW = _declare(
    "halves_know",
    0.04, "part of what is known of a parameter that each half has to know",
    "tests/assessment/test_examinations.py: halves")
FEW = _declare(
    "few", 50, "samples that are too few to judge by", "Ljung-Box needs some tens")
# residuals
CHANCE = _declare(
    "chance",
    1e-5, "probability below which it is no chance",
    "tests/assessment/test_slow_errors.py, tests/test_feedback_and_spikes.py")
ONE_SIDED = _declare(
    "one_sided",
    1.5, "times the correlation with the other side that feedback has",
    "tests/test_feedback_and_spikes.py")
FEEDBACK_BY_NOISE = _declare(
    "feedback_by_noise", 0.7, "correlation within the sample that noise of an input never makes",
    "tests/test_feedback_and_spikes.py: a regulator")
INDEPENDENT = _declare(
    "independent",
    FEW_INDEPENDENT,
    "independent samples an unknown: with fewer, errors of 4 standard errors were seen",
    "tests/assessment/test_examinations.py: errors that last")
WIDER = _declare(
    "wider",
    1.5, "times its standard error by which blocks show a parameter to be uncertain",
    "tests/assessment/test_slow_errors.py")
CHANNEL_MISSED = _declare(
    "channel_missed",
    1.15, "times its noise by which a channel is missed", "docs/evidence/red-team.md")
HOLD_EVIDENCE = _declare(
    "hold_evidence",
    7.0, "log-likelihood that tells one hold from another: a thousand to one",
    "tests/families/test_transfer.py: the wrong hold")
HOLD_EXPLAINS = _declare(
    "hold_explains",
    0.7, "part of the residual that another hold leaves at most where forces are in it",
    "tests/families/test_transfer.py")
HOLD_MOVES = _declare(
    "hold_moves", 0.2, "part of the samples in which a command moves that may not be held",
    "tests/families/test_transfer.py")
HOLD_JUMP = _declare(
    "hold_jump", 0.25, "part of its range that an input crosses in one sample when it jumps",
    "tests/families/test_transfer.py")
# causes that are named where a fit is refused
_CAUSES = "tests/assessment/test_refusal_causes.py"
CAUSE_SAMPLES = _declare(
    "cause_samples", 200, "samples of a log that shows a cause", _CAUSES)
SWAPPED = _declare(
    "swapped", 4.0,
    "ratio of following to preceding correlation at which two columns count as swapped", _CAUSES)
LEADS_AGREE = _declare(
    "leads_agree", 0.5, "part of the largest correlation, from which on two signals agree", _CAUSES)
LEADS_LATER = _declare(
    "leads_later", 3.0, "times the other lag that a lag is, where it tells which is first", _CAUSES)
LEADS_CHANCE = _declare(
    "leads_chance", 5.0, "standard deviations of a correlation by chance", _CAUSES)
SIGN_CORRELATION = _declare(
    "sign_correlation", 0.5, "correlation with the input that tells its sign", _CAUSES)
SIGN_ASIDE = _declare(
    "sign_aside", 0.8, "largest share of that correlation that the opposite sign may have",
    _CAUSES)
SIDES_DIFFER = _declare(
    "sides_differ", 1.5, "times the response to the other sign, which equal sides do not give",
    _CAUSES)
ONE_SIGNAL = _declare(
    "one_signal", 0.004, "part of its range by which two sensors of one quantity differ", _CAUSES)
WRAP_JUMPS = _declare(
    "wrap_jumps", 0.6, "part of its range that a counter jumps by where it begins again", _CAUSES)
WRAP_OTHERWISE = _declare(
    "wrap_otherwise", 0.2, "part of its range, below which all other steps of a counter are",
    _CAUSES)
WRAP_BEYOND = _declare(
    "wrap_beyond", 1.1, "times its range, over which a counter goes on without its jumps", _CAUSES)
SAME_NOISE = _declare(
    "same_noise", 6.0, "standard deviations within which a value is the same", _CAUSES)
SAME_BAND = _declare(
    "same_band", 0.01, "part of its range within which a value is the same", _CAUSES)
STOP_SAMPLES = _declare(
    "stop_samples", 0.05, "part of the samples at one end of the range, where there is a stop",
    _CAUSES)
STOP_INPUT = _declare(
    "stop_input", 0.25, "part of its range that the input changes meanwhile", _CAUSES)
STOP_MOVING = _declare(
    "stop_moving", 0.05, "part of the largest speed, at which something moves", _CAUSES)
STOP_PUSHED = _declare(
    "stop_pushed", 0.2, "share of the time at the stop in which the input pushes away from it",
    _CAUSES)
# numbers that no actuator has
_UNITS = "tests/assessment/test_implausible.py"
LARGEST_AREA = _declare(
    "largest_area", 0.5, "piston area [m2] (0.8 m across) above which it is in another unit",
    _UNITS)
LARGEST_VOLUME = _declare(
    "largest_volume", 0.5, "dead volume [m3] above which it is in another unit", _UNITS)
LONGEST_WAY = _declare(
    "longest_way", 8.0, "way of an actuator [m] above which it is in another unit", _UNITS)
FASTEST = _declare(
    "fastest", 20.0, "change of speed [m/s] above which it is in another unit", _UNITS)
LEAST_PRESSURE = _declare(
    "least_pressure",
    3e3, "highest pressure of a chamber [Pa] below which it is in another unit", _UNITS)
LEAST_GIVEN = _declare(
    "least_given", 1e3, "pressure [Pa] that is given, below which it is in another unit", _UNITS)
VACUUM = _declare(
    "vacuum", 1.2e5, "pressure below the atmosphere [Pa] that there cannot be", _UNITS)
# verdict
STRUCTURED = _declare(
    "structured", 1e-3, "probability of a residual that is not white",
    "tests/test_outcome.py")
TIMES_NOISE = _declare(
    "times_noise", 3.0, "times the noise that a structured residual may be",
    "tests/test_outcome.py")
FIT_CLOSE = _declare(
    "fit_close", 99.0, "fit [%] at which that no longer matters", "tests/test_outcome.py")
FIT_WEAK = _declare(
    "fit_weak", 60.0, "fit [%] below which a fit is weak", "tests/test_outcome.py")
FIT_POOR = _declare(
    "fit_poor",
    30.0, "fit [%] below which a fit has failed: it explains less than half of the variance",
    "tests/test_outcome.py")
NOISE_ALONE = _declare(
    "noise_alone",
    1.3, "times its noise that a white residual may be, for a fit that has not failed",
    "tests/test_outcome.py")
