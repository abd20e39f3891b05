/* What a step may pass unseen: the steep part of a smooth law, bends of forces in the plane. */
#include <math.h>

#include "run.h"

/* Whether a velocity enters the steep layer of the smooth law and leaves it again within the step:
   the steep part would act between the stages and no error estimate would know. */
int dips_into_layer(Run *run, double h) {
    for (long long i = 0; i < run->in.n_contacts; i++) {
        const double layer = 8 * run->in.v_layer[i];
        const long long m = run->in.velocity_state[i];
        if (m >= 0) {
            double a = run->out.x[m], b = run->x_new[m], sign = a > 0.0 ? 1.0 : -1.0;
            if (fabs(a) <= layer || sign * b <= layer) continue;
            double least = sign * fmin(sign * (a + h * run->k[0][m] / 3),
                                       sign * (b - h * run->k[12][m] / 3));
            if (sign * least > fmax(layer, 0.3 * fmin(fabs(a), fabs(b)))) continue;
        }
        if (!run->has_dense) fit_dense(run, h);
        run->has_dense = 1;
        double first = 0.0, last = 0.0, least = INFINITY;
        for (int k = 0; k <= 16; k++) {
            double v;
            if (m >= 0) {
                v = dense_component(run, m, k / 16.0);
            } else {
                dense_state(run, k / 16.0, run->column, run->in.n_x);
                evaluate(run, run->in.velocities, run->out.t + h * k / 16.0, run->column, run->probe);
                v = run->probe[i];
            }
            if (k == 0) first = v;
            if (k == 16) last = v;
            least = fmin(least, first > 0.0 ? v : -v);
        }
        double sign = first > 0.0 ? 1.0 : -1.0;
        if (fabs(first) > layer && sign * last > layer && least < layer) return 1;
    }
    return 0;
}

/* Whether a long step goes over velocity 0 along the heading of a contact in the plane, where its
   force bends: the error estimate may miss it by chance. */
int goes_over_bend(Run *run, double h) {
    double *before = run->bend, *after = run->bend + 2 * run->in.n_contacts;
    evaluate(run, run->in.bends, run->out.t, run->out.x, before);
    evaluate(run, run->in.bends, run->out.t + h, run->x_new, after);
    for (long long i = 0; i < run->in.n_contacts; i++) {
        const long long k = 2 * run->in.planar[i];
        if (k < 0 || !(before[k] * after[k] < 0.0)) continue;
        const double speed = fmax(before[k + 1], after[k + 1]);
        if (fabs(after[k] - before[k]) > 1e-6 * speed + 1e-9 * run->in.nominal_speed[i]) return 1;
    }
    return 0;
}
