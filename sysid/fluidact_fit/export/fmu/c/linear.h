/*
 * x' = A x + B w(t - dead time), y = C x, for an input that is held over each communication step:
 * solved exactly, whatever the lengths of the steps.
 *
 * Follows LINEAR_ORDER, linear_a, linear_b, linear_c and linear_range; linear_edges where a dead
 * zone stands before the model; LINEAR_QUEUE (changes that can be on their way) and
 * linear_dead_time where there is a dead time.
 */
#include <math.h>

typedef struct {
    double e[LINEAR_ORDER][LINEAR_ORDER];
} linear_matrix;

typedef struct {
    double x[LINEAR_ORDER];
    double acting; /* what acts now, about the level of rest */
    double level;  /* what acts at rest */
    double rest;   /* output there */
#ifdef LINEAR_QUEUE
    double newest; /* what entered the dead time last */
    double due[LINEAR_QUEUE];
    double value[LINEAR_QUEUE];
    int first, count;
#endif
} linear_memory;

static double linear_clamped(double input, int *outside)
{
    if (outside) *outside = !(input >= linear_range[0] && input <= linear_range[1]);
    if (!(input >= linear_range[0])) return linear_range[0];
    return input > linear_range[1] ? linear_range[1] : input;
}

#ifdef LINEAR_EDGES
/* What is left of an input behind the dead zone. */
static double linear_behind(double input)
{
    if (input > linear_edges[1]) return input - linear_edges[1];
    return input < linear_edges[0] ? input - linear_edges[0] : 0.0;
}
#endif

/* unit + factor A j */
static linear_matrix linear_product(double unit, double factor, const linear_matrix *j)
{
    linear_matrix result;
    int row, column, k;

    for (row = 0; row < LINEAR_ORDER; row++) {
        for (column = 0; column < LINEAR_ORDER; column++) {
            double sum = 0.0;
            for (k = 0; k < LINEAR_ORDER; k++) sum += linear_a[row][k] * j->e[k][column];
            result.e[row][column] = factor * sum + (row == column ? unit : 0.0);
        }
    }
    return result;
}

/* Integral of exp(A s) from 0 to span: a series on a part of it, then J(2h) = J(h) (2 + A J(h)). */
static linear_matrix linear_integral(double span)
{
    linear_matrix j, more, sum;
    double norm = 0.0, h = span;
    int row, column, k, term, halvings = 0;

    for (row = 0; row < LINEAR_ORDER; row++) {
        double size = 0.0;
        for (column = 0; column < LINEAR_ORDER; column++) size += fabs(linear_a[row][column]);
        norm = size > norm ? size : norm;
    }
    for (; norm * h > 0.5; halvings++) h *= 0.5;
    for (row = 0; row < LINEAR_ORDER; row++) {
        for (column = 0; column < LINEAR_ORDER; column++) j.e[row][column] = row == column;
    }
    for (term = 15; term > 1; term--) j = linear_product(1.0, h / term, &j);
    for (row = 0; row < LINEAR_ORDER; row++) {
        for (column = 0; column < LINEAR_ORDER; column++) j.e[row][column] *= h;
    }
    for (; halvings > 0; halvings--) {
        more = linear_product(2.0, 1.0, &j);
        for (row = 0; row < LINEAR_ORDER; row++) {
            for (column = 0; column < LINEAR_ORDER; column++) {
                sum.e[row][column] = 0.0;
                for (k = 0; k < LINEAR_ORDER; k++) {
                    sum.e[row][column] += j.e[row][k] * more.e[k][column];
                }
            }
        }
        j = sum;
    }
    return j;
}

/* x(t + span) = x + J(span) (A x + B w) */
static void linear_move(linear_memory *m, double span)
{
    linear_matrix j;
    double rate[LINEAR_ORDER];
    int row, k;

    if (!(span > 0.0)) return;
    j = linear_integral(span);
    for (row = 0; row < LINEAR_ORDER; row++) {
        rate[row] = linear_b[row] * m->acting;
        for (k = 0; k < LINEAR_ORDER; k++) rate[row] += linear_a[row][k] * m->x[k];
    }
    for (row = 0; row < LINEAR_ORDER; row++) {
        for (k = 0; k < LINEAR_ORDER; k++) m->x[row] += j.e[row][k] * rate[k];
    }
}

/* At rest: what acts there, and the output. */
static void linear_begin(linear_memory *m, double level, double rest)
{
    int k;

    for (k = 0; k < LINEAR_ORDER; k++) m->x[k] = 0.0;
    m->acting = 0.0;
    m->level = level;
    m->rest = rest;
#ifdef LINEAR_QUEUE
    m->newest = 0.0;
    m->first = m->count = 0;
#endif
}

static double linear_output(const linear_memory *m)
{
    double sum = m->rest;
    int k;

    for (k = 0; k < LINEAR_ORDER; k++) sum += linear_c[k] * m->x[k];
    return sum;
}

/* Let it act for a span; returns what went wrong, before anything has changed, or NULL. */
static const char *linear_advance(linear_memory *m, double acting, double time, double span)
{
    const double drive = acting - m->level;
#ifdef LINEAR_QUEUE
    const double end = time + span;
    double now = time;

    if (!(drive == m->newest)) {
        const int last = (m->first + m->count) % LINEAR_QUEUE;
        if (m->count == LINEAR_QUEUE) {
            return "the dead time holds more changes of the input than fit: take longer steps";
        }
        m->due[last] = time + linear_dead_time;
        m->value[last] = m->newest = drive;
        m->count++;
    }
    while (m->count > 0 && m->due[m->first] < end) {
        const double due = m->due[m->first];
        linear_move(m, due - now);
        now = due > now ? due : now;
        m->acting = m->value[m->first];
        m->first = (m->first + 1) % LINEAR_QUEUE;
        m->count--;
    }
    linear_move(m, end - now);
#else
    (void)time;
    m->acting = drive;
    linear_move(m, span);
#endif
    return NULL;
}
