"""The page of the replay, from its runs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from fluidact_fit.control.loop import LoopResponse

from . import force, hydrostatic, pneumatic
from .table import HEAD


@dataclass(frozen=True)
class Runs:
    """Every run of the replay; the page and its pictures show the same ones."""

    hydrostatic: hydrostatic.Runs
    pneumatic: list[pneumatic.Insertion]
    force: Mapping[force.Key, LoopResponse]


def run() -> Runs:
    """Run everything."""
    return Runs(hydrostatic.run(), pneumatic.run(), force.run())


def _picture(name: str, shown: str, words: str) -> list[str]:
    """A picture with what it shows, and what else there is to say of it."""
    return [f"![{shown}](pictures/replay-{name}.svg)", "", f"{shown}. {words}", ""]


def page(runs: Runs) -> str:
    """The page as Markdown."""
    gains = hydrostatic.pd().gains
    drive, limit = hydrostatic.DRIVE, hydrostatic.onset()
    return "\n".join([
        "# The sources replayed", "",
        "Written by `studies/replay`. The closed loops of the sources, with the models that "
        "they identified, between events exact. Where a source does not give a number, it follows "
        "from a rule stated here. Two rules take a figure that the source measured on the loop: "
        "K_p of the hydrostatic rig the breaking distance, and the valve of the pneumatic paper "
        "the rise time. The last column says of every line whether it can tell for or against the "
        "model: yes where no figure of the source had part in it, no where one had, or where "
        "something was changed to see its effect.", "",
        "## Hydrostatic rig of the thesis", "",
        f"Mass {drive.mass:.0f} kg: the screw's 11.71 g cm2 stand for "
        f"{drive.mass - 53.7:.0f} kg at the rod. Rules: K_p = {gains.proportional:.2f} N m/m, "
        "the mean static level over the 0.6 mm in the middle of the breaking distances of the "
        f"uncompensated sine; K_d = {gains.derivative:.3f} N m s/m, for a damping ratio of "
        f"{hydrostatic.RATIO:g} by equation 16. Velocity tolerance 1 mm/s; friction compensated "
        "with its true levels; sine of 4 mm at 0.2 Hz; tissue of 1000 N/m, 50 N/m after the "
        "puncture.", "",
        *HEAD, *hydrostatic.rows(runs.hydrostatic), "",
        *_picture("step", "Step of 0.5 mm", "Ours at two velocity tolerances, and with gains "
        "found "
                  "as the thesis found its own; the dashed line is the peak that the thesis "
                  "tells of, the dotted one where it came to rest."),
        *_picture("triangle", "Triangle of 5 mm/s", "In grey the error of the thesis."),
        *_picture("sine", "Slow sine without and with friction compensation", "The plateaus of "
        "the "
                  "uncompensated one vanish; in grey the distances at which the thesis saw the "
                  "rod "
                  "break away."),
        *_picture("insertion", "Ramp insertion and a puncture at 5 N", "Above the error of the "
                  "ramp, below the position where the hand jolts."),
        "The thesis found its gains on the rig: it raised K_p until the loop began to oscillate, "
        "added K_d until stability returned, and only then tuned the compensation. By that "
        f"procedure the model has K_p = {limit.proportional:.1f} N m/m and K_d = "
        f"{limit.derivative:.2f} N m s/m (gain margin largest), and overshoots as the rig did, "
        "without compensation nearly as far: it is the gain at the limit of stability that "
        "overshoots, not the friction that is added. With K_p from the breaking distance the "
        "model is far from that limit (gain margin 3.5) and hardly overshoots. Both figures of "
        "the "
        "rig together, its breaking distance and its oscillation at that K_p, are not in the "
        "model: something that it lacks makes the rig oscillate at about a fifth of the gain. The "
        "thesis blames the plastic clamp and the air in the water for its shaking; levels that "
        "vary with place are in no model either. A larger velocity tolerance makes the step "
        "overshoot as well, but goes half of the way. The error of the triangle is the kinetic "
        "friction "
        "that the thesis leaves uncompensated, over K_p. The puncture moves the "
        "rod hardly, as in the thesis: 5 N are 0.28 mN m against 2 mN m of friction. After the "
        "jolt the rig overshot as after its step, and the model does as little as there.",
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
        *_picture("force", "Steps of 10, 30 and 50 N with n_s = 1, 10 and 30", "Dashed where "
        "those "
                  "of the paper came to rest with n_s = 1."),
        "The steady error is the overshoot of the pressure, which the friction of the seal keeps: "
        "the force cannot follow the pressure down until it has fallen by both levels together. "
        "Here it is 4.6 % of every step, because the model of the valve is linear, and it depends "
        "on the damping ratio alone, not on the rise time. The source's is no fixed share: 5.6 % "
        "of 10 N, 5.2 % of 30 N and 4.3 % of 50 N, as of damping ratios from 0.68 to 0.71, so "
        "that "
        "its error grows less than the step does. No linear valve shows that. Smoothing takes "
        "the overshoot "
        "away and the error with it. The straight line (`held`) does so by what the paper says, "
        "without another number to choose; the "
        "recursion as printed would leave next to nothing and settle sooner than measured. The "
        "paper does not define its settling time. It cannot be that to 2 % of the target, since "
        "it "
        "gives 0.07 s for a step that rests 4.3 % beyond; to 95 % a ramp of 0.30 s takes "
        "0.285 s.", "",
    ])  # fmt: skip
