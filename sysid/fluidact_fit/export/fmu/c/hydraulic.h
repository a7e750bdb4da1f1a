/*
 * p1' = beta (Q1 - A1 v) / (V1 + A1 y),  p2' = beta (A2 v - Q2) / (V2 - A2 y),
 * M v' = p1 A1 - p2 A2 - b v - sign v (F_k + F_r exp(-(v / v_r)^2)) while it moves; at rest between
 * the static levels. A Runge-Kutta scheme of fourth order; the instants of stops and break-aways are
 * solved for, and another step begins there.
 *
 * Follows hydraulic_range, _area, _volume, _mass, _bulk_modulus, _rate (steps per second), _rest,
 * _viscous, _coulomb, _breakaway and _rise (backward, forward), _rise_speed, and the macros
 * HYDRAULIC_FLOW_1 and HYDRAULIC_FLOW_2.
 */
#include <math.h>
#include <string.h>

#define HYDRAULIC_EVENTS 8      /* within a step; a piston that rattles faster rests */
#define HYDRAULIC_BISECTIONS 50
#define HYDRAULIC_STEPS 1e7     /* within a communication step */

enum { HYDRAULIC_P1, HYDRAULIC_P2, HYDRAULIC_Y, HYDRAULIC_V, HYDRAULIC_ORDER };

typedef struct {
    double x[HYDRAULIC_ORDER];
    int way;
} hydraulic_memory;

static double hydraulic_clamped(double input, int *outside)
{
    *outside = !(input >= hydraulic_range[0] && input <= hydraulic_range[1]);
    if (!(input >= hydraulic_range[0])) return hydraulic_range[0];
    return input > hydraulic_range[1] ? hydraulic_range[1] : input;
}

static double hydraulic_push(const double *x)
{
    return x[HYDRAULIC_P1] * hydraulic_area[0] - x[HYDRAULIC_P2] * hydraulic_area[1];
}

/* Which way a piston at rest is pushed beyond its static friction; 0: it rests. */
static int hydraulic_leaving(const double *x)
{
    const double push = hydraulic_push(x);

    return push > hydraulic_breakaway[1] ? 1 : push < -hydraulic_breakaway[0] ? -1 : 0;
}

static void hydraulic_rates(const double *x, double u, int way, double *rate)
{
    const double v = x[HYDRAULIC_V], y = x[HYDRAULIC_Y];
    const double in = HYDRAULIC_FLOW_1(u, x[HYDRAULIC_P1]) - hydraulic_area[0] * v;
    const double out = hydraulic_area[1] * v - HYDRAULIC_FLOW_2(u, x[HYDRAULIC_P2]);
    const int forward = way > 0;

    rate[HYDRAULIC_P1] = hydraulic_bulk_modulus * in / (hydraulic_volume[0] + hydraulic_area[0] * y);
    rate[HYDRAULIC_P2] = hydraulic_bulk_modulus * out / (hydraulic_volume[1] - hydraulic_area[1] * y);
    rate[HYDRAULIC_Y] = v;
    rate[HYDRAULIC_V] = 0.0;
    if (way) {
        const double share = v / hydraulic_rise_speed;
        const double dry = hydraulic_coulomb[forward] + hydraulic_rise[forward] * exp(-share * share);
        const double friction = way * dry + hydraulic_viscous[forward] * v;
        rate[HYDRAULIC_V] = (hydraulic_push(x) - friction) / hydraulic_mass;
    }
}

/* One step of the classical Runge-Kutta scheme in one mode of motion. */
static void hydraulic_integrate(const double *x, double u, double span, int way, double *end)
{
    double k[4][HYDRAULIC_ORDER], at[HYDRAULIC_ORDER];
    int stage, j;

    hydraulic_rates(x, u, way, k[0]);
    for (stage = 1; stage < 4; stage++) {
        const double share = stage < 3 ? 0.5 * span : span;
        for (j = 0; j < HYDRAULIC_ORDER; j++) at[j] = x[j] + share * k[stage - 1][j];
        hydraulic_rates(at, u, way, k[stage]);
    }
    for (j = 0; j < HYDRAULIC_ORDER; j++)
        end[j] = x[j] + span / 6.0 * (k[0][j] + 2.0 * k[1][j] + 2.0 * k[2][j] + k[3][j]);
}

/* Whether an event lies behind: a break-away, or a stop. */
static int hydraulic_over(const double *x, int way)
{
    return way ? x[HYDRAULIC_V] * way < 0.0 : hydraulic_leaving(x) != 0;
}

/* Advance until the span ends or an event comes; returns what is left of it. */
static double hydraulic_follow(hydraulic_memory *m, double u, double span)
{
    double end[HYDRAULIC_ORDER], low = 0.0, high = span;
    int way, k;

    if (m->way == 0) m->way = hydraulic_leaving(m->x);
    way = m->way;
    hydraulic_integrate(m->x, u, span, way, end);
    if (hydraulic_over(end, way)) {
        for (k = 0; k < HYDRAULIC_BISECTIONS; k++) {
            const double middle = 0.5 * (low + high);
            hydraulic_integrate(m->x, u, middle, way, end);
            if (hydraulic_over(end, way)) high = middle;
            else low = middle;
        }
        hydraulic_integrate(m->x, u, high, way, end);
        if (way) end[HYDRAULIC_V] = 0.0;
        m->way = hydraulic_leaving(end);
    }
    memcpy(m->x, end, sizeof end);
    return span - high;
}

static void hydraulic_begin(hydraulic_memory *m, double position)
{
    m->x[HYDRAULIC_P1] = hydraulic_rest[0];
    m->x[HYDRAULIC_P2] = hydraulic_rest[1];
    m->x[HYDRAULIC_Y] = position;
    m->x[HYDRAULIC_V] = 0.0;
    m->way = 0;
}

/* Hold an input for a span; returns what went wrong, before anything has changed, or NULL. */
static const char *hydraulic_advance(hydraulic_memory *m, double input, double span)
{
    int outside, event;
    hydraulic_memory next = *m;
    const double u = hydraulic_clamped(input, &outside);
    const double steps = ceil(hydraulic_rate * span);
    double k, end[HYDRAULIC_ORDER];

    if (!(steps <= HYDRAULIC_STEPS)) return "the step is too long for the oil: take shorter ones";
    for (k = 0.0; k < steps; k += 1.0) {
        double rest = span / steps;
        for (event = 0; event < HYDRAULIC_EVENTS && rest > 0.0; event++)
            rest = hydraulic_follow(&next, u, rest);
        if (rest > 0.0) {
            next.way = 0;
            next.x[HYDRAULIC_V] = 0.0;
            hydraulic_integrate(next.x, u, rest, 0, end);
            memcpy(next.x, end, sizeof end);
        }
    }
    if (!(hydraulic_volume[0] + hydraulic_area[0] * next.x[HYDRAULIC_Y] > 0.0)
        || !(hydraulic_volume[1] - hydraulic_area[1] * next.x[HYDRAULIC_Y] > 0.0))
        return "the piston is beyond where a chamber holds oil, and the file knows no end stops";
    *m = next;
    return NULL;
}
