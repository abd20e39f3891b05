/* Derivatives of the motion along k directions: columns S of the model's states, stored row by row
   after x, by the variational equations and their jumps at events. See simulation/variation.py. */
#include "run.h"

/* Distance, in nominal sizes, at which limits of slopes are estimated. */
static const double NEARBY = 1e-10;

static const double *directions(const Run *run) { return run->out.p + run->in.n_p; }

static inline void multiply_by(const Entries *entries, const double *values, const double *from, double *to,
                     long long k) {
    for (long long e = 0; e < entries->count; e++) {
        const double value = values[e], *restrict a = from + k * entries->columns[e];
        double *restrict b = to + k * entries->rows[e];
        for (long long c = 0; c < k; c++) b[c] += value * a[c];
    }
}

/* Add to the rows of `to` those of `from` by the entries of a Jacobian. Short rows are unrolled. */
static void multiply(const Entries *entries, const double *values, const double *from, double *to,
                     long long k) {
    switch (k) {
    case 1: multiply_by(entries, values, from, to, 1); break;
    case 2: multiply_by(entries, values, from, to, 2); break;
    case 3: multiply_by(entries, values, from, to, 3); break;
    case 4: multiply_by(entries, values, from, to, 4); break;
    default: multiply_by(entries, values, from, to, k);
    }
}

enum { GLANCES = 4 };

/* Slopes at a distance from x, in units of `way`, and after a time. */
static void look_nearby(Run *run, int glance, double t, const double *x, const double *way,
                        double distance, double after) {
    const long long in_x = run->in.in_x.count, count = in_x + run->in.in_p.count;
    double *y = run->column, *nearby = run->nearby + glance * count;
    for (long long m = 0; m < run->in.n_x; m++) y[m] = x[m] + distance * way[m];
    run->res[1] = nearby, run->res[2] = nearby + in_x;
    evaluate(run, run->in.slopes, t + after, y, run->slope);
}

/* Whether two values, one at a distance and one four times as close, have a common limit. */
static int converge(double a, double b, double near_a, double near_b) {
    const double apart = fabs(a - b), near = fabs(near_a - near_b);
    const double size = larger(fabs(near_a), fabs(near_b));
    return size < INFINITY && size <= 1.5 * larger(fabs(a), fabs(b))
           && near <= larger(0.6 * apart, 1e-4 * size);
}

/* Replace slopes that are NaN by those nearby. Points a and b are apart, c and d four times as
   close. */
static void adopt(Run *run, int a, int b, int c, int d) {
    const long long in_x = run->in.in_x.count, count = in_x + run->in.in_p.count;
    for (long long e = 0; e < count; e++) {
        double *slope = e < in_x ? run->slopes_x + e : run->slopes_p + (e - in_x);
        const double *near = run->nearby + e;
        if (!isnan(*slope)) continue;
        if (converge(near[a * count], near[b * count], near[c * count], near[d * count]))
            *slope = 0.5 * (near[c * count] + near[d * count]);
    }
}

/* Slopes may be 0/0 where the motion is smooth, such as those of v |v| at rest. Use their limit
   along the motion, or from both sides if nothing moves. */
static void take_limits(Run *run, double t, const double *x, const double *dx) {
    double most = 0.0, *way = run->column_x;
    for (long long m = 0; m < run->in.n_model; m++) {
        if (!isfinite(dx[m])) return;
        most = larger(most, fabs(dx[m]) / (run->in.absolute[m] / run->in.unit));
    }
    if (most > 0.0) {
        double after = NEARBY / most;
        for (int glance = 0; glance < 3; glance++, after *= 0.25)
            look_nearby(run, glance, t, x, dx, after, after);
        adopt(run, 0, 1, 1, 2);
    }
    memset(way, 0, run->in.n_x * sizeof(double));
    for (long long m = 0; m < run->in.n_model; m++) /* in no special direction */
        way[m] = run->in.absolute[m] / run->in.unit * (1.0 + 0.618 * (m % 7));
    for (int glance = 0; glance < GLANCES; glance++)
        look_nearby(run, glance, t, x, way, (glance % 2 ? -1 : 1) * NEARBY / (1 + 3 * (glance / 2)), 0.0);
    adopt(run, 0, 1, 2, 3);
}

static int are_numbers(const double *values, long long count) {
    double sum = 0.0;
    for (long long e = 0; e < count; e++) sum += values[e];
    return !isnan(sum);
}

/* x' and S'. */
void vary(Run *run, double t, const double *x, double *dx) {
    const long long n = run->in.n_x, k = run->in.k;
    run->res[1] = run->slopes_x, run->res[2] = run->slopes_p;
    evaluate(run, run->in.slopes, t, x, dx);
    if (!are_numbers(run->slopes_x, run->in.in_x.count)
        || !are_numbers(run->slopes_p, run->in.in_p.count))
        take_limits(run, t, x, dx);
    memset(dx + n, 0, run->in.n_model * k * sizeof(double));
    multiply(&run->in.in_x, run->slopes_x, x + n, dx + n, k);
    multiply(&run->in.in_p, run->slopes_p, directions(run), dx + n, k);
}

/* Error of the step in S, that of the worst column. The size of a column is its own, in units
   of nominal sizes of states, or its floor. */
