"""The page of the replay, from its runs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from fluidact_fit.control.loop import Response

from . import force, hydrostatic, pneumatic
from .table import HEAD


@dataclass(frozen=True)
class Runs:
    """Every run of the replay; the page and its pictures show the same ones."""

    hydrostatic: hydrostatic.Runs
    pneumatic: list[pneumatic.Insertion]
    force: Mapping[force.Key, Response]


def run() -> Runs:
    """Run everything."""
    return Runs(hydrostatic.run(), pneumatic.run(), force.run())


def _picture(name: str, shown: str, words: str) -> list[str]:
    """A picture with what it shows, and what else there is to say of it."""
    return [f"![{shown}](pictures/replay-{name}.svg)", "", f"{shown}. {words}", ""]


def page(runs: Runs) -> str:
    """The page as Markdown."""
    gains = hydrostatic.pd().gains
    drive = hydrostatic.DRIVE
    return "\n".join([
        "# The sources replayed", "",
        "Written by `studies/replay`. The closed loops of the sources, with the models that "
        "they identified, between events exact. Nothing is tuned to the figures in the middle "
        "column: where a source does not give a number, it follows from a rule stated here.", "",
        "## Hydrostatic rig of the thesis", "",
        f"Mass {drive.mass:.0f} kg: the screw's 11.71 g cm2 stand for "
        f"{drive.mass - 53.7:.0f} kg at the rod. Rules: K_p = {gains.proportional:.2f} N m/m, "
        "the mean static level over the 0.6 mm in the middle of the breaking distances of the "
        f"uncompensated sine; K_d = {gains.derivative:.3f} N m s/m, for a damping ratio of "
        f"{hydrostatic.RATIO:g} by equation 16. Velocity tolerance 1 mm/s; friction compensated "
        "with its true levels; sine of 4 mm at 0.2 Hz; tissue of 1000 N/m, 50 N/m after the "
        "puncture.", "",
        *HEAD, *hydrostatic.rows(runs.hydrostatic), "",
        *_picture("step", "Step of 0.5 mm", "Ours at two velocity tolerances; the dashed line is "
                  "the peak that the thesis tells of, the dotted one where it came to rest."),
        *_picture("triangle", "Triangle of 5 mm/s", "In grey the error of the thesis."),
        *_picture("sine", "Slow sine without and with friction compensation", "The plateaus of the "
                  "uncompensated one vanish; in grey the distances at which the thesis saw the rod "
                  "break away."),
        *_picture("insertion", "Ramp insertion and a puncture at 5 N", "Above the error of the "
                  "ramp, below the position where the hand jolts."),
        "The breaking distance is no independent result, K_p comes from it: what is left of 0.6 mm "
        "is the lower of both levels and the rate of the sine. The triangle is one: its error is "
        "the kinetic friction that the thesis leaves uncompensated, over K_p. The step and the "
        "jolt overshoot less than the rig's. What makes them overshoot is the compensation: below "
        "the velocity tolerance it adds the static level to a motion that only the lower kinetic "
        "one resists. The thesis does not give its tolerance, which had to cover the noise of a "
        "potentiometer and the ringing of the filter (one count of 10 bits over 60 mm is 5.9 mm/s "
        "before it); at 10 mm/s the step goes half of the way to its 0.3 mm. Levels that vary "
        "with place, the plastic clamp and the air in the water, which it blames for the shaking, "
        "are in no model. The puncture moves the rod hardly, as in the thesis: 5 N are 0.28 mN m "
        "against 2 mN m of friction.",
        "", "## Pneumatic rig of the thesis", "",
        "Equations 20 and 21 have lost their numbers, and so have areas and damping. Rules: valve "
        "and line as in the synthetic datasets (20 rad/s, 0.12 s, dead time 14.7 ms), bore of "
        "20 mm by the volume of the chamber, rod of 8 mm, gas of line and half a chamber, "
        "critical damping, viscous friction compensated, pressures from 1 to 10 bar.", "",
        *HEAD, *pneumatic.rows(runs.pneumatic), "",
        *_picture("pneumatic", "Ramp insertion at three settings", "The tissue begins at 20 mm."),
        "As in the source, less pressure gives more overshoot, and a softer impedance none and a "
        "poor tracking. The pressures matter through the gas alone: pressed by the rod it is a "
        "spring, and half as stiff at 4 bar, where the linear loop is not stable any more (gain "
        "margin below 1): the friction of the cylinder holds it until the puncture, but not "
        "after, which the thesis does not tell of its rig. It gives no volume either: with half "
        "of the 32 ml supposed here both loops are stable, and overshoots and jumps near the "
        "source's. That shows what the rig may have been, not more: the amounts are those of "
        "invented time constants and areas and prove nothing. The lag has 5 N over k in it, "
        "1.25 mm and 5 mm, 2.4 N over k of friction that is not compensated, and the delay of the "
        "pressures; the source's 1.5 mm leaves room for the first only: with the Coulomb friction "
        "compensated as well the lag comes near it, at the price of a larger overshoot. The jump "
        "at the puncture is that overshoot and the lag that ends.",
        "", "## Force steps of the pneumatic paper", "",
        "Rules: valve of second order with a damping ratio of 0.7 and the rise time of 0.03 s; "
        "spring, gain and friction as in the synthetic dataset; rod held at 23.2 mm.", "",
        *HEAD, *force.rows(runs.force), "",
        "All steps, smoothed by the straight line (`held`); the paper has pictures of them and no "
        "numbers but those above:", "",
        "| step | n_s | overshoot | steady error | rise time | settling time |",
        "|---|---|---|---|---|---|", *force.smoothed(runs.force), "",
        *_picture("force", "Steps of 10, 30 and 50 N with n_s = 1, 10 and 30", "Dashed where those "
                  "of the paper came to rest with n_s = 1."),
        "The steady error is the overshoot of the pressure, which the friction of the seal keeps: "
        "the force cannot follow the pressure down until it has fallen by both levels together. "
        "It is proportional to the step, as in the source, and its amount is that of the damping "
        "ratio: the source's 4.3 to 5.6 % of the step belong to ratios of 0.71 to 0.68, the round "
        "0.7 gives 4.6 %. Smoothing takes the overshoot away and the error with it. The straight "
        "line (`held`) does so by what the paper says, without another number to choose; the "
        "recursion as printed would leave next to nothing and settle sooner than measured. The "
        "paper does not define its settling time. It cannot be that to 2 % of the target, since it "
        "gives 0.07 s for a step that rests 4.3 % beyond; to 95 % a ramp of 0.30 s takes "
        "0.285 s.", "",
    ])  # fmt: skip
