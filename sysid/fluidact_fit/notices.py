"""Every warning code: how serious it is, what it means and what to do about it.

The page ``docs/warnings.md`` is made from this table, and a test holds it against the sources.
The message of a notice has the numbers of the case; what stands here holds for all of them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from types import MappingProxyType
from typing import Literal

Severity = Literal["information", "warning"]


@dataclass(frozen=True)
class Code:
    """Meaning of a warning code.

    Attributes
    ----------
    severity
        ``information`` says what was done with the log and leaves the fit as good as it is;
        ``warning`` turns the verdict from ``pass`` to ``warn``.
    meaning
        What was found, one sentence.
    remedy
        What to do, one sentence.
    """

    severity: Severity
    meaning: str
    remedy: str


_information = partial(Code, "information")
_warning = partial(Code, "warning")

_READING = {
    "absolute-pressure": _warning(
        "A pressure is in an absolute unit such as `bara`, and the model counts pressures from the "
        "atmosphere.",
        "Subtract the pressure of the air on that day, or use a gauge sensor.",
    ),
    "angle-doubtful": _warning(
        "An angle seems to wrap around, but not clearly after a full turn.",
        "Give `--unit` if its unit is another, or `--unwrap ROLE=TURN` or `--unwrap ROLE=none`.",
    ),
    "angle-wraps": _information(
        "An angle wraps around after every full turn (or a counter overflows); it was unwrapped.",
        "Nothing; give `--unwrap ROLE=none` if it jumps there.",
    ),
    "clock-doubtful": _information(
        "Clock times may be read in several ways, and the column does not tell which; it was not "
        "read.",
        "Export the times in seconds, or name another column of time.",
    ),
    "clock-midnight": _information(
        "A clock without dates passes midnight (or one without hours the hour); it was continued.",
        "Nothing, if the recording went on; else give --sample-time, or record the date as well.",
    ),
    "clock-of-days": _information(
        "Clock times of four numbers were read as days, hours, minutes and seconds.",
        "Nothing, unless the numbers mean something else; export seconds then.",
    ),
    "clock-set-back": _information(
        "A clock goes back by an hour, as at the end of summer time, or by half a day, as one of "
        "twelve hours; it was continued.",
        "Nothing, if the recording went on; record in UTC to avoid it.",
    ),
    "columns-exchanged": _warning(
        "What was taken for raw readings is in the unit of a quantity, and what they are compared "
        "with is a plain number.",
        "Exchange the two columns, or name the unit of the second with `--unit ROLE=UNIT`.",
    ),
    "comments-left-out": _information(
        "Comments that stand beside samples were left out.",
        "Nothing; they are not measurements.",
    ),
    "constant-signal": _warning(
        "A signal has the same value throughout the log.",
        "Check that the right column was taken and that the sensor was connected.",
    ),
    "cut-last-line": _information(
        "The last line of the log is incomplete and was left out.",
        "Nothing, if the recording was stopped by hand; otherwise check for lost data.",
    ),
    "dates-doubtful": _warning(
        "Dates may be day and month or month and day, and no row tells which.",
        "Export the dates as 2024-05-31, or name another column of time.",
    ),
    "display-scale": _warning(
        "Channels are scaled for display; the numbers were read as they are written.",
        "Check a known value; where the export is not scaled, give --scale ROLE=FACTOR.",
    ),
    "gap": _warning(
        "Samples are missing: the time between two of them is many times the usual sample time.",
        "Where an input may have changed meanwhile, resolve this first: `--exclude time=START:END` "
        "with the ends of the gap makes a run of either side, each with its own beginning. Other "
        "warnings may follow from it.",
    ),
    "header-again": _information(
        "The header is repeated inside the table; the repetition was left out.",
        "Nothing, if the logger was started again; every run is an experiment of its own.",
    ),
    "overprinted-lines": _warning(
        "Lines with an impossible time stamp were left out: two lines were printed as one.",
        "Look at the lines that are named; a slower or buffered serial output avoids them.",
    ),
    "part-recalled": _information(
        "A log was fitted before, and the part of it that was fitted is used again.",
        "Nothing; give `--window` or `--exclude` to use another part.",
    ),
    "partial-lines": _information(
        "Lines with the wrong number of fields, or of text, were left out.",
        "Nothing, if they are few; otherwise check how the log was written.",
    ),
    "placeholder-values": _warning(
        "A few rows of a signal hold one value far from all others, as loggers write for a missing "
        "one.",
        "Leave the rows that are named out with `--exclude lines=FIRST:LAST`.",
    ),
    "read-as-fitted": _information(
        "A log could not be read by itself, and was read with the options of the fit.",
        "Nothing; give `--skip-rows`, `--decimal` and the like for another layout.",
    ),
    "readings-interpolated": _warning(
        "A measured channel follows straight lines between readings that lie further apart than "
        "its rows: the log was resampled, or a slower channel brought to its rate.",
        "Use the log as it was recorded, each channel with its own time.",
    ),
    "readings-repeated": _warning(
        "A channel that moves repeats its last reading in some rows: it is slower than its log.",
        "Record at the rate of the slowest channel, or each channel with its own time.",
    ),
    "recording-cut": _warning(
        "The file ends before the recording that it states; what precedes the cut was read.",
        "Copy the file again, or check how the recording ended and what is missing.",
    ),
    "rows-above-table": _warning(
        "Lines above the table, or above its header, hold numbers and little else; they were left "
        "out.",
        "Look at the lines that are named: correct rows in another form, or give `--header-row` "
        "if they are not rows of the table.",
    ),
    "rows-dropped": _information(
        "Rows with a missing or non-numeric cell were left out, as `--invalid drop` asks for.",
        "Nothing, if they are few; otherwise look at the columns that the message names.",
    ),
    "rows-repeated": _warning(
        "Some rows of a run hold the same readings as others, as rows do that were copied.",
        "Remove the copy from the log: what counts twice makes intervals too short.",
    ),
    "run-too-short": _information(
        "Runs with too few samples to be fitted were left out.",
        "Nothing, unless a run that you need is among them.",
    ),
    "samples-invalid": _information(
        "Samples of a channel with instants of its own are marked invalid, or are not numbers; "
        "they are not used.",
        "Nothing, if they are few; else find out why the recorder marked them.",
    ),
    "saturated": _warning(
        "A measured signal stays at its highest or lowest value for many samples in a row.",
        "Check whether the sensor or its converter was clipped; cut that part with `--window`.",
    ),
    "spikes": _warning(
        "Single samples of a measured signal are isolated spikes; they were replaced by "
        "interpolation.",
        "Check cable, converter and logger; look at the samples that are named.",
    ),
    "statistics-rows": _information(
        "Rows with the mean, deviation, lowest or highest value of the others were left out.",
        "Nothing; look at the lines that are named if they were samples after all.",
    ),
    "time-bases": _information(
        "Columns were sampled at different instants.",
        "Nothing: each is used at its own instants.",
    ),
    "time-contradicted": _warning(
        "`--sample-time` was given, and the time column of the log says something else.",
        "Leave `--sample-time` out unless the column is wrong.",
    ),
    "time-joined": _information(
        "Seconds and their fraction stand in two columns, which were joined to one time.",
        "Nothing.",
    ),
    "time-out-of-order": _warning(
        "Lines whose time is earlier than that of the line before were left out.",
        "Check the lines that are named; `--sample-time` replaces the time column.",
    ),
    "time-replaced": _information(
        "The log has a time column, but `--sample-time` was given and replaces it.",
        "Leave out `--sample-time` to use the recorded times.",
    ),
    "time-restarts": _information(
        "Time starts again within the log; each run was taken as a separate experiment.",
        "Nothing, if the log holds several runs; otherwise check the time column.",
    ),
    "time-ties": _warning(
        "Several samples have the same printed time; they were spread within its last digit.",
        "Record time with more digits.",
    ),
    "time-unit-doubtful": _warning(
        "Time has no unit and was taken as seconds, but looks like milliseconds.",
        "State the unit, for example `--unit time=ms`.",
    ),
    "time-unusable": _warning(
        "The time column cannot be read as time and was ignored; static data need none.",
        "Correct the column, name another one with `--column time=...`, or give `--sample-time`.",
    ),
    "time-wrapped": _information(
        "The time counter overflowed and was continued.",
        "Nothing.",
    ),
    "uneven-sampling": _information(
        "The samples are not equally spaced; they were used at their recorded times.",
        "Nothing, unless the times themselves are doubtful.",
    ),
    "unit-assumed": _information(
        "A column has no unit that is known, so one was assumed, SI as a rule.",
        "Put the unit into the header or give `--unit ROLE=UNIT`.",
    ),
    "unit-overridden": _warning(
        "`--unit` contradicts the unit in the header or the units row of the log; it was used.",
        "Leave `--unit` out if the header is right; correct the header if it is not.",
    ),
    "variables-left-out": _information(
        "Elements of a recording that are not numeric vectors of one length were left out.",
        "Nothing, unless one that you need is among them: `inspect` says why it was left out.",
    ),
}

_JUDGEMENT = {
    "at-given-bound": _warning(
        "A parameter ends where the `--bounds` that were given do.",
        "Widen the bounds; if they are right, look for what the model lacks.",
    ),
    "beginning-left-out": _information(
        "The first part of every run answers to an input before the log began, for as long as the "
        "dead time.",
        "Begin recording at rest; where the logs do, give `--start-state rest`.",
    ),
    "beyond-validity": _warning(
        "An input goes beyond the range that the data of the parameter file covered.",
        "Trust the model there only if its equation is known to hold; else fit logs that go there.",
    ),
    "channel-missed": _warning(
        "A measured channel beside the output, such as a pressure, is missed by more than its "
        "noise: a given number or a recording does not match the machine.",
        "Check the given numbers, the sensors and the clock that the message names.",
    ),
    "closed-loop": _warning(
        "The input reacts to the noise of the output: the log was recorded under feedback, which "
        "biases the parameters.",
        "Record with the controller off, with an added excitation, or with a cleaner sensor.",
    ),
    "compared-in-common": _information(
        "Parameters that depend on what a log covered were compared over what the logs of the file "
        "and those that `check` was given have in common.",
        "Nothing; logs over the same range compare all of it.",
    ),
    "compared-in-part": _information(
        "The logs that `check` was given cannot determine a parameter of the file; it was held as "
        "in the file, and the others were compared with it.",
        "Nothing, or check with logs that determine all parameters, as those of the fit did.",
    ),
    "conditional": _warning(
        "A parameter that the data cannot determine was held at a value, and others would move "
        "with it by more than their intervals say.",
        "Fix the value that the message names if it is known, or record what determines it.",
    ),
    "errors-change-slowly": _warning(
        "The residuals contain slow drift that the intervals do not include.",
        "Look for a sensor that warms up, a supply that wanders or a machine that changes; record "
        "for longer.",
    ),
    "few-independent-samples": _warning(
        "The error of the model changes so slowly that the samples are worth only a few "
        "independent ones for every unknown, which do not show how large the errors are.",
        "Record for longer, with more strokes over the whole range.",
    ),
    "few-samples-decide": _warning(
        "A few samples dominate the result: they lie far from all others, or nothing else in the "
        "logs checks them.",
        "Look at the log where the message says, and cut it with `--window` or correct it.",
    ),
    "halves-disagree": _warning(
        "The two halves of the data give different values of a parameter.",
        "Fit them separately: the machine changed, or the model describes only part of it.",
    ),
    "hold-as-given": _information(
        "A measured input was declared a held command and glides through its samples, and a "
        "parameter depends on what it did in between, which the data cannot determine.",
        "Leave `--hold` out if the column was measured.",
    ),
    "hold-doubtful": _warning(
        "The data fit better if an input is taken to behave differently between its samples.",
        "Say with `--hold` whether the column is a held command or a measured signal.",
    ),
    "hold-matters": _warning(
        "A measured input jumps between its samples, or a command glides through them, and a "
        "parameter depends on what it did in between, which the data cannot determine.",
        "Say with `--hold` whether the column is a held command or a measured signal.",
    ),
    "implausible-number": _warning(
        "A number that was given, or a column, is implausible for an actuator in the unit that it "
        "was taken in, or has an impossible sign.",
        "Give it in SI or with its unit, name the unit of the column with `--unit`, or reverse the "
        "sign with `--scale`.",
    ),
    "input-noise": _information(
        "A measured input is noisy enough to matter; the estimate and its intervals allow for it.",
        "Nothing; a cleaner sensor for that input would narrow the intervals.",
    ),
    "input-noise-left": _warning(
        "A measured input is so noisy that its effect could not be removed altogether.",
        "Record that input with a cleaner sensor or with a larger range of motion.",
    ),
    "log-differs": _warning(
        "One log gives a significantly different value of a parameter than the others do.",
        "Check that it shows the same machine in the same state; leave it out or fit it alone.",
    ),
    "log-unused": _information(
        "No sample of a log was fitted: the model describes none of them.",
        "Leave the log out, or check why (`fit.logs[].left_out`, dead bands, `--window`).",
    ),
    "not-compared": _warning(
        "`check` could not fit the new logs, so only the simulation was compared with them.",
        "Check with logs that determine all parameters, as those of the fit did.",
    ),
    "not-converged": _warning(
        "The search stopped before it had converged.",
        "Check the given constants and units, or give better starting values with `--start`.",
    ),
    "not-identified": _warning(
        "The data cannot determine a parameter; its neutral value, or the limit that the logs "
        "reach, was written instead, with the status `not_identified`.",
        "Do the experiment that the message names; do not use the value.",
    ),
    "outliers": _warning(
        "A few samples lie far outside what the rest of the data allow; they were left out of the "
        "fit.",
        "Look at the log where the message says; check cable, converter and logger.",
    ),
    "poor-fit": _warning(
        "The model explains so little of the output that the fit has failed.",
        "Check columns, units and signs, and whether this family describes the machine.",
    ),
    "prediction-uncertain": _warning(
        "The errors of the parameters in the file move the output that `check` simulates by as "
        "much as it is off: its rmse does not tell whether the machine has changed.",
        "Look at the parameters that are compared; fit a file to several logs of the machine.",
    ),
    "residuals-autocorrelated": _warning(
        "The model misses the output by far more than the noise of the sensor, and not at random: "
        "the machine does something that the model does not describe.",
        "Look at the picture (`--plot`) and judge whether the misfit matters for your use.",
    ),
    "search-bounded": _warning(
        "The search stopped at the number of simulations that a fit may take.",
        "Give `--start` values near the right ones, or hold what is known with `--fix`.",
    ),
    "sign-reversed": _information(
        "A gain is negative: the output falls as the input rises.",
        "Nothing, if the machine reverses the sign; else give `--scale ROLE=-1`.",
    ),
    "timing-matters": _information(
        "If a channel were recorded one sample later, a parameter would change by a good part, "
        "and nothing in the data would show it.",
        "Check that all channels are read at the same instant and filtered alike.",
    ),
    "unexamined": _warning(
        "A measured input is so noisy that nothing would show what the model may lack.",
        "Record that input with a cleaner sensor or with a larger range of motion.",
    ),
    "unmodelled-response": _warning(
        "The residual holds a response that the model does not have (a delay, a lag, a drift, a "
        "parameter that was not asked for), and it moves a parameter by more than its interval.",
        "Do what the message says: estimate or fix what is missing, or look for its cause.",
    ),
    "validation-missed": _warning(
        "A log of `--validate` is missed by far more than the logs that were fitted, and by "
        "more than the errors of the parameters explain.",
        "Check that it shows the same machine in the same state and range; fit it as well if so.",
    ),
    "weak-file": _warning(
        "The parameter file that is checked or exported does not have the verdict `pass`.",
        "Look at the warnings in the file before you rely on its numbers; fit again without their "
        "causes.",
    ),
    "weak-fit": _warning(
        "The model explains only part of the output.",
        "Look at the picture (`--plot`) before you use the numbers.",
    ),
}

_FAMILIES = {
    "asymmetry-or-offset": _warning(
        "The two Coulomb levels differ, which a constant force (the zero of the load cell, weight, "
        "a preload) would look like; motion alone cannot tell the two apart.",
        "Read the load cell unloaded and give `--offset=none` where it shows zero, or "
        "`--offset=free` where friction is the same both ways.",
    ),
    "chamber-not-recorded": _warning(
        "No log holds the pressure of one chamber, so its gain and losses are not in the file.",
        "Record that pressure, in the same run or in another, and give all the logs.",
    ),
    "command-noise": _warning(
        "The command carries noise, which a hysteresis takes for motion and a static level for a "
        "break-away.",
        "Log the command as the controller gives it; give `--hold` if it was measured.",
    ),
    "curve-misses": _warning(
        "The calibration curve misses the readings by more than neighbouring readings scatter.",
        "Look at the picture (`--plot`); try a higher `--degree`, or calibrate the range in use.",
    ),
    "dead-time-not-travel-time": _warning(
        "The dead time of the line is not its length divided by the sound speed.",
        "Look for delays of valve, sensor or bus, or for late time stamps; check `--length`.",
    ),
    "degree-too-high": _warning(
        "Some weights of the curve are hardly determined by the data.",
        "Give a lower `--degree`, or record more samples over the whole range.",
    ),
    "directions-differ": _warning(
        "One static map was fitted, and its output differs between rising and falling inputs.",
        "Give `--branches two` where there is one, or look for play, hysteresis and delays.",
    ),
    "few-positions": _warning(
        "So few positions (or lengths) were recorded, or so wide a gap was left between them, that "
        "they cannot show what is in between.",
        "Record more of them, spread over the whole range.",
    ),
    "force-offset": _warning(
        "The force has an offset, which the data cannot separate from a difference of the two "
        "Coulomb levels; the levels were taken as equal, and only their mean is measured.",
        "Remove the offset (zero the load cell, record the other chamber) and give "
        "`--offset=none`.",
    ),
    "force-spikes": _warning(
        "Some samples of the force, or of a command that is predicted, lie far from all others.",
        "Look at the picture (`--plot`); if the load cell is sound, the model may be wrong there.",
    ),
    "forces-beyond-model": _warning(
        "Forces that the model does not include, such as torque ripple, move the axis by "
        "more than the noise of its position.",
        "Cover the same stretch in both directions at several speeds, or fix the static levels.",
    ),
    "friction-shape": _warning(
        "Another law of friction over speed, with as many unknowns, fits as well or better.",
        "Use the law within the speeds of the logs only; record steady strokes at more speeds.",
    ),
    "inertia-matters": _warning(
        "Inertia is a large part of the force in most samples and was not subtracted.",
        "Weigh the moving parts and give `--mass`.",
    ),
    "input-constant": _warning(
        "An input of the network is the same in all logs, so other values of it are unknown.",
        "Record logs with other values, or leave it out of `--inputs`.",
    ),
    "kept-monotone": _information(
        "The best curve would reverse direction, but not significantly, so it was kept monotone.",
        "Nothing; give `--no-monotone` for the free curve.",
    ),
    "levels-equal": _information(
        "Both friction levels are taken to be equal: the force shows their sum, and not how the "
        "preload shares it.",
        "Give `--fix preload=N` where it is known; `hysteresis_width` holds in any case.",
    ),
    "levels-or-offset": _information(
        "The two Coulomb levels of an axis differ, which a constant torque or force (the zero of "
        "its amplifier or sensor, weight) would look like; motion alone cannot tell the two apart.",
        "Log the drive at rest, unloaded: if it shows zero the levels do differ; `coulomb_mean` "
        "holds in any case.",
    ),
    "logs-disagree": _warning(
        "The friction in a log differs from that of the fit.",
        "Fit logs of different pressure or condition separately; of a log slower than the dead "
        "band, record such speeds with less noise and give `--stribeck=estimate`.",
    ),
    "negative-friction": _warning(
        "A Coulomb level would be negative and was held at zero.",
        "Remove an offset of the force, or record both directions at several speeds.",
    ),
    "not-monotone": _warning(
        "The fitted curve or map reverses direction within the range of the data.",
        "Choose another `--degree` or number of `--hidden` units, or record more data there.",
    ),
    "offset-matters": _warning(
        "A parameter depends on whether the output has an offset, by more than its interval.",
        "Check the zero of the sensors; choose with `--offset none` or `--offset free`.",
    ),
    "one-direction": _warning(
        "The input of a static map moves one way only, so play, hysteresis and delays are hidden.",
        "Record strokes in both directions, in the order in which they were made.",
    ),
    "rails": _information(
        "Readings at the end of the converter's range were left out.",
        "Nothing; a clipped reading says nothing about the position.",
    ),
    "rails-suspected": _warning(
        "The extreme readings look clipped, but the data do not prove it; they were left out.",
        "Look at the picture (`--plot`); give `--rails` as the message says it to keep them.",
    ),
    "saturation-not-reached": _information(
        "The speed keeps growing up to the largest command, so no saturation was found.",
        "Record larger commands if you need `saturation_command`.",
    ),
    "saturation-undecided": _warning(
        "The logs neither show nor rule out a saturation that would move other parameters.",
        "Raise the command further, rest longer at the highest commands, or fix the saturation.",
    ),
    "small-misfit": _information(
        "The calibration curve misses the readings, by less than is worth a warning.",
        "Nothing, the intervals allow for it; a higher `--degree` may follow the sensor better.",
    ),
    "validation-worse": _warning(
        "A map misses the positions that were held out by far more than those it was trained on.",
        "Record more positions, or give fewer `--hidden` units.",
    ),
    "valve-hysteresis": _information(
        "Friction levels fitted from the command of a spring cylinder include the hysteresis of "
        "its valve.",
        "For the friction of the cylinder alone, record the pressure and fit with it.",
    ),
    "weight-at-bound": _warning(
        "Weights of the curve are at their bound, so their intervals are meaningless.",
        "Give another `--degree`.",
    ),
}

# By the part of the work that finds them; the page has one table for each.
GROUPS: Mapping[str, Mapping[str, Code]] = MappingProxyType(
    {
        "Reading the log": _READING,
        "Judging the fit": _JUDGEMENT,
        "Found by a model family": _FAMILIES,
    }
)
CODES: Mapping[str, Code] = MappingProxyType(
    {code: entry for group in GROUPS.values() for code, entry in group.items()}
)


def is_note(code: str) -> bool:
    """Return whether a notice of this code leaves the verdict as it is.

    One that only a later version knows, of a file, does not.
    """
    return code in CODES and CODES[code].severity == "information"