double columns_error(Run *run, double h) {
    const long long n = run->in.n_model, k = run->in.k, first = run->in.n_x;
    const double *x = run->out.x + first, *end = run->x_new + first, *absolute = run->in.absolute;
    double *restrict size = run->column_error, *restrict six = size + k;
    double *restrict five = six + k, *restrict three = five + k;
    double **slope = run->k, worst = 0.0;
    memset(six, 0, 3 * k * sizeof(double));
    for (long long c = 0; c < k; c++) size[c] = 0.01 * run->in.column_size[c] / run->in.unit;
    for (long long m = 0, at = 0; m < n; m++)
        for (long long c = 0; c < k; c++, at++)
            size[c] = larger(size[c], larger(fabs(x[at]), fabs(end[at])) / absolute[m]);
    for (long long m = 0, at = 0; m < n; m++)
        for (long long c = 0; c < k; c++, at++) {
#define J(E, j) E[j] * slope[j][first + at]
#define SUM(E) J(E, 0) + J(E, 5) + J(E, 6) + J(E, 7) + J(E, 8) + J(E, 9) + J(E, 10) + J(E, 11)
            const double own = larger(fabs(x[at]), fabs(end[at])) + 0.1 * absolute[m] * size[c];
            const double scale = 1.0 / (run->in.slack * run->in.relative * own + DBL_MIN);
            const double e6 = (SUM(E6)) * scale, e5 = (SUM(E5)) * scale, e3 = (SUM(E3)) * scale;
#undef SUM
#undef J
            six[c] += e6 * e6;
            five[c] += e5 * e5;
            three[c] += e3 * e3;
        }
    for (long long c = 0; c < k; c++) {
        const double most = larger(six[c], five[c]), scale = most + 0.01 * three[c];
        const double error = scale > 0.0 ? fabs(h) * most / sqrt(n * scale) : 0.0;
        int lost = 0; /* after an event without derivative */
        for (long long m = 0; m < n; m++) lost |= !isfinite(x[k * m + c]);
        if (!lost && !(error < INFINITY)) return NAN;
        if (!lost) worst = fmax(worst, error);
    }
    return worst;
}

/* Change of a function's result by that of t, x and p; result in `change`. */
static void along(Run *run, Function f, double dt, const double *dx, const double *dp) {
    run->arg[4] = &dt, run->arg[5] = dx, run->arg[6] = dp;
    evaluate(run, f, run->out.t, run->out.x, run->change);
}

/* Column c of S and of the directions. */
static void take_column(Run *run, long long c) {
    const long long k = run->in.k;
    for (long long m = 0; m < run->in.n_model; m++)
        run->column_x[m] = run->out.x[run->in.n_x + k * m + c];
    for (long long j = 0; j < run->in.n_p; j++) run->column_p[j] = directions(run)[k * j + c];
}

/* Change of a function's result along direction c, in `change`; returns the size of that column of
   S, in units of the nominal sizes of states. */
double change_along(Run *run, Function f, long long c) {
    double size = 0.0;
    take_column(run, c);
    for (long long m = 0; m < run->in.n_model; m++)
        size = fmax(size, fabs(run->column_x[m]) / run->in.absolute[m]);
    size *= run->in.unit;
    along(run, f, run->event_along[c], run->column_x, run->column_p);
    return size;
}

static void add_slope(Run *run, double sign) {
    const long long k = run->in.k;
    evaluate(run, run->in.rhs, run->out.t, run->out.x, run->slope);
    for (long long m = 0; m < run->in.n_model; m++)
        for (long long c = 0; c < k; c++)
            run->out.x[run->in.n_x + k * m + c] += sign * run->slope[m] * run->event_along[c];
}

/* Begin event `which`: compute the change of its time and move S to the event. Returns the rate of
   its function and the sizes of what that rate is a sum of. */
Rate leave(Run *run, long long which) {
    const long long n = run->in.n_contacts, k = run->in.k, contacts = run->in.exact ? n : 0;
    const int guard = which >= contacts;
    long long row = guard ? which - contacts : which;
    if (!guard && run->modes[which] == 0.0) {
        evaluate(run, run->in.probe, run->out.t, run->out.x, run->probe);
        row += way_out(run, which) > 0.0 ? n : 2 * n;
    }
    const Function f = guard ? run->in.guards_along : run->in.contacts_along;
    evaluate(run, run->in.rhs, run->out.t, run->out.x, run->slope);
    memset(run->column_p, 0, run->in.n_p * sizeof(double));
    along(run, f, 1.0, run->slope, run->column_p);
    const double rate = run->change[row];
    for (long long c = 0; c < k; c++) {
        take_column(run, c);
        along(run, f, 0.0, run->column_x, run->column_p);
        run->event_along[c] = run->change[row] == 0.0 ? 0.0 : -run->change[row] / rate;
    }
    evaluate(run, guard ? run->in.guard_parts : run->in.contact_parts, run->out.t, run->out.x,
             run->change);
    const Rate found = {rate, run->change[row]};
    add_slope(run, 1.0);
    return found;
}

/* Propagate the change of the state through the jump that is about to happen. */
void carry(Run *run, Function f, long long offset) {
    const long long k = run->in.k, n = run->in.n_x;
    for (long long c = 0; c < k; c++) {
        change_along(run, f, c);
        for (long long m = 0; m < run->in.n_model; m++)
            run->out.x[n + k * m + c] = run->change[offset + m];
    }
}

/* End what `leave` began: move S back to the state at a given time. */
void arrive(Run *run) {
    const long long k = run->in.k;
    if (!k) return;
    add_slope(run, -1.0);
    for (long long r = 0; r < run->in.n_rows; r++) {
        const long long i = run->in.row_contact[r], m = run->in.row_state[r];
        if (run->in.exact && run->modes[i] == 0.0 && m >= 0)
            memset(run->out.x + run->in.n_x + k * m, 0, k * sizeof(double));
    }
    memset(run->event_along, 0, k * sizeof(double));
}
