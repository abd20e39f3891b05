/* Into which direction a contact in the plane begins to slip: that of its acceleration. The
   directions of onset follow the modes in s; see aiming.py and grip.py. */
#include <math.h>
#include <string.h>

#include "run.h"

enum { N_SWEEPS = 30 };
static const double SMALL = 1e-13; /* share of the force that does not turn a direction */

static double *direction(const Run *run, long long place) {
    return run->modes + run->in.n_contacts + 2 * place;
}

int in_onset(const Run *run, long long i) {
    const double *d = run->in.planar[i] < 0 ? NULL : direction(run, run->in.planar[i]);
    return d && (d[0] != 0.0 || d[1] != 0.0);
}

void end_onset(Run *run, long long i) {
    if (run->in.planar[i] >= 0) memset(direction(run, run->in.planar[i]), 0, 2 * sizeof(double));
}

/* Note where contacts at rest are pushed, before modes change. */
void look_where(Run *run) {
    if (!run->in.aims) return;
    evaluate(run, run->in.aims, run->out.t, run->out.x, run->aims);
    for (long long i = 0; i < run->in.n_contacts; i++) {
        const long long k = run->in.planar[i];
        if (k < 0) continue;
        const double size = hypot(run->aims[3 * k], run->aims[3 * k + 1]);
        for (int j = 0; j < 2; j++) run->toward[2 * k + j] = run->aims[3 * k + j] / size;
    }
}

/* Put contact i, just let go, on its way; then `turn_onset` it. */
void begin_onset(Run *run, long long i) {
    const long long k = run->in.planar[i];
    if (k >= 0) memcpy(direction(run, k), run->toward + 2 * k, 2 * sizeof(double));
}

static double off(Run *run, long long k, double angle) {
    double *d = direction(run, k);
    d[0] = cos(angle), d[1] = sin(angle);
    evaluate(run, run->in.aims, run->out.t, run->out.x, run->aims);
    return run->aims[3 * k + 2];
}

/* Turn the direction of contact i until the force of onset is that of sliding. */
void turn_onset(Run *run, long long i) {
    const long long k = run->in.planar[i];
    if (k < 0) return;
    const double *d = direction(run, k);
    const double first = atan2(d[1], d[0]), begin = off(run, k, first);
    if (!(fabs(begin) > SMALL * run->in.nominal_force[i])) return;
    double a = 0.0, va = begin, b = begin > 0.0 ? -1e-6 : 1e-6, vb;
    while ((vb = off(run, k, first + b)) * begin > 0.0 && fabs(b) < 0.8)
        a = b, va = vb, b *= 4.0;
    if (!(vb * begin <= 0.0)) { /* a law that is not that of most power may have none */
        off(run, k, first);
        return;
    }
    for (int n = 0, side = 0; n < 100 && fabs(b - a) > 1e-15 && vb != 0.0; n++) {
        double c = n < 40 ? (a * vb - b * va) / (vb - va) : 0.5 * (a + b);
        if (!((c - a) * (c - b) < 0.0)) break;
        double vc = off(run, k, first + c);
        if (vc * va > 0.0) {
            a = c, va = vc;
            if (side == 1) vb *= 0.5;
            side = 1;
        } else {
            b = c, vb = vc;
            if (side == -1) va *= 0.5;
            side = -1;
        }
    }
    off(run, k, first + b);
}

/* Turn all that begin to slip until they fit each other. */
void sweep_onsets(Run *run) {
    const long long n = run->in.n_contacts;
    long long count = 0;
    for (long long i = 0; i < n; i++) count += in_onset(run, i);
    double change = INFINITY;
    for (int sweep = 0; sweep < N_SWEEPS && count > 1 && change > SMALL; sweep++) {
        change = 0.0;
        for (long long i = 0; i < n; i++) {
            if (!in_onset(run, i)) continue;
            const double *d = direction(run, run->in.planar[i]), before[2] = {d[0], d[1]};
            turn_onset(run, i);
            change = fmax(change, fmax(fabs(d[0] - before[0]), fabs(d[1] - before[1])));
        }
    }
}
