"""Thresholds of the examination: when a warning is raised, or a cause named, in one table.

Those of warnings that a family or an estimator gives stand in their modules, as do the tolerances
of algorithms.
"""

from __future__ import annotations

from typing import Self

from ..estimation import results


class Threshold(float):
    """A number that decides about a warning: what it means, and the study or test behind it."""

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
    3.0, "standard errors of a term that counts where a parameter would change noticeably", _TERMS)
TERM_CERTAIN = Threshold(4.0, "standard errors of a term that counts anywhere", _TERMS)
TERM_ONE_SIDED = Threshold(
    0.4, "standard errors fewer for a term that has one possible sign", _TERMS)
TERM_MOVES = Threshold(2.0, "standard errors by which a parameter would move", _TERMS)
TERM_MOVES_ONE_SIDED = Threshold(
    1.0, "the same for a term of one possible sign that is seen", _TERMS)
NOTICEABLE = Threshold(0.01, "part of a parameter whose change is noticeable", _TERMS)
LEAST = Threshold(
    5e-4, "part of a parameter whose change no bench can tell",
    "tests/assessment/test_examinations.py: clean strokes")
LEAST_BY_SHAPE = Threshold(
    5e-3, "the same for the shape of a channel: none is quite straight", _SHAPES)
CURVED = Threshold(
    0.02, "part of its range by which an input may depart from a line that has one gain",
    "tests/assessment/test_shapes.py: a dead zone within the range of a valve")
PREFER_PARAMETER = Threshold(
    0.8, "part of the best significance at which a parameter of the family is named instead",
    "tests/assessment/test_examinations.py: a delay")
DIRECTION_LEFT = Threshold(1e-3, "part of a direction that the parameters leave over", _TERMS)
HIDDEN = Threshold(0.8, "part of the terms that noise of an input hides", _TERMS)
FARTHEST_LAG = Threshold(10.0, "times a lag that was tried, beyond which nothing is known", _TERMS)
# what hangs on given and held numbers
HELD_MOVES = Threshold(
    5.0, "standard errors by which a parameter hangs on one that was held",
    "tests/assessment/test_examinations.py: a value that nobody knows")
TIMING_MOVES = Threshold(
    0.02, "part of a parameter that a channel one sample late changes unseen",
    "tests/families/test_spring_cylinder.py: a late position")
ANYTHING = Threshold(
    results.ANYTHING, "times its value that a parameter could be: anything", "wording")
# samples and parts of the data
ODD = Threshold(1e-6, "probability of a residual that large among all", _INFLUENCE)
ODD_MOVES = Threshold(
    0.5, "standard errors by which an odd sample may move a parameter", _INFLUENCE)
ANY_MOVES = Threshold(3.0, "standard errors by which any sample may move a parameter", _INFLUENCE)
FAR = Threshold(10.0, "standard deviations that no noise reaches", _INFLUENCE)
OUTLIER_SHARE = Threshold(0.005, "largest part of the samples that can be outliers", _INFLUENCE)
OUTLIERS = Threshold(100.0, "largest number of samples that can be outliers", _INFLUENCE)
OUTLIER_LEVERAGE = Threshold(
    0.05, "leverage beyond which a sample holds a parameter that no other does", _INFLUENCE)
HALVES = Threshold(
    1e-4, "probability of a difference that large between parts of the data, or channels",
    "tests/assessment/test_examinations.py: halves")
HALVES_DIFFER = Threshold(
    0.02, "part of a parameter by which halves may differ",
    "tests/assessment/test_examinations.py: halves")
HALVES_KNOW = Threshold(
    0.04, "part of what is known of a parameter that each half has to know",
    "tests/assessment/test_examinations.py: halves")
FEW = Threshold(50.0, "samples that are too few to judge by", "Ljung-Box needs some tens")
# residuals
CHANCE = Threshold(
    1e-5, "probability below which it is no chance",
    "tests/assessment/test_slow_errors.py, tests/test_feedback_and_spikes.py")
ONE_SIDED = Threshold(
    1.5, "times the correlation with the other side that feedback has",
    "tests/test_feedback_and_spikes.py")
FEEDBACK_BY_NOISE = Threshold(
    0.7, "correlation within the sample that noise of an input never makes",
    "tests/test_feedback_and_spikes.py: a regulator")
INDEPENDENT = Threshold(
    results.FEW_INDEPENDENT,
    "independent samples an unknown: with fewer, errors of 4 standard errors were seen",
    "tests/assessment/test_examinations.py: errors that last")
WIDER = Threshold(
    1.5, "times its standard error by which blocks show a parameter to be uncertain",
    "tests/assessment/test_slow_errors.py")
