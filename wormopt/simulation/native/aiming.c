/* The direction in which a contact in the plane begins to slip: that of its acceleration.
   Directions of onset follow the modes in s; see contacts.py and grip.py. */
#include "run.h"

enum { N_SWEEPS = 300, N_NEWTON = 30 };
enum { PATIENCE = 5, TOGETHER = 100 }; /* sweeps before Newton's method, contacts at most */
static const double ROUND = 6.283185307179586;
static const double SMALL = 1e-13;  /* share of the force too small to turn a direction */
static const double FIT = 1e-10;    /* turn, or share of the force, to which directions must fit */
static const double NUDGE = 1e-7;   /* step to differentiate forces by directions */
static const double GLANCE = 1e-7;  /* of the whole time, to measure how fast a direction turns */

/* Onset: initial direction, half the rate at which it turns, initial time. */
static double *direction(const Run *run, long long place) {
    return run->modes + run->in.n_contacts + N_ONSET * place;
}

int in_onset(const Run *run, long long i) {
    const double *d = run->in.planar[i] < 0 ? NULL : direction(run, run->in.planar[i]);
    return d && (d[0] != 0.0 || d[1] != 0.0);
}

void end_onset(Run *run, long long i) {
    if (run->in.planar[i] >= 0) memset(direction(run, run->in.planar[i]), 0, N_ONSET * sizeof(double));
}

/* Note the directions of forces on contacts at rest, before modes change. */
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

static double off(Run *run, long long k, double angle) {
    double *d = direction(run, k);
    d[0] = cos(angle), d[1] = sin(angle);
    evaluate(run, run->in.aims, run->out.t, run->out.x, run->aims);
    return run->aims[3 * k + 2];
}

