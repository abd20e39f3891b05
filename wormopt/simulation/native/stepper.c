/* One step of DOP853, its error and its dense output. Hairer, Norsett, Wanner, section II.10. */
#include "run.h"
#include "stages.h"

#pragma GCC push_options
#pragma GCC optimize("fp-contract=fast") /* as in lanes.h */

void derivative(Run *run, double t, const double *x, double *dx) {
    run->out.n_evaluations++;
    if (run->in.k)
        vary(run, t, x, dx);
    else
        evaluate(run, run->in.rhs, t, x, dx);
}

#define STAGE(i, sum)                                                   \
    for (long long m = 0; m < n; m++) y[m] = x[m] + h * (sum);          \
    derivative(run, t + C[i] * h, y, k[i])

/* The stages of a step whose vectors have n entries; n is known after inlining. */
static inline __attribute__((always_inline)) void take_stages(Run *run, double h, long long n) {
    const double t = run->out.t, *restrict x = run->out.x;
    double **k = run->k, *restrict y = run->stage, *restrict end = run->x_new;
    run->fetched = 1; /* from here on the stages are in k */
    STAGES;
    for (long long m = 0; m < n; m++) end[m] = x[m] + h * STEP_SUM(B);
}

/* Compute the stages of a step of length h from (t, x) with derivative k[0] to its end x_new. Short
   vectors use whole registers, padded with zeros. */
void stages(Run *run, double h) {
    if (run->in.own_stages && !run->in.k) {
        run->in.own_stages(run->out.t, h, run->out.x, run->out.p, run->modes, run->k, run->stage,
                           run->x_new);
        run->out.n_evaluations += N_STAGES - 1;
        run->fetched = 1;
        return;
    }
    switch ((run->in.n_all + 3) / 4) {
    case 1: take_stages(run, h, 4); break;
    case 2: take_stages(run, h, 8); break;
    case 3: take_stages(run, h, 12); break;
    default: take_stages(run, h, run->in.n_all);
    }
}

/* Error of the step against the tolerances; at most 1 is good, NaN where numbers are bad. */
double step_error(Run *run, double h) {
    const long long n = run->in.n_x;
    const double *x = run->out.x, *end = run->x_new, *absolute = run->in.absolute;
    double **k = run->k, six = 0.0, five = 0.0, three = 0.0;
    for (long long m = 0; m < n; m++) {
        double scale = 1.0 / (absolute[m] + run->in.relative * larger(fabs(x[m]), fabs(end[m])));
        double e6 = STEP_SUM(E6) * scale, e5 = STEP_SUM(E5) * scale, e3 = STEP_SUM(E3) * scale;
        six += e6 * e6;
        five += e5 * e5;
        three += e3 * e3;
    }
    five = larger(six, five); /* five alone may be small by chance, see steps.py */
    double scale = five + 0.01 * three;
    if (!(scale < INFINITY)) return NAN;
    const double error = scale > 0.0 ? fabs(h) * five / sqrt(n * scale) : 0.0;
    const double other = run->in.k && error <= 1.0 ? columns_error(run, h) : 0.0;
    run->by_columns = !(other <= error); /* NaN counts */
    return run->by_columns ? other : error;
}

/* error^(-1/8), by which a step of order 8 may be longer for an error of 1. */
double lengthening(double error) { return 1.0 / sqrt(sqrt(sqrt(error))); }

/* Derivative at the end of the step. */
void close_step(Run *run, double h) { derivative(run, run->out.t + h, run->x_new, run->k[12]); }

