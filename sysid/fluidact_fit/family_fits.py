"""One function per family: its options as keywords with their types and help.

Made from what the families declare; ``make docs`` writes it anew, and ``make style`` fails where
it is out of date. Each hands all that it is given to :func:`.fit`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Literal

from .fitting import fit
from .logs import LogLike, StepInput
from .logs.log import Invalid
from .result import FitResult

# fmt: off
# [[[cog import fit_functions; print(fit_functions.names()); print(fit_functions.functions()) ]]]
__all__ = [
    "fit_backlash", "fit_ball_screw", "fit_cylinder_friction", "fit_flow_map", "fit_force_map",
    "fit_hydraulic_cylinder", "fit_hydraulic_motor", "fit_hydrostatic", "fit_line",
    "fit_potentiometer", "fit_spring_cylinder", "fit_valve"
]


def fit_potentiometer(
    logs: Sequence[LogLike] | Iterator[LogLike] | LogLike, *, degree: str | int = "auto",
    endpoints: Literal["free", "fixed"] = "free", branches: Literal["pooled", "two"] = "pooled",
    monotone: bool | None = None, rails: tuple[float, float] | None = None,
    columns: Mapping[str, str] | None = None, units: Mapping[str, str] | None = None,
    scales: Mapping[str, float] | None = None, sample_time: float | None = None,
    window: tuple[float | None, float | None] | None = None, hold: Mapping[str, str] | None = None,
    fixed: Mapping[str, float | str] | None = None, start: Mapping[str, float | str] | None = None,
    bounds: Mapping[str, tuple[float | str, float | str]] | None = None,
    noise: Mapping[str, float | str] | None = None, validate: Sequence[LogLike] | LogLike = (),
    validate_window: tuple[float | None, float | None] | None = None,
    controller_sample_time: float | None = None, strict: bool = False, seed: int = 0,
    progress: Callable[[str], None] | None = None, exclude: Sequence[str] | str | None = None,
    exclude_rows: Sequence[str] | str | None = None,
    set: Mapping[str, str] | Sequence[str] | None = None,
    steps: Mapping[str, StepInput] | None = None, unwrap: Mapping[str, float | str] | None = None,
    constants: Mapping[str, str] | None = None, from_name: Mapping[str, str] | None = None,
    invalid: Invalid | None = None, decimal: str | None = None, thousands: str | None = None,
    delimiter: str | None = None, skip_rows: int | None = None, header_row: int | None = None,
) -> FitResult:
    """Potentiometer or other sensor: rational Bezier calibration of the raw reading.

    ::

        reference = sum(weights[i] B_i(t) control_points[i]) / sum(weights[i] B_i(t)), t = (reading
        - reading_range[0]) / (reading_range[1] - reading_range[0])

    Roles: ``reading`` [1], ``reference`` [m or rad or Pa or N or N m or 1], ``time`` [s]
    (optional).

    Parameters of the result: ``control_points`` [m], ``weights`` [1], ``reading_range`` [1],
    ``control_points_falling`` [m], ``weights_falling`` [1], ``hysteresis_dead_band`` [1].

    Parameters
    ----------
    logs
        Paths, DataFrames, mappings of header to array, or read logs.
    degree
        Degree of the curve, 1 to 8, or auto for cross-validation.
    endpoints
        Free, or fixed at the mean reference of the end readings.
    branches
        One curve for both directions of motion, or one for each.
    monotone
        Keep the curve from turning back (default: unless the data say that it does).
    rails
        Readings at or beyond these are clipped and left out: two numbers, the lower one first.
    hold, fixed, start, bounds, noise, validate, validate_window, controller_sample_time, strict
        As in :func:`.fit`.
    seed, progress
        As in :func:`.fit`.
    columns, units, scales, sample_time, window, exclude, exclude_rows, set, steps, unwrap
        How logs are read: as in :func:`.read_log` and :class:`.logs.Reading`.
    constants, from_name, invalid, decimal, thousands, delimiter, skip_rows, header_row
        How logs are read: as in :func:`.read_log` and :class:`.logs.Reading`.

    Returns
    -------
    FitResult

    Raises
    ------
    UsageError, LogError, NotIdentifiedError
        With what was found, where, and what to do.
    StrictError
        When there is a warning or a note under ``strict``.
    """
    return fit("potentiometer", **locals())


def fit_ball_screw(
    logs: Sequence[LogLike] | Iterator[LogLike] | LogLike, *,
    viscous: Literal["symmetric", "asymmetric"] = "symmetric",
    stribeck: Literal["none", "estimate"] = "none", columns: Mapping[str, str] | None = None,
    units: Mapping[str, str] | None = None, scales: Mapping[str, float] | None = None,
    sample_time: float | None = None, window: tuple[float | None, float | None] | None = None,
    hold: Mapping[str, str] | None = None, fixed: Mapping[str, float | str] | None = None,
    start: Mapping[str, float | str] | None = None,
    bounds: Mapping[str, tuple[float | str, float | str]] | None = None,
    noise: Mapping[str, float | str] | None = None, validate: Sequence[LogLike] | LogLike = (),
    validate_window: tuple[float | None, float | None] | None = None,
    controller_sample_time: float | None = None, strict: bool = False, seed: int = 0,
    progress: Callable[[str], None] | None = None, exclude: Sequence[str] | str | None = None,
    exclude_rows: Sequence[str] | str | None = None,
    set: Mapping[str, str] | Sequence[str] | None = None,
    steps: Mapping[str, StepInput] | None = None, unwrap: Mapping[str, float | str] | None = None,
    constants: Mapping[str, str] | None = None, from_name: Mapping[str, str] | None = None,
    invalid: Invalid | None = None, decimal: str | None = None, thousands: str | None = None,
    delimiter: str | None = None, skip_rows: int | None = None, header_row: int | None = None,
) -> FitResult:
    """Ball-screw drive: inertia, viscous friction and four Coulomb levels.

    ::

        inertia * angle'' = torque - viscous * angle' - friction(direction), stuck below breakaway;
        friction = coulomb (+ (breakaway - coulomb) * exp(-angle'^2 / stribeck_speed^2))

    Roles (rotary): ``time`` [s], ``torque`` [N m], ``angle`` [rad].

    Parameters of the result (rotary): ``inertia`` [kg m2], ``viscous`` [N m s/rad],
    ``viscous_positive`` [N m s/rad], ``viscous_negative`` [N m s/rad], ``coulomb_positive`` [N m],
    ``coulomb_negative`` [N m], ``breakaway_positive`` [N m], ``breakaway_negative`` [N m],
    ``stribeck_speed`` [rad/s].

    Roles (linear): ``time`` [s], ``force`` [N], ``position`` [m].

    Parameters of the result (linear): ``mass`` [kg], ``viscous`` [N s/m], ``viscous_positive`` [N
    s/m], ``viscous_negative`` [N s/m], ``coulomb_positive`` [N], ``coulomb_negative`` [N],
    ``breakaway_positive`` [N], ``breakaway_negative`` [N], ``stribeck_speed`` [m/s].

    Parameters
    ----------
    logs
        Paths, DataFrames, mappings of header to array, or read logs.
    viscous
        One viscous value, or one per direction.
    stribeck
        Whether to estimate how friction rises at low speed.
    hold, fixed, start, bounds, noise, validate, validate_window, controller_sample_time, strict
        As in :func:`.fit`.
    seed, progress
        As in :func:`.fit`.
    columns, units, scales, sample_time, window, exclude, exclude_rows, set, steps, unwrap
        How logs are read: as in :func:`.read_log` and :class:`.logs.Reading`.
    constants, from_name, invalid, decimal, thousands, delimiter, skip_rows, header_row
        How logs are read: as in :func:`.read_log` and :class:`.logs.Reading`.

    Returns
    -------
    FitResult

    Raises
    ------
    UsageError, LogError, NotIdentifiedError
        With what was found, where, and what to do.
    StrictError
        When there is a warning or a note under ``strict``.
    """
    return fit("ball-screw", **locals())


def fit_hydrostatic(
    logs: Sequence[LogLike] | Iterator[LogLike] | LogLike, *,
    start_state: Literal["rest", "free"] | None = None,
    offset: Literal["none", "free"] | None = None, stiffness: Literal["none", "estimate"] = "none",
    dead_time: Literal["none", "estimate"] = "none", columns: Mapping[str, str] | None = None,
    units: Mapping[str, str] | None = None, scales: Mapping[str, float] | None = None,
    sample_time: float | None = None, window: tuple[float | None, float | None] | None = None,
    hold: Mapping[str, str] | None = None, fixed: Mapping[str, float | str] | None = None,
    start: Mapping[str, float | str] | None = None,
    bounds: Mapping[str, tuple[float | str, float | str]] | None = None,
    noise: Mapping[str, float | str] | None = None, validate: Sequence[LogLike] | LogLike = (),
    validate_window: tuple[float | None, float | None] | None = None,
    controller_sample_time: float | None = None, strict: bool = False, seed: int = 0,
    progress: Callable[[str], None] | None = None, exclude: Sequence[str] | str | None = None,
    exclude_rows: Sequence[str] | str | None = None,
    set: Mapping[str, str] | Sequence[str] | None = None,
    steps: Mapping[str, StepInput] | None = None, unwrap: Mapping[str, float | str] | None = None,
    constants: Mapping[str, str] | None = None, from_name: Mapping[str, str] | None = None,
    invalid: Invalid | None = None, decimal: str | None = None, thousands: str | None = None,
    delimiter: str | None = None, skip_rows: int | None = None, header_row: int | None = None,
) -> FitResult:
    """Hydrostatic transmission: dead zone, mass and damping.

    ::

        mass x'' + damping x' (+ stiffness x) = dead_zone(force)

    Roles: ``time`` [s], ``force`` [N], ``position`` [m].

    Parameters of the result: ``mass`` [kg], ``damping`` [N s/m], ``stiffness`` [N/m],
    ``dead_zone_negative`` [N], ``dead_zone_positive`` [N], ``dead_time`` [s].

    Parameters
    ----------
    logs
        Paths, DataFrames, mappings of header to array, or read logs.
    start_state
        Whether the runs begin at rest or in any state.
    offset
        Whether the output has an offset.
    stiffness
        Whether to estimate a spring.
    dead_time
        Whether to estimate a dead time.
    hold, fixed, start, bounds, noise, validate, validate_window, controller_sample_time, strict
        As in :func:`.fit`.
    seed, progress
        As in :func:`.fit`.
    columns, units, scales, sample_time, window, exclude, exclude_rows, set, steps, unwrap
        How logs are read: as in :func:`.read_log` and :class:`.logs.Reading`.
    constants, from_name, invalid, decimal, thousands, delimiter, skip_rows, header_row
        How logs are read: as in :func:`.read_log` and :class:`.logs.Reading`.

    Returns
    -------
    FitResult

    Raises
    ------
    UsageError, LogError, NotIdentifiedError
        With what was found, where, and what to do.
    StrictError
        When there is a warning or a note under ``strict``.
    """
    return fit("hydrostatic", **locals())


def fit_valve(
    logs: Sequence[LogLike] | Iterator[LogLike] | LogLike, *,
    start_state: Literal["rest", "free"] | None = None,
    offset: Literal["none", "free"] | None = None, dead_time: Literal["none", "estimate"] = "none",
    zero: Literal["none", "estimate"] = "none", columns: Mapping[str, str] | None = None,
    units: Mapping[str, str] | None = None, scales: Mapping[str, float] | None = None,
    sample_time: float | None = None, window: tuple[float | None, float | None] | None = None,
    hold: Mapping[str, str] | None = None, fixed: Mapping[str, float | str] | None = None,
    start: Mapping[str, float | str] | None = None,
    bounds: Mapping[str, tuple[float | str, float | str]] | None = None,
    noise: Mapping[str, float | str] | None = None, validate: Sequence[LogLike] | LogLike = (),
    validate_window: tuple[float | None, float | None] | None = None,
    controller_sample_time: float | None = None, strict: bool = False, seed: int = 0,
    progress: Callable[[str], None] | None = None, exclude: Sequence[str] | str | None = None,
    exclude_rows: Sequence[str] | str | None = None,
    set: Mapping[str, str] | Sequence[str] | None = None,
    steps: Mapping[str, StepInput] | None = None, unwrap: Mapping[str, float | str] | None = None,
    constants: Mapping[str, str] | None = None, from_name: Mapping[str, str] | None = None,
    invalid: Invalid | None = None, decimal: str | None = None, thousands: str | None = None,
    delimiter: str | None = None, skip_rows: int | None = None, header_row: int | None = None,
) -> FitResult:
    """Valve: gain, natural frequency and damping ratio.

    ::

        outlet(s)/command(s) = gain * natural_frequency^2 (* (zero_time_constant s + 1)) *
        exp(-dead_time s) / (s^2 + 2 damping_ratio natural_frequency s + natural_frequency^2)

    Roles: ``time`` [s], ``command`` [V or A or 1], ``outlet`` [Pa or m3/s or V or 1].

    Parameters of the result: ``gain`` [Pa/V], ``natural_frequency`` [rad/s], ``damping_ratio`` [1],
    ``dead_time`` [s], ``zero_time_constant`` [s].

    Parameters
    ----------
    logs
        Paths, DataFrames, mappings of header to array, or read logs.
    start_state
        Whether the runs begin at rest or in any state.
    offset
        Whether the output has an offset.
    dead_time
        Whether to estimate a dead time.
    zero
        Whether to estimate a zero.
    hold, fixed, start, bounds, noise, validate, validate_window, controller_sample_time, strict
        As in :func:`.fit`.
    seed, progress
        As in :func:`.fit`.
    columns, units, scales, sample_time, window, exclude, exclude_rows, set, steps, unwrap
        How logs are read: as in :func:`.read_log` and :class:`.logs.Reading`.
    constants, from_name, invalid, decimal, thousands, delimiter, skip_rows, header_row
        How logs are read: as in :func:`.read_log` and :class:`.logs.Reading`.

    Returns
    -------
    FitResult

    Raises
    ------
    UsageError, LogError, NotIdentifiedError
        With what was found, where, and what to do.
    StrictError
        When there is a warning or a note under ``strict``.
    """
    return fit("valve", **locals())


def fit_line(
    logs: Sequence[LogLike] | Iterator[LogLike] | LogLike, *,
    start_state: Literal["rest", "free"] | None = None,
    offset: Literal["none", "free"] | None = None, length: float | str | None = None,
    sound_speed: float | str | None = None, order: Literal["first", "second"] = "first",
    columns: Mapping[str, str] | None = None, units: Mapping[str, str] | None = None,
    scales: Mapping[str, float] | None = None, sample_time: float | None = None,
    window: tuple[float | None, float | None] | None = None, hold: Mapping[str, str] | None = None,
    fixed: Mapping[str, float | str] | None = None, start: Mapping[str, float | str] | None = None,
    bounds: Mapping[str, tuple[float | str, float | str]] | None = None,
    noise: Mapping[str, float | str] | None = None, validate: Sequence[LogLike] | LogLike = (),
    validate_window: tuple[float | None, float | None] | None = None,
    controller_sample_time: float | None = None, strict: bool = False, seed: int = 0,
    progress: Callable[[str], None] | None = None, exclude: Sequence[str] | str | None = None,
    exclude_rows: Sequence[str] | str | None = None,
    set: Mapping[str, str] | Sequence[str] | None = None,
    steps: Mapping[str, StepInput] | None = None, unwrap: Mapping[str, float | str] | None = None,
    constants: Mapping[str, str] | None = None, from_name: Mapping[str, str] | None = None,
    invalid: Invalid | None = None, decimal: str | None = None, thousands: str | None = None,
    delimiter: str | None = None, skip_rows: int | None = None, header_row: int | None = None,
) -> FitResult:
    """Transmission line: gain, time constant and dead time.

    ::

        outlet(s)/inlet(s) = gain * exp(-dead_time s) / (time_constant s + 1 (+ time_constant
        second_time_constant s^2))

    Roles (line): ``time`` [s], ``inlet`` [Pa or V or A or 1], ``outlet`` [Pa or V or A or 1].

    Parameters of the result (line): ``gain`` [1], ``time_constant`` [s], ``dead_time`` [s],
    ``second_time_constant`` [s].

    Roles (command): ``time`` [s], ``command`` [V or A or 1], ``outlet`` [Pa or V or 1].

    Parameters of the result (command): ``gain`` [Pa/V], ``time_constant`` [s], ``dead_time`` [s],
    ``second_time_constant`` [s].

    Parameters
    ----------
    logs
        Paths, DataFrames, mappings of header to array, or read logs.
    start_state
        Whether the runs begin at rest or in any state.
    offset
        Whether the output has an offset.
    length
        Length, to compare the dead time with: a number above 0 [m].
    sound_speed
        Sound speed in the line: a number above 0 [m/s].
    order
        Whether to estimate one time constant, or two.
    hold, fixed, start, bounds, noise, validate, validate_window, controller_sample_time, strict
        As in :func:`.fit`.
    seed, progress
        As in :func:`.fit`.
    columns, units, scales, sample_time, window, exclude, exclude_rows, set, steps, unwrap
        How logs are read: as in :func:`.read_log` and :class:`.logs.Reading`.
    constants, from_name, invalid, decimal, thousands, delimiter, skip_rows, header_row
        How logs are read: as in :func:`.read_log` and :class:`.logs.Reading`.

    Returns
    -------
    FitResult

    Raises
    ------
    UsageError, LogError, NotIdentifiedError
        With what was found, where, and what to do.
    StrictError
        When there is a warning or a note under ``strict``.
    """
    return fit("line", **locals())


def fit_cylinder_friction(
    logs: Sequence[LogLike] | Iterator[LogLike] | LogLike, *, area: float | str | None = None,
    area_2: float | str | None = None, pressures: Literal["resist", "drive"] = "resist",
    mass: float | str | None = None, inertia: float | str | None = None,
    filter: float | str | None = None, deadband: float | str | None = None,
    offset: Literal["auto", "none", "free"] = "auto",
    stribeck: Literal["none", "estimate"] = "none",
    viscous: Literal["symmetric", "asymmetric"] = "symmetric",
    columns: Mapping[str, str] | None = None, units: Mapping[str, str] | None = None,
    scales: Mapping[str, float] | None = None, sample_time: float | None = None,
    window: tuple[float | None, float | None] | None = None, hold: Mapping[str, str] | None = None,
    fixed: Mapping[str, float | str] | None = None, start: Mapping[str, float | str] | None = None,
    bounds: Mapping[str, tuple[float | str, float | str]] | None = None,
    noise: Mapping[str, float | str] | None = None, validate: Sequence[LogLike] | LogLike = (),
    validate_window: tuple[float | None, float | None] | None = None,
    controller_sample_time: float | None = None, strict: bool = False, seed: int = 0,
    progress: Callable[[str], None] | None = None, exclude: Sequence[str] | str | None = None,
    exclude_rows: Sequence[str] | str | None = None,
    set: Mapping[str, str] | Sequence[str] | None = None,
    steps: Mapping[str, StepInput] | None = None, unwrap: Mapping[str, float | str] | None = None,
    constants: Mapping[str, str] | None = None, from_name: Mapping[str, str] | None = None,
    invalid: Invalid | None = None, decimal: str | None = None, thousands: str | None = None,
    delimiter: str | None = None, skip_rows: int | None = None, header_row: int | None = None,
) -> FitResult:
    """Friction of a cylinder: Coulomb levels by direction and viscous friction.

    ::

        force - (area * pressure - area_2 * pressure_2) - mass * acceleration = coulomb_positive [v
        > 0] - coulomb_negative [v < 0] + viscous * v (+ sign(v) * stribeck * exp(-v^2 /
        stribeck_speed^2)), v the velocity; without a force, area * pressure - area_2 * pressure_2
        drives, and with --pressures=drive against the force of a load; torque, inertia and angular
        velocity of a shaft alike

    Roles (velocity): ``time`` [s] (optional), ``force`` [N], ``velocity`` [m/s], ``pressure`` [Pa]
    (optional), ``pressure_2`` [Pa] (optional).

    Parameters of the result (velocity): ``viscous`` [N s/m], ``viscous_positive`` [N s/m],
    ``viscous_negative`` [N s/m], ``coulomb_positive`` [N], ``coulomb_negative`` [N], ``stribeck``
    [N], ``stribeck_speed`` [m/s].

    Roles (position): ``time`` [s], ``force`` [N], ``position`` [m], ``pressure`` [Pa] (optional),
    ``pressure_2`` [Pa] (optional).

    Parameters of the result (position): ``viscous`` [N s/m], ``viscous_positive`` [N s/m],
    ``viscous_negative`` [N s/m], ``coulomb_positive`` [N], ``coulomb_negative`` [N], ``stribeck``
    [N], ``stribeck_speed`` [m/s].

    Roles (velocity-pressures): ``time`` [s] (optional), ``velocity`` [m/s], ``pressure`` [Pa],
    ``pressure_2`` [Pa] (optional).

    Parameters of the result (velocity-pressures): ``viscous`` [N s/m], ``viscous_positive`` [N
    s/m], ``viscous_negative`` [N s/m], ``coulomb_positive`` [N], ``coulomb_negative`` [N],
    ``stribeck`` [N], ``stribeck_speed`` [m/s].

    Roles (position-pressures): ``time`` [s], ``position`` [m], ``pressure`` [Pa], ``pressure_2``
    [Pa] (optional).

    Parameters of the result (position-pressures): ``viscous`` [N s/m], ``viscous_positive`` [N
    s/m], ``viscous_negative`` [N s/m], ``coulomb_positive`` [N], ``coulomb_negative`` [N],
    ``stribeck`` [N], ``stribeck_speed`` [m/s].

    Roles (angular_velocity): ``time`` [s] (optional), ``torque`` [N m], ``angular_velocity``
    [rad/s].

    Parameters of the result (angular_velocity): ``viscous`` [N m s/rad], ``viscous_positive`` [N m
    s/rad], ``viscous_negative`` [N m s/rad], ``coulomb_positive`` [N m], ``coulomb_negative`` [N
    m], ``stribeck`` [N m], ``stribeck_speed`` [rad/s].

    Roles (angle): ``time`` [s], ``torque`` [N m], ``angle`` [rad].

    Parameters of the result (angle): ``viscous`` [N m s/rad], ``viscous_positive`` [N m s/rad],
    ``viscous_negative`` [N m s/rad], ``coulomb_positive`` [N m], ``coulomb_negative`` [N m],
    ``stribeck`` [N m], ``stribeck_speed`` [rad/s].

    Parameters
    ----------
    logs
        Paths, DataFrames, mappings of header to array, or read logs.
    area
        Piston area that the pressure acts on: a number above 0 [m2].
    area_2
        Area that pressure_2 acts on: a number not below 0 [m2].
    pressures
        Beside a measured force: whether that moves the piston against the pressures, or they move
        it against the force of a load.
    mass
        Moving mass, to subtract inertia: a number not below 0 [kg].
    inertia
        Moment of inertia of what turns, to subtract it: a number not below 0 [kg m2].
    filter
        Half-width of the zero-phase velocity filter (default: from the noise): a number not below 0
        [s].
    deadband
        Samples slower than this are left out (default: from noise and speed): a number not below 0
        [m/s or rad/s].
    offset
        Constant offset of what drives: estimated where the levels need one, never, or always.
    stribeck
        Whether to estimate how friction rises at low speed.
    viscous
        One viscous value, or one per direction.
    hold, fixed, start, bounds, noise, validate, validate_window, controller_sample_time, strict
        As in :func:`.fit`.
    seed, progress
        As in :func:`.fit`.
    columns, units, scales, sample_time, window, exclude, exclude_rows, set, steps, unwrap
        How logs are read: as in :func:`.read_log` and :class:`.logs.Reading`.
    constants, from_name, invalid, decimal, thousands, delimiter, skip_rows, header_row
        How logs are read: as in :func:`.read_log` and :class:`.logs.Reading`.

    Returns
    -------
    FitResult

    Raises
    ------
    UsageError, LogError, NotIdentifiedError
        With what was found, where, and what to do.
    StrictError
        When there is a warning or a note under ``strict``.
    """
    return fit("cylinder-friction", **locals())


def fit_force_map(
    logs: Sequence[LogLike] | Iterator[LogLike] | LogLike, *,
    target: Literal["command", "force"] = "command", inputs: str | int | None = None,
    hidden: str | int | None = None, activation: Literal["relu", "tanh"] = "relu",
    dead_band: float | None = None, starts: int = 16, columns: Mapping[str, str] | None = None,
    units: Mapping[str, str] | None = None, scales: Mapping[str, float] | None = None,
    sample_time: float | None = None, window: tuple[float | None, float | None] | None = None,
    hold: Mapping[str, str] | None = None, fixed: Mapping[str, float | str] | None = None,
    start: Mapping[str, float | str] | None = None,
    bounds: Mapping[str, tuple[float | str, float | str]] | None = None,
    noise: Mapping[str, float | str] | None = None, validate: Sequence[LogLike] | LogLike = (),
    validate_window: tuple[float | None, float | None] | None = None,
    controller_sample_time: float | None = None, strict: bool = False, seed: int = 0,
    progress: Callable[[str], None] | None = None, exclude: Sequence[str] | str | None = None,
    exclude_rows: Sequence[str] | str | None = None,
    set: Mapping[str, str] | Sequence[str] | None = None,
    steps: Mapping[str, StepInput] | None = None, unwrap: Mapping[str, float | str] | None = None,
    constants: Mapping[str, str] | None = None, from_name: Mapping[str, str] | None = None,
    invalid: Invalid | None = None, decimal: str | None = None, thousands: str | None = None,
    delimiter: str | None = None, skip_rows: int | None = None, header_row: int | None = None,
) -> FitResult:
    """Force map: small networks of command and force with hysteresis.

    ::

        target = output_offset + output_scale * (weights_2 relu(weights_1 (inputs - input_offset) /
        input_scale + biases_1) + biases_2)

    Roles (command): ``time`` [s] (optional), ``command`` [V or Pa or A or 1], ``position`` [m or
    1], ``force`` [N], ``velocity`` [m/s or 1/s] (optional), ``direction`` [1] (optional),
    ``length`` [m] (optional).

    Parameters of the result (command): ``weights_1`` [1], ``biases_1`` [1], ``weights_2`` [1],
    ``biases_2`` [1], ``weights_3`` [1], ``biases_3`` [1], ``input_offset`` [1], ``input_scale``
    [1], ``output_offset`` [1], ``output_scale`` [1], ``input_low`` [1], ``input_high`` [1].

    Roles (force): ``time`` [s] (optional), ``command`` [V or Pa or A or 1], ``position`` [m or 1],
    ``force`` [N], ``velocity`` [m/s or 1/s] (optional), ``direction`` [1] (optional), ``length``
    [m] (optional).

    Parameters of the result (force): ``weights_1`` [1], ``biases_1`` [1], ``weights_2`` [1],
    ``biases_2`` [1], ``weights_3`` [1], ``biases_3`` [1], ``input_offset`` [1], ``input_scale``
    [1], ``output_offset`` [1], ``output_scale`` [1], ``input_low`` [1], ``input_high`` [1].

    Parameters
    ----------
    logs
        Paths, DataFrames, mappings of header to array, or read logs.
    target
        What the network predicts: the command for a wanted force, or the force.
    inputs
        Inputs in order, as force,position,direction (default: the paper's best).
    hidden
        Hidden units, as 5 or 16,16; auto adds units while validation gains (default: 5 for the
        command, 7 for the force).
    activation
        Of the hidden units.
    dead_band
        Change of the command that reverses the motion state, in its SI unit (default: from its
        noise): a number not below 0.
    starts
        Searches from different starts: a whole number not below 1.
    hold, fixed, start, bounds, noise, validate, validate_window, controller_sample_time, strict
        As in :func:`.fit`.
    seed, progress
        As in :func:`.fit`.
    columns, units, scales, sample_time, window, exclude, exclude_rows, set, steps, unwrap
        How logs are read: as in :func:`.read_log` and :class:`.logs.Reading`.
    constants, from_name, invalid, decimal, thousands, delimiter, skip_rows, header_row
        How logs are read: as in :func:`.read_log` and :class:`.logs.Reading`.

    Returns
    -------
    FitResult

    Raises
    ------
    UsageError, LogError, NotIdentifiedError
        With what was found, where, and what to do.
    StrictError
        When there is a warning or a note under ``strict``.
    """
    return fit("force-map", **locals())


def fit_spring_cylinder(
    logs: Sequence[LogLike] | Iterator[LogLike] | LogLike, *,
    levels: Literal["auto", "equal", "free"] = "auto",
    stribeck: Literal["none", "estimate"] = "none",
    motion_state: Literal["auto", "direction", "command", "position"] = "auto",
    dead_band: float | None = None, settle: float = 0.05, columns: Mapping[str, str] | None = None,
    units: Mapping[str, str] | None = None, scales: Mapping[str, float] | None = None,
    sample_time: float | None = None, window: tuple[float | None, float | None] | None = None,
    hold: Mapping[str, str] | None = None, fixed: Mapping[str, float | str] | None = None,
    start: Mapping[str, float | str] | None = None,
    bounds: Mapping[str, tuple[float | str, float | str]] | None = None,
    noise: Mapping[str, float | str] | None = None, validate: Sequence[LogLike] | LogLike = (),
    validate_window: tuple[float | None, float | None] | None = None,
    controller_sample_time: float | None = None, strict: bool = False, seed: int = 0,
    progress: Callable[[str], None] | None = None, exclude: Sequence[str] | str | None = None,
    exclude_rows: Sequence[str] | str | None = None,
    set: Mapping[str, str] | Sequence[str] | None = None,
    steps: Mapping[str, StepInput] | None = None, unwrap: Mapping[str, float | str] | None = None,
    constants: Mapping[str, str] | None = None, from_name: Mapping[str, str] | None = None,
    invalid: Invalid | None = None, decimal: str | None = None, thousands: str | None = None,
    delimiter: str | None = None, skip_rows: int | None = None, header_row: int | None = None,
) -> FitResult:
    """Single-acting cylinder: pressure gain, return spring and hysteresis.

    ::

        force = pressure_gain * command (or area * pressure) - stiffness * position - preload -
        coulomb_loading [loading] + coulomb_unloading [unloading] - viscous * velocity (- direction
        * stribeck * exp(-velocity^2 / stribeck_speed^2))

    Roles (command): ``time`` [s] (optional), ``command`` [V or A or 1], ``position`` [m], ``force``
    [N], ``velocity`` [m/s] (optional), ``direction`` [1] (optional).

    Parameters of the result (command): ``pressure_gain`` [N/V], ``stiffness`` [N/m], ``preload``
    [N], ``coulomb_loading`` [N], ``coulomb_unloading`` [N], ``viscous`` [N s/m], ``stribeck`` [N],
    ``stribeck_speed`` [m/s].

    Roles (pressure): ``time`` [s] (optional), ``pressure`` [Pa], ``position`` [m], ``force`` [N],
    ``velocity`` [m/s] (optional), ``direction`` [1] (optional).

    Parameters of the result (pressure): ``area`` [m2], ``stiffness`` [N/m], ``preload`` [N],
    ``coulomb_loading`` [N], ``coulomb_unloading`` [N], ``viscous`` [N s/m], ``stribeck`` [N],
    ``stribeck_speed`` [m/s].

    Parameters
    ----------
    logs
        Paths, DataFrames, mappings of header to array, or read logs.
    levels
        Friction levels: equal, free (needs --fix preload=...), or auto: free where a constant is
        fixed.
    stribeck
        Whether to estimate how friction rises at low speed.
    motion_state
        Source of the motion state (loading or unloading): a direction column, the command or
        pressure, or the position (where a test machine moves the rod); auto takes the column if
        there is one, and the position where command or pressure never change within a log.
    dead_band
        Change that reverses the motion state, in SI (default: from the noise): a number not below
        0.
    settle
        Share of the range of command or pressure (of the position, if that gives the motion state)
        that is left out after a reversal, while the seal still creeps: a number not below 0.
    hold, fixed, start, bounds, noise, validate, validate_window, controller_sample_time, strict
        As in :func:`.fit`.
    seed, progress
        As in :func:`.fit`.
    columns, units, scales, sample_time, window, exclude, exclude_rows, set, steps, unwrap
        How logs are read: as in :func:`.read_log` and :class:`.logs.Reading`.
    constants, from_name, invalid, decimal, thousands, delimiter, skip_rows, header_row
        How logs are read: as in :func:`.read_log` and :class:`.logs.Reading`.

    Returns
    -------
    FitResult

    Raises
    ------
    UsageError, LogError, NotIdentifiedError
        With what was found, where, and what to do.
    StrictError
        When there is a warning or a note under ``strict``.
    """
    return fit("spring-cylinder", **locals())


def fit_hydraulic_cylinder(
    logs: Sequence[LogLike] | Iterator[LogLike] | LogLike, *, area_1: float | str | None = None,
    area_2: float | str | None = None, dead_volume_1: float | str | None = None,
    dead_volume_2: float | str | None = None, mass: float | str | None = None,
    supply_pressure: float | str | None = None, tank_pressure: float | str = 0.0,
    flow: Literal["orifice", "mlp"] = "orifice", friction: Literal["coulomb", "mlp"] = "coulomb",
    stribeck: Literal["none", "estimate"] = "none", columns: Mapping[str, str] | None = None,
    units: Mapping[str, str] | None = None, scales: Mapping[str, float] | None = None,
    sample_time: float | None = None, window: tuple[float | None, float | None] | None = None,
    hold: Mapping[str, str] | None = None, fixed: Mapping[str, float | str] | None = None,
    start: Mapping[str, float | str] | None = None,
    bounds: Mapping[str, tuple[float | str, float | str]] | None = None,
    noise: Mapping[str, float | str] | None = None, validate: Sequence[LogLike] | LogLike = (),
    validate_window: tuple[float | None, float | None] | None = None,
    controller_sample_time: float | None = None, strict: bool = False, seed: int = 0,
    progress: Callable[[str], None] | None = None, exclude: Sequence[str] | str | None = None,
    exclude_rows: Sequence[str] | str | None = None,
    set: Mapping[str, str] | Sequence[str] | None = None,
    steps: Mapping[str, StepInput] | None = None, unwrap: Mapping[str, float | str] | None = None,
    constants: Mapping[str, str] | None = None, from_name: Mapping[str, str] | None = None,
    invalid: Invalid | None = None, decimal: str | None = None, thousands: str | None = None,
    delimiter: str | None = None, skip_rows: int | None = None, header_row: int | None = None,
) -> FitResult:
    """Hydraulic cylinder: valve gains, line losses, bulk modulus and friction.

    ::

        mass y'' = p1 area_1 - p2 area_2 - viscous y' - coulomb sgn(y') (- sgn(y') * stribeck *
        exp(-y'^2 / stribeck_speed^2)); p' = +-bulk_modulus / volume (Q - area y'); Q = valve_gain u
        sqrt(drop - line_loss |Q|)

    Roles: ``time`` [s], ``command`` [V], ``pressure_1`` [Pa] (optional), ``pressure_2`` [Pa]
    (optional), ``position`` [m].

    Parameters of the result: ``valve_gain_1`` [m3/(s V Pa^0.5)], ``valve_gain_2`` [m3/(s V
    Pa^0.5)], ``line_loss_1`` [Pa s/m3], ``line_loss_2`` [Pa s/m3], ``line_loss_3`` [Pa s/m3],
    ``line_loss_4`` [Pa s/m3], ``bulk_modulus`` [Pa], ``dead_zone_negative`` [V],
    ``dead_zone_positive`` [V], ``viscous`` [N s/m], ``coulomb`` [N], ``stribeck`` [N],
    ``stribeck_speed`` [m/s], ``flow_1_weights_1`` [1], ``flow_1_biases_1`` [1],
    ``flow_1_weights_2`` [1], ``flow_1_biases_2`` [1], ``flow_1_input_offset`` [1],
    ``flow_1_input_scale`` [1], ``flow_1_output_offset`` [1], ``flow_1_output_scale`` [1],
    ``flow_2_weights_1`` [1], ``flow_2_biases_1`` [1], ``flow_2_weights_2`` [1], ``flow_2_biases_2``
    [1], ``flow_2_input_offset`` [1], ``flow_2_input_scale`` [1], ``flow_2_output_offset`` [1],
    ``flow_2_output_scale`` [1], ``friction_weights_1`` [1], ``friction_biases_1`` [1],
    ``friction_weights_2`` [1], ``friction_biases_2`` [1], ``friction_input_offset`` [1],
    ``friction_input_scale`` [1], ``friction_output_offset`` [1], ``friction_output_scale`` [1].

    Parameters
    ----------
    logs
        Paths, DataFrames, mappings of header to array, or read logs.
    area_1
        Piston area of chamber 1: a number above 0 [m2].
    area_2
        Piston area of chamber 2, rod taken off: a number above 0 [m2].
    dead_volume_1
        Volume of chamber 1 and its line at position 0: a number above 0 [m3].
    dead_volume_2
        Volume of chamber 2 and its line at position 0: a number above 0 [m3].
    mass
        Moving mass: a number above 0 [kg].
    supply_pressure
        Supply pressure, on the scale of the sensors: a number above 0 [Pa].
    tank_pressure
        Tank pressure, on the scale of the sensors: a number [Pa].
    flow
        Orifice equations alone, or networks of the flow beside them.
    friction
        Coulomb and viscous friction alone, or a network of the speed beside them.
    stribeck
        Whether to estimate how friction rises at low speed.
    hold, fixed, start, bounds, noise, validate, validate_window, controller_sample_time, strict
        As in :func:`.fit`.
    seed, progress
        As in :func:`.fit`.
    columns, units, scales, sample_time, window, exclude, exclude_rows, set, steps, unwrap
        How logs are read: as in :func:`.read_log` and :class:`.logs.Reading`.
    constants, from_name, invalid, decimal, thousands, delimiter, skip_rows, header_row
        How logs are read: as in :func:`.read_log` and :class:`.logs.Reading`.

    Returns
    -------
    FitResult

    Raises
    ------
    UsageError, LogError, NotIdentifiedError
        With what was found, where, and what to do.
    StrictError
        When there is a warning or a note under ``strict``.
    """
    return fit("hydraulic-cylinder", **locals())


def fit_hydraulic_motor(
    logs: Sequence[LogLike] | Iterator[LogLike] | LogLike, *,
    start_state: Literal["rest", "free"] | None = None,
    offset: Literal["none", "free"] | None = None, mode: Literal["dynamic", "static"] = "dynamic",
    dead_zone: Literal["symmetric", "asymmetric"] = "symmetric",
    command_offset: Literal["none", "estimate"] = "none",
    dead_time: Literal["none", "estimate"] = "estimate", columns: Mapping[str, str] | None = None,
    units: Mapping[str, str] | None = None, scales: Mapping[str, float] | None = None,
    sample_time: float | None = None, window: tuple[float | None, float | None] | None = None,
    hold: Mapping[str, str] | None = None, fixed: Mapping[str, float | str] | None = None,
    start: Mapping[str, float | str] | None = None,
    bounds: Mapping[str, tuple[float | str, float | str]] | None = None,
    noise: Mapping[str, float | str] | None = None, validate: Sequence[LogLike] | LogLike = (),
    validate_window: tuple[float | None, float | None] | None = None,
    controller_sample_time: float | None = None, strict: bool = False, seed: int = 0,
    progress: Callable[[str], None] | None = None, exclude: Sequence[str] | str | None = None,
    exclude_rows: Sequence[str] | str | None = None,
    set: Mapping[str, str] | Sequence[str] | None = None,
    steps: Mapping[str, StepInput] | None = None, unwrap: Mapping[str, float | str] | None = None,
    constants: Mapping[str, str] | None = None, from_name: Mapping[str, str] | None = None,
    invalid: Invalid | None = None, decimal: str | None = None, thousands: str | None = None,
    delimiter: str | None = None, skip_rows: int | None = None, header_row: int | None = None,
) -> FitResult:
    """Hydraulic motor: dead zone, saturation, hysteresis and time constant.

    ::

        time_constant speed' + speed = sgn(w) gain / curvature (1 - exp(-curvature x)), x = min(|w|,
        saturation_command) - dead_zone, w = play(command(t - dead_time), hysteresis)

    Roles (hydraulic-motor): ``time`` [s], ``command`` [A or V or s or 1], ``speed`` [rad/s or V or
    m/s or m3/s or 1].

    Parameters of the result (hydraulic-motor): ``dead_zone`` [A], ``dead_zone_negative`` [A],
    ``dead_zone_positive`` [A], ``command_offset`` [A], ``gain`` [rad/s/A], ``curvature`` [1/A],
    ``saturation_command`` [A], ``hysteresis`` [A], ``time_constant`` [s], ``dead_time`` [s].

    Roles (angle): ``time`` [s], ``command`` [A or V or s or 1], ``angle`` [rad or 1].

    Parameters of the result (angle): ``dead_zone`` [A], ``dead_zone_negative`` [A],
    ``dead_zone_positive`` [A], ``command_offset`` [A], ``gain`` [rad/s/A], ``curvature`` [1/A],
    ``saturation_command`` [A], ``hysteresis`` [A], ``time_constant`` [s], ``dead_time`` [s].

    Roles (position): ``time`` [s], ``command`` [A or V or s or 1], ``position`` [m or V or 1].

    Parameters of the result (position): ``dead_zone`` [A], ``dead_zone_negative`` [A],
    ``dead_zone_positive`` [A], ``command_offset`` [A], ``gain`` [m/s/A], ``curvature`` [1/A],
    ``saturation_command`` [A], ``hysteresis`` [A], ``time_constant`` [s], ``dead_time`` [s].

    Roles (static): ``time`` [s] (optional), ``command`` [A or V or s or 1], ``speed`` [rad/s or V
    or m/s or m3/s or 1].

    Parameters of the result (static): ``dead_zone`` [A], ``dead_zone_negative`` [A],
    ``dead_zone_positive`` [A], ``command_offset`` [A], ``gain`` [rad/s/A], ``curvature`` [1/A],
    ``saturation_command`` [A], ``hysteresis`` [A].

    Parameters
    ----------
    logs
        Paths, DataFrames, mappings of header to array, or read logs.
    start_state
        Whether the runs begin at rest or in any state.
    offset
        Whether the output has an offset.
    mode
        Whether the rows are samples in time or settled points, in the order recorded.
    dead_zone
        One dead zone, or an edge for each direction.
    command_offset
        Whether to estimate the command at which the motor stands still (1500 us of a servo).
    dead_time
        Whether to estimate a dead time.
    hold, fixed, start, bounds, noise, validate, validate_window, controller_sample_time, strict
        As in :func:`.fit`.
    seed, progress
        As in :func:`.fit`.
    columns, units, scales, sample_time, window, exclude, exclude_rows, set, steps, unwrap
        How logs are read: as in :func:`.read_log` and :class:`.logs.Reading`.
    constants, from_name, invalid, decimal, thousands, delimiter, skip_rows, header_row
        How logs are read: as in :func:`.read_log` and :class:`.logs.Reading`.

    Returns
    -------
    FitResult

    Raises
    ------
    UsageError, LogError, NotIdentifiedError
        With what was found, where, and what to do.
    StrictError
        When there is a warning or a note under ``strict``.
    """
    return fit("hydraulic-motor", **locals())


def fit_flow_map(
    logs: Sequence[LogLike] | Iterator[LogLike] | LogLike, *,
    reference_pressure: float | str | None = None, columns: Mapping[str, str] | None = None,
    units: Mapping[str, str] | None = None, scales: Mapping[str, float] | None = None,
    sample_time: float | None = None, window: tuple[float | None, float | None] | None = None,
    hold: Mapping[str, str] | None = None, fixed: Mapping[str, float | str] | None = None,
    start: Mapping[str, float | str] | None = None,
    bounds: Mapping[str, tuple[float | str, float | str]] | None = None,
    noise: Mapping[str, float | str] | None = None, validate: Sequence[LogLike] | LogLike = (),
    validate_window: tuple[float | None, float | None] | None = None,
    controller_sample_time: float | None = None, strict: bool = False, seed: int = 0,
    progress: Callable[[str], None] | None = None, exclude: Sequence[str] | str | None = None,
    exclude_rows: Sequence[str] | str | None = None,
    set: Mapping[str, str] | Sequence[str] | None = None,
    steps: Mapping[str, StepInput] | None = None, unwrap: Mapping[str, float | str] | None = None,
    constants: Mapping[str, str] | None = None, from_name: Mapping[str, str] | None = None,
    invalid: Invalid | None = None, decimal: str | None = None, thousands: str | None = None,
    delimiter: str | None = None, skip_rows: int | None = None, header_row: int | None = None,
) -> FitResult:
    """Flow map: dead band, gains, leakage and saturation of a proportional valve.

    ::

        flow = q(command) sqrt(|pressure_drop| / reference_pressure) sign(pressure_drop), q = +-gain
        x (1 + curvature x) + leakage fade(x), x = opening beyond the dead band, up to saturation

    Roles: ``time`` [s] (optional), ``command`` [V or A or 1], ``pressure_drop`` [Pa] (optional),
    ``flow`` [m3/s or m/s or rad/s or V or 1].

    Parameters of the result: ``dead_band_negative`` [V], ``gain_negative`` [m3/s/V],
    ``saturation_negative`` [V], ``dead_band_positive`` [V], ``gain_positive`` [m3/s/V],
    ``saturation_positive`` [V], ``curvature`` [1/V], ``leakage`` [m3/s].

    Parameters
    ----------
    logs
        Paths, DataFrames, mappings of header to array, or read logs.
    reference_pressure
        Pressure drop at which the gains hold (default: the median of the log's): a number not below
        1e-09 [Pa].
    hold, fixed, start, bounds, noise, validate, validate_window, controller_sample_time, strict
        As in :func:`.fit`.
    seed, progress
        As in :func:`.fit`.
    columns, units, scales, sample_time, window, exclude, exclude_rows, set, steps, unwrap
        How logs are read: as in :func:`.read_log` and :class:`.logs.Reading`.
    constants, from_name, invalid, decimal, thousands, delimiter, skip_rows, header_row
        How logs are read: as in :func:`.read_log` and :class:`.logs.Reading`.

    Returns
    -------
    FitResult

    Raises
    ------
    UsageError, LogError, NotIdentifiedError
        With what was found, where, and what to do.
    StrictError
        When there is a warning or a note under ``strict``.
    """
    return fit("flow-map", **locals())


def fit_backlash(
    logs: Sequence[LogLike] | Iterator[LogLike] | LogLike, *,
    columns: Mapping[str, str] | None = None, units: Mapping[str, str] | None = None,
    scales: Mapping[str, float] | None = None, sample_time: float | None = None,
    window: tuple[float | None, float | None] | None = None, hold: Mapping[str, str] | None = None,
    fixed: Mapping[str, float | str] | None = None, start: Mapping[str, float | str] | None = None,
    bounds: Mapping[str, tuple[float | str, float | str]] | None = None,
    noise: Mapping[str, float | str] | None = None, validate: Sequence[LogLike] | LogLike = (),
    validate_window: tuple[float | None, float | None] | None = None,
    controller_sample_time: float | None = None, strict: bool = False, seed: int = 0,
    progress: Callable[[str], None] | None = None, exclude: Sequence[str] | str | None = None,
    exclude_rows: Sequence[str] | str | None = None,
    set: Mapping[str, str] | Sequence[str] | None = None,
    steps: Mapping[str, StepInput] | None = None, unwrap: Mapping[str, float | str] | None = None,
    constants: Mapping[str, str] | None = None, from_name: Mapping[str, str] | None = None,
    invalid: Invalid | None = None, decimal: str | None = None, thousands: str | None = None,
    delimiter: str | None = None, skip_rows: int | None = None, header_row: int | None = None,
) -> FitResult:
    """Backlash: play and lost motion between a drive and its load.

    ::

        load = path + offset, path = min(max(path before, ratio drive - play / 2), ratio drive +
        play / 2)

    Roles: ``time`` [s] (optional), ``drive`` [m or rad or 1 or V], ``load`` [m or rad or 1 or V].

    Parameters of the result: ``play`` [m], ``ratio`` [1], ``offset`` [m].

    Parameters
    ----------
    logs
        Paths, DataFrames, mappings of header to array, or read logs.
    hold, fixed, start, bounds, noise, validate, validate_window, controller_sample_time, strict
        As in :func:`.fit`.
    seed, progress
        As in :func:`.fit`.
    columns, units, scales, sample_time, window, exclude, exclude_rows, set, steps, unwrap
        How logs are read: as in :func:`.read_log` and :class:`.logs.Reading`.
    constants, from_name, invalid, decimal, thousands, delimiter, skip_rows, header_row
        How logs are read: as in :func:`.read_log` and :class:`.logs.Reading`.

    Returns
    -------
    FitResult

    Raises
    ------
    UsageError, LogError, NotIdentifiedError
        With what was found, where, and what to do.
    StrictError
        When there is a warning or a note under ``strict``.
    """
    return fit("backlash", **locals())
# [[[end]]]
# fmt: on
