/* What a step may miss: the steep part of a smooth law, kinks of forces in the plane. */
#include "run.h"

enum { N_LOOKS = 17 };

/* Least of sign v within a step, by parabolas through neighbouring samples: a dip may be far
   shorter than the time between samples. */
static double least_between(const double *v, double sign) {
    double least = INFINITY;
    for (int k = 1; k < N_LOOKS - 1; k++) {
        const double slope = sign * (v[k + 1] - v[k - 1]) / 2;
        const double bend = sign * (v[k - 1] + v[k + 1] - 2 * v[k]);
        const double dip = fabs(slope) < bend ? slope * slope / (2 * bend) : 0.0;
        least = smaller(least, sign * v[k] - dip);
    }
    return least;
}

/* Value at theta of the cubic through the values and derivatives of a state at both ends. */
static double cubic(const Run *run, long long m, double h, double theta) {
    const double a = run->out.x[m], rise = run->x_new[m] - a;
    const double first = h * run->k[0][m], last = h * run->k[12][m];
    const double square = 3 * rise - 2 * first - last, cube = first + last - 2 * rise;
    return a + theta * (first + theta * (square + theta * cube));
}

/* Velocity of a contact at theta from the polynomial of the step and from the cubics. Stages within
   a dip may distort the polynomial, while the cubics use both ends only. */
static void look(Run *run, long long i, double h, double theta, double *v, double *plain) {
    const long long m = run->in.velocity_state[i], n_x = run->in.n_x;
    if (m >= 0) {
        *v = dense_component(run, m, theta);
        *plain = cubic(run, m, h, theta);
        return;
    }
    dense_state(run, theta, run->column, n_x);
    evaluate(run, run->in.velocities, run->out.t + h * theta, run->column, run->probe);
    *v = run->probe[i];
    for (long long j = 0; j < n_x; j++) run->column[j] = cubic(run, j, h, theta);
    evaluate(run, run->in.velocities, run->out.t + h * theta, run->column, run->probe);
    *plain = run->probe[i];
}

/* Whether a velocity enters and leaves the steep layer of the smooth law within the step: the layer
   would act between the stages, unseen by the error estimate. */
int dips_into_layer(Run *run, double h) {
    for (long long i = 0; i < run->in.n_contacts; i++) {
        const double layer = 8 * run->in.v_layer[i];
        const long long m = run->in.velocity_state[i];
        if (m >= 0) {
            double a = run->out.x[m], b = run->x_new[m], sign = a > 0.0 ? 1.0 : -1.0;
            if (fabs(a) <= layer || sign * b <= layer) continue;
            double least = sign * smaller(sign * (a + h * run->k[0][m] / 3),
                                       sign * (b - h * run->k[12][m] / 3));
            if (sign * least > larger(layer, 0.3 * smaller(fabs(a), fabs(b)))) continue;
        }
        if (!run->has_dense) fit_dense(run, h);
        run->has_dense = 1;
        double v[N_LOOKS], plain[N_LOOKS];
        for (int k = 0; k < N_LOOKS; k++) look(run, i, h, k / (N_LOOKS - 1.0), &v[k], &plain[k]);
        const double sign = v[0] > 0.0 ? 1.0 : -1.0;
        const double first = sign * v[0], last = sign * v[N_LOOKS - 1];
        const double least = smaller(least_between(v, sign), least_between(plain, sign));
        if (first > layer && last > layer && least < layer) return 1;
    }
    return 0;
}

/* Whether a long step passes velocity 0 along the heading of a contact in the plane, where its
   force has a kink that the error estimate may miss. */
int goes_over_bend(Run *run, double h) {
    double *before = run->bend, *after = run->bend + 2 * run->in.n_contacts;
    evaluate(run, run->in.bends, run->out.t, run->out.x, before);
    evaluate(run, run->in.bends, run->out.t + h, run->x_new, after);
    for (long long i = 0; i < run->in.n_contacts; i++) {
        const long long k = 2 * run->in.planar[i];
        if (k < 0 || !(before[k] * after[k] < 0.0)) continue;
        const double speed = larger(before[k + 1], after[k + 1]);
        if (fabs(after[k] - before[k]) > 1e-6 * speed + 1e-9 * run->in.nominal_speed[i]) return 1;
    }
    return 0;
}
