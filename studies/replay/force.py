"""Force steps of the pneumatic paper: a single-acting cylinder with its rod held."""

from __future__ import annotations

from collections.abc import Mapping

from fluidact_fit.block import Port
from fluidact_fit.control.controllers import FeedforwardForceController, Smoothing
from fluidact_fit.control.controllers.force import Reading
from fluidact_fit.control.loop import LoopResponse, run_loop
from fluidact_fit.control.metrics import StepMetrics, step_metrics
from fluidact_fit.control.plants.force import ForcePlant
from fluidact_fit.control.plants.linear import Chain, make_chain
from fluidact_fit.control.references import Reference
from fluidact_fit.routines import Argument, Draft

from .table import STEP, row, second_order

AT = 0.1  # [s], of the steps
SOURCE = {10.0: 0.56, 30.0: 1.56, 50.0: 2.14}  # size to steady error of the paper, n_s = 1 [N]
STEPS = (1, 10, 30)  # n_s of the paper
Key = tuple[float, int, Reading]  # size [N], n_s, reading of equation 8
READINGS: tuple[Reading, ...] = ("held", "recursive")
KEYS: tuple[Key, ...] = (
    *((size, steps, "held") for size in SOURCE for steps in STEPS),
    (50.0, 30, "recursive"),
)


def force_step(size: float, steps: int, reading: Reading = "held") -> LoopResponse:
    """A step of the force of the paper's cylinder at 23.2 mm."""
    place, gain, spring, preload, level = 23.2e-3, 18.09, 300.0, 5.0, 2.4
    rest = spring * place + preload
    supply: Chain = make_chain([second_order(2.13 / 0.03, 0.7)])
    plant = ForcePlant(
        lambda u: (gain * u - rest - level, gain * u - rest + level),
        supply, Port("command", "V"), STEP, position=place,
    )  # fmt: skip
    draft = Draft("command_for", "Command for a force.", "V")
    force, at, state = (
        draft.argument(Argument(name, unit, "of the rod", -1e3, 1e3))
        for name, unit in (("force", "N"), ("position", "m"), ("direction", "1"))
    )
    command_for = draft.returns((force + spring * at + preload + level * state) * (1.0 / gain))
    controller = FeedforwardForceController(
        command_for, Argument("target", "V", "for the force", -1e3, 1e3), STEP,
        Smoothing(steps, reading),
    )  # fmt: skip
    return run_loop(plant, controller, Reference("step", size=size, at=AT), 1.0, 0.0)


def metrics(r: LoopResponse) -> StepMetrics:
    """Metrics of a step of the force."""
    return step_metrics(r.time, r.output, float(r.reference[-1]), at=AT)


def run() -> dict[Key, LoopResponse]:
    """Every step of the page."""
    return {key: force_step(*key) for key in KEYS}


def rows(runs: Mapping[Key, LoopResponse]) -> list[str]:
    """Steps against the paper."""
    found = []
    for size, source in SOURCE.items():
        m = metrics(runs[size, 1, "held"])
        found.append(row(f"{size:g} N, n_s = 1: steady error", f"{source:g} N",
                         f"{abs(m.steady_state_error):.2f} N",
                         "yes, of the round damping ratio"))  # fmt: skip
        found.append(row(f"{size:g} N, n_s = 1: rise time", "about 0.03 s",
                         f"{m.rise_time:.3f} s", "no: the valve comes from it"))  # fmt: skip
    plain = metrics(runs[50.0, 1, "held"])
    found.append(row("50 N, n_s = 1: settling time (2 % of the target)", "0.07 s", _settled(plain),
                     "yes, but the paper does not say to what"))  # fmt: skip
    for reading in READINGS:
        smooth = metrics(runs[50.0, 30, reading])
        over = 100.0 * (smooth.overshoot_target / plain.overshoot_target - 1.0)
        error = 100.0 * (abs(smooth.steady_state_error / plain.steady_state_error) - 1.0)
        name = f"50 N, n_s 1 to 30, {reading}"
        test = "of this reading of equation 8 against the other"
        found += [
            row(f"{name}: overshoot", "-88.1 %", f"{over:.1f} %", test),
            row(f"{name}: steady error", "-80.3 %", f"{error:.1f} %", test),
            row(
                f"{name}: settling time (2 % of the target)", "about 0.25 s", _settled(smooth), test
            ),
        ]
    return found


def smoothed(runs: Mapping[Key, LoopResponse]) -> list[str]:
    """Every step with every smoothing, of which the paper prints figures only."""
    found = []
    for size in SOURCE:
        for steps in STEPS:
            m = metrics(runs[size, steps, "held"])
            cells = (
                f"{size:g} N", steps, f"{m.overshoot_target:.1f} %",
                f"{abs(m.steady_state_error):.2f} N", f"{m.rise_time:.3f} s", _settled(m),
            )  # fmt: skip
            found.append("| " + " | ".join(map(str, cells)) + " |")
    return found


def _settled(m: StepMetrics) -> str:
    return "never" if m.settling_time is None else f"{m.settling_time:.2f} s"
