/*
 * J v' = u - b v - F_k(sign v) while it moves; at rest while u stays between the static levels.
 * Break-away and stop are solved for an input that is held over each communication step: exact,
 * whatever the lengths of the steps.
 *
 * Follows drive_range.
 */
#include <math.h>

typedef struct {
    double inertia, viscous[2], coulomb[2], breakaway[2]; /* backward, forward */
} drive_law;

typedef struct {
    double position, velocity;
} drive_memory;

static double drive_clamped(double input, int *outside)
{
    *outside = !(input >= drive_range[0] && input <= drive_range[1]);
    if (!(input >= drive_range[0])) return drive_range[0];
    return input > drive_range[1] ? drive_range[1] : input;
}

/* (1 - exp(-x)) / x */
static double drive_first(double x)
{
    return x > 1e-8 ? -expm1(-x) / x : 1.0 - 0.5 * x;
}

/* (x - 1 + exp(-x)) / x^2, by its series where this would cancel */
static double drive_second(double x)
{
    double sum = 0.0;
    int k;

    if (x > 0.5) return (x + expm1(-x)) / (x * x);
    for (k = 16; k >= 2; k--) sum = (1.0 - x * sum) / k;
    return sum;
}

/* Time until a motion stops under a constant force: infinite when it never does. */
static double drive_time_to_stop(double v, double net, double viscous, double inertia)
{
    double x;

    if (v == 0.0 || v * net >= 0.0) return HUGE_VAL;
    x = -v * viscous / net;
    return -v * inertia / net * (x > 1e-8 ? log1p(x) / x : 1.0 - 0.5 * x);
}

/* Advance until the span ends or the motion stops; returns what is left of it. */
static double drive_move(drive_memory *m, const drive_law *law, double input, double span)
{
    const double v = m->velocity;
    const int forward = v != 0.0 ? v > 0.0 : input > law->breakaway[1];
    double net, stop, time, x, push;

    if (v == 0.0 && !forward && input >= -law->breakaway[0]) return 0.0;
    net = input - (forward ? law->coulomb[1] : -law->coulomb[0]);
    stop = drive_time_to_stop(v, net, law->viscous[forward], law->inertia);
    time = stop < span ? stop : span;
    x = law->viscous[forward] / law->inertia * time;
    push = net / law->inertia * time;
    m->position += v * time * drive_first(x) + push * time * drive_second(x);
    if (stop > span) {
        m->velocity = v * exp(-x) + push * drive_first(x);
        return 0.0;
    }
    m->velocity = 0.0;
    return span - stop;
}

static void drive_advance(drive_memory *m, const drive_law *law, double input, double span)
{
    int outside, part;
    const double drive = drive_clamped(input, &outside);

    /* A held input: moving, stopped, moving the other way. */
    for (part = 0; part < 4 && span > 0.0; part++) span = drive_move(m, law, drive, span);
}