/* Rows of the polynomial of a closed step, see `Dense` in trajectory.py. */
void fit_dense(Run *run, double h) {
    const long long n = run->in.n_all;
    const double t = run->out.t, *restrict x = run->out.x, *end = run->x_new;
    double **k = run->k, *y = run->reset, *d = run->dense; /* `stage` is kept for looks_stiff */
    fetch_stages(run);
    STAGE(13, T(13, 0) + T(13, 6) + T(13, 7) + T(13, 8) + T(13, 9) + T(13, 10) + T(13, 11)
                  + T(13, 12));
    STAGE(14, T(14, 0) + T(14, 5) + T(14, 6) + T(14, 7) + T(14, 10) + T(14, 11) + T(14, 12)
                  + T(14, 13));
    STAGE(15, T(15, 0) + T(15, 5) + T(15, 6) + T(15, 7) + T(15, 8) + T(15, 12) + T(15, 13)
                  + T(15, 14));
#undef STAGE
    for (long long m = 0; m < n; m++) {
        double delta = end[m] - x[m];
        d[m] = x[m];
        d[n + m] = delta;
        d[2 * n + m] = h * k[0][m] - delta;
        d[3 * n + m] = 2 * delta - h * (k[12][m] + k[0][m]);
        for (int r = 0; r < 4; r++) {
            double sum = D[r][0] * k[0][m];
            for (int j = 5; j < N_ALL; j++) sum += D[r][j] * k[j][m];
            d[(4 + r) * n + m] = h * sum;
        }
    }
}

double dense_component(const Run *run, long long i, double theta) {
    const long long n = run->in.n_all;
    const double s = theta, r = 1.0 - theta, *d = run->dense + i;
    return d[0] + s * (d[n] + r * (d[2 * n] + s * (d[3 * n] + r * (d[4 * n]
           + s * (d[5 * n] + r * (d[6 * n] + s * d[7 * n]))))));
}

void dense_state(const Run *run, double theta, double *x, long long count) {
    for (long long i = 0; i < count; i++) x[i] = dense_component(run, i, theta);
}

/* Length of the first step, from the size of x, x' and x'' (Hairer's hinit). */
double first_step(Run *run) {
    const long long n = run->in.n_x;
    const double *x = run->out.x, *f = run->k[0];
    double size = 0.0, slope = 0.0, bend = 0.0;
    for (long long m = 0; m < n; m++) {
        double scale = run->in.absolute[m] + run->in.relative * fabs(x[m]);
        size += (x[m] / scale) * (x[m] / scale);
        slope += (f[m] / scale) * (f[m] / scale);
    }
    double h = size <= 1e-10 || slope <= 1e-10 ? 1e-6 : 0.01 * sqrt(size / slope);
    /* a moving state near 0 gives no time scale */
    double left = run->in.t_end - run->out.t;
    h = fmin(fmax(h, 1e-9 * left), left);
    /* beyond a break formulas of this piece are invalid, polynomials of a short one most of all */
    double probe = fmin(h, run->t_break - run->out.t);
    for (long long m = 0; m < run->in.n_all; m++) run->stage[m] = x[m] + probe * f[m];
    derivative(run, run->out.t + probe, run->stage, run->k[1]);
    for (long long m = 0; m < n; m++) {
        double scale = run->in.absolute[m] + run->in.relative * fabs(x[m]);
        double change = (run->k[1][m] - f[m]) / scale;
        bend += change * change;
    }
    double largest = fmax(sqrt(bend) / probe, sqrt(slope));
    double wanted = largest <= 1e-15 ? fmax(1e-6, h * 1e-3) : pow(0.01 / largest, 1.0 / 8.0);
    wanted = fmin(100 * h, wanted);
    return isfinite(wanted) && wanted > 0 ? wanted : h;
}

/* Whether stability and not accuracy has limited the last steps (Hairer's test). */
int looks_stiff(Run *run, double h) {
    if (++run->since_check < 1000 && run->stiff_hints == 0) return 0;
    run->since_check = 0;
    fetch_stages(run);
    double change = 0.0, way = 0.0;
    for (long long m = 0; m < run->in.n_x; m++) {
        double f = run->k[12][m] - run->k[11][m], y = run->x_new[m] - run->stage[m];
        change += f * f;
        way += y * y;
    }
    if (way > 0.0 && fabs(h) * sqrt(change / way) > 6.1) {
        run->unstiff_hints = 0;
        return ++run->stiff_hints >= 15;
    }
    if (run->stiff_hints && ++run->unstiff_hints == 6) run->stiff_hints = run->unstiff_hints = 0;
    return 0;
}
#pragma GCC pop_options