CHANNEL_MISSED = Threshold(
    1.15, "times its noise by which a channel is missed", "docs/evidence/red-team.md")
HOLD_EVIDENCE = Threshold(
    7.0, "log-likelihood that tells one hold from another: a thousand to one",
    "tests/families/test_transfer.py: the wrong hold")
HOLD_EXPLAINS = Threshold(
    0.7, "part of the residual that another hold leaves at most where forces are in it",
    "tests/families/test_transfer.py")
HOLD_MOVES = Threshold(
    0.2, "part of the samples in which a command moves that may not be held",
    "tests/families/test_transfer.py")
HOLD_JUMP = Threshold(
    0.25, "part of its range that an input crosses in one sample when it jumps",
    "tests/families/test_transfer.py")
# causes that are named where a fit is refused
_CAUSES = "tests/assessment/test_refusal_causes.py"
CAUSE_SAMPLES = Threshold(200.0, "samples of a log that shows a cause", _CAUSES)
LEADS_AGREE = Threshold(
    0.5, "part of the largest correlation, from which on two signals agree", _CAUSES)
LEADS_LATER = Threshold(
    3.0, "times the other lag that a lag is, where it tells which is first", _CAUSES)
LEADS_CHANCE = Threshold(5.0, "standard deviations of a correlation by chance", _CAUSES)
SIGN_CORRELATION = Threshold(0.5, "correlation with the input that tells its sign", _CAUSES)
SIGN_ASIDE = Threshold(
    0.8, "largest share of that correlation that the opposite sign may have", _CAUSES)
SIDES_DIFFER = Threshold(
    1.5, "times the response to the other sign, which equal sides do not give", _CAUSES)
ONE_SIGNAL = Threshold(
    0.004, "part of its range by which two sensors of one quantity differ", _CAUSES)
WRAP_JUMPS = Threshold(
    0.6, "part of its range that a counter jumps by where it begins again", _CAUSES)
WRAP_OTHERWISE = Threshold(
    0.2, "part of its range, below which all other steps of a counter are", _CAUSES)
WRAP_BEYOND = Threshold(
    1.1, "times its range, over which a counter goes on without its jumps", _CAUSES)
SAME_NOISE = Threshold(6.0, "standard deviations within which a value is the same", _CAUSES)
SAME_BAND = Threshold(0.01, "part of its range within which a value is the same", _CAUSES)
STOP_SAMPLES = Threshold(
    0.05, "part of the samples at one end of the range, where there is a stop", _CAUSES)
STOP_INPUT = Threshold(0.25, "part of its range that the input changes meanwhile", _CAUSES)
STOP_MOVING = Threshold(0.05, "part of the largest speed, at which something moves", _CAUSES)
STOP_PUSHED = Threshold(
    0.2, "share of the time at the stop in which the input pushes away from it", _CAUSES)
# numbers that no actuator has
_UNITS = "tests/assessment/test_implausible.py"
LARGEST_AREA = Threshold(
    0.5, "piston area [m2] (0.8 m across) above which it is in another unit", _UNITS)
LARGEST_VOLUME = Threshold(0.5, "dead volume [m3] above which it is in another unit", _UNITS)
LONGEST_WAY = Threshold(8.0, "way of an actuator [m] above which it is in another unit", _UNITS)
FASTEST = Threshold(20.0, "change of speed [m/s] above which it is in another unit", _UNITS)
LEAST_PRESSURE = Threshold(
    3e3, "highest pressure of a chamber [Pa] below which it is in another unit", _UNITS)
LEAST_GIVEN = Threshold(
    1e3, "pressure [Pa] that is given, below which it is in another unit", _UNITS)
VACUUM = Threshold(1.2e5, "pressure below the atmosphere [Pa] that there cannot be", _UNITS)
# verdict
STRUCTURED = Threshold(1e-3, "probability of a residual that is not white", "tests/test_outcome.py")
TIMES_NOISE = Threshold(
    3.0, "times the noise that a structured residual may be", "tests/test_outcome.py")
FIT_CLOSE = Threshold(99.0, "fit [%] at which that no longer matters", "tests/test_outcome.py")
FIT_WEAK = Threshold(60.0, "fit [%] below which a fit is weak", "tests/test_outcome.py")
FIT_POOR = Threshold(
    30.0, "fit [%] below which a fit has failed: it explains less than half of the variance",
    "tests/test_outcome.py")
NOISE_ALONE = Threshold(
    1.3, "times its noise that a white residual may be, for a fit that has not failed",
    "tests/test_outcome.py")
# fmt: on

POLICY = {n.lower(): t for n, t in globals().items() if isinstance(t, Threshold)}