/* Turn the direction of contact i until the force of onset is that of sliding. */
static void turn_onset(Run *run, long long i) {
    const long long k = run->in.planar[i];
    const double *d = direction(run, k);
    const double first = atan2(d[1], d[0]), begin = off(run, k, first);
    if (!(fabs(begin) > SMALL * run->in.nominal_force[i])) return;
    double a = 0.0, va = begin, b = begin > 0.0 ? -1e-6 : 1e-6, vb;
    while ((vb = off(run, k, first + b)) * begin > 0.0 && fabs(b) < ROUND)
        a = b, va = vb, b += fmax(-0.5, fmin(b, 0.5));
    if (!(vb * begin <= 0.0)) { /* other laws than that of largest dissipation may have none */
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

/* Begin the onset of contact i, just released. */
void begin_onset(Run *run, long long i) {
    const long long k = run->in.planar[i];
    if (k < 0) return;
    double *d = direction(run, k);
    memcpy(d, run->toward + 2 * k, 2 * sizeof(double));
    d[2] = 0.0, d[3] = run->out.t;
    turn_onset(run, i);
}

/* Solve m equations in place; each row ends with its right-hand side, then with its unknown. */
static void eliminate(long long m, double matrix[m][m + 1]) {
    for (long long c = 0; c < m; c++) {
        long long best = c;
        for (long long r = c + 1; r < m; r++)
            if (fabs(matrix[r][c]) > fabs(matrix[best][c])) best = r;
        for (long long j = 0; j <= m; j++) {
            const double kept = matrix[c][j];
            matrix[c][j] = matrix[best][j], matrix[best][j] = kept;
        }
        for (long long j = m; j >= c; j--) matrix[c][j] /= matrix[c][c];
        for (long long r = 0; r < m; r++)
            for (long long j = m; r != c && j >= c; j--) matrix[r][j] -= matrix[r][c] * matrix[c][j];
    }
}

/* Set the directions of m contacts; returns the errors of their forces, and their sum. */
static double off_together(Run *run, long long m, const long long *who, const double *angles,
                           double *found) {
    double sum = 0.0; /* also infinite or NaN if any is */
    for (long long j = 0; j < m; j++) {
        double *d = direction(run, run->in.planar[who[j]]);
        d[0] = cos(angles[j]), d[1] = sin(angles[j]);
    }
    evaluate(run, run->in.aims, run->out.t, run->out.x, run->aims);
    for (long long j = 0; j < m; j++) {
        found[j] = run->aims[3 * run->in.planar[who[j]] + 2] / run->in.nominal_force[who[j]];
        sum += fabs(found[j]);
    }
    return sum;
}

/* Turn m contacts at once by damped Newton steps. Returns whether they fit; else they stay. */
static int turn_together(Run *run, long long m, const long long *who) {
    double angles[m], before[m], next[m], off_now[m], off_then[m], matrix[m][m + 1];
    for (long long j = 0; j < m; j++) {
        const double *d = direction(run, run->in.planar[who[j]]);
        before[j] = angles[j] = atan2(d[1], d[0]);
    }
    double sum = off_together(run, m, who, angles, off_now);
    for (int n = 0; n < N_NEWTON; n++) {
        for (long long c = 0; c < m; c++) {
            memcpy(next, angles, sizeof next);
            next[c] += NUDGE;
            off_together(run, m, who, next, off_then);
            for (long long r = 0; r < m; r++) matrix[r][c] = (off_then[r] - off_now[r]) / NUDGE;
            matrix[c][m] = off_now[c];
        }
        eliminate(m, matrix);
        double then = INFINITY, part = 1.0;
        for (; part > 1e-3 && !(then < sum); part *= 0.5) {
            for (long long c = 0; c < m; c++) next[c] = angles[c] - part * matrix[c][m];
            then = off_together(run, m, who, next, off_then);
        }
        if (!(then < sum)) break;
        sum = then;
        memcpy(angles, next, sizeof angles), memcpy(off_now, off_then, sizeof off_now);
    }
    off_together(run, m, who, sum <= FIT ? angles : before, off_now);
    return sum <= FIT;
}

/* Turn all contacts in onset until they fit each other. Returns whether they converge. */
int sweep_onsets(Run *run) {
    const long long n = run->in.n_contacts;
    long long who[n + 1], m = 0;
    for (long long i = 0; i < n; i++)
        if (in_onset(run, i)) who[m++] = i;
    double change = 0.0;
    for (int sweep = 1; sweep <= N_SWEEPS; sweep++) {
        change = 0.0;
        for (long long j = 0; j < m; j++) {
            const double *d = direction(run, run->in.planar[who[j]]), before[2] = {d[0], d[1]};
            turn_onset(run, who[j]);
            change += fabs(d[0] - before[0]) + fabs(d[1] - before[1]);
        }
        if (change <= SMALL) return 1;
        if (sweep % PATIENCE == 0 && m <= TOGETHER && turn_together(run, m, who)) return 1;
    }
    return change <= FIT;
}

/* Force error of contact i shortly after, if it turned at half the rate. */
static double off_later(Run *run, long long i, double rate) {
    const long long k = run->in.planar[i];
    direction(run, k)[2] = rate;
    const double later = run->out.t + GLANCE * (run->in.t_end - run->in.t_start);
    evaluate(run, run->in.aims, later, run->column, run->aims);
    return run->aims[3 * k + 2];
}

/* Find how fast the directions of contacts in onset turn. */
void follow_onsets(Run *run) {
    const long long n = run->in.n_contacts;
    const double glance = GLANCE * (run->in.t_end - run->in.t_start);
    long long count = 0;
    for (long long i = 0; i < n; i++)
        if (run->fresh[i] = in_onset(run, i) && direction(run, run->in.planar[i])[3] == run->out.t
                            && direction(run, run->in.planar[i])[2] == 0.0)
            count++;
    if (count == 0) return;
    evaluate(run, run->in.rhs, run->out.t, run->out.x, run->stage);
    for (long long m = 0; m < run->in.n_x; m++)
        run->column[m] = run->out.x[m] + glance * run->stage[m];
    for (int again = 0; again < (count > 1 ? 2 : 1); again++)
        for (long long i = 0; i < n; i++) {
            if (run->fresh[i] == 0.0) continue;
            const double still = off_later(run, i, 0.0), change = off_later(run, i, 1.0) - still;
            double *rate = direction(run, run->in.planar[i]) + 2;
            const int turns = fabs(still) > SMALL * run->in.nominal_force[i]
                              && fabs(still) < fabs(change) / glance;
            *rate = turns ? -still / change : 0.0;
        }
}
