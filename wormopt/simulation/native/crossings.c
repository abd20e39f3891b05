/* When a contact or a switch has to be decided anew: zeros of event functions within a step.

   Event function j is positive while things stay as they are: for a sliding contact its velocity in
   the direction of sliding, for a resting one the distance of its force from the nearer bound, for
   a switch minus its guard. In the plane a contact slides while its speed is above that of a stop;
   its onset lasts while it goes ahead, and until it is fast enough and its error counts. An event
   is where it falls below its level. The level is 0 once it has been well above 0; until then it is
   a little lower, so that a contact that has just been let go, with no velocity and perhaps no
   acceleration, is not caught again by a rounding error. A switch that has just fired and whose
   guard goes on rising has no level at all. */
#include "run.h"

enum { N_SAMPLES = 11 };
static const double SAMPLES[N_SAMPLES] = {0.0,   1.0 / 64, 0.125, 0.25,      0.375, 0.5,
                                          0.625, 0.75,     0.875, 63.0 / 64, 1.0};

/* Share of the whole time from which a step at velocity 0, but for rounding, is no mere touch. */
static const double AT_REST = 1e-3;

/* Size below which event function j is rounding. */
double small(const Run *run, long long j) {
    if (j >= n_exact(run)) return run->passed[j - n_exact(run)];
    return run->modes[j] ? run->in.v_rest[j] : run->in.f_rest[j];
}

/* For a moving contact in the plane. `reach`: speed of a stop; least and largest speed at the end
   of an onset; the least over its largest error. */
static double planar_value(const Run *run, long long i, double v) {
    const long long n = run->in.n_contacts;
    const double *reach = run->in.reach + i, error = -run->probe[2 * n + i];
    if (!in_onset(run, i)) return v - reach[0];
    return fmin(v, fmax(reach[n] - v, fmin(reach[2 * n] - v, reach[n] - reach[3 * n] * error)));
}

void event_values(Run *run, double t, const double *x, double *value) {
    const long long n = n_exact(run);
    if (n) {
        int states = 1;
        for (long long i = 0; i < n; i++)
            states &= run->modes[i] != 0.0 && run->in.velocity_state[i] >= 0;
        if (!states) evaluate(run, run->in.probe, t, x, run->probe);
        for (long long i = 0; i < n; i++) {
            double v = states ? x[run->in.velocity_state[i]] : run->probe[i];
            if (run->modes[i] == 0.0)
                value[i] = margin(run->probe, n, i);
            else
                value[i] = run->in.planar[i] < 0 ? run->modes[i] * v : planar_value(run, i, v);
        }
    }
    if (run->in.n_switches) {
        evaluate(run, run->in.guards, t, x, run->guard);
        for (long long k = 0; k < run->in.n_switches; k++) value[n + k] = -run->guard[k];
        /* the rates of the guards follow, see note_fired */
    }
}

/* Whether all event functions are velocities that are states. */
static int only_velocities(const Run *run) {
    int only = run->in.n_switches == 0;
    for (long long i = 0; i < n_exact(run); i++)
        only &= run->modes[i] != 0.0 && run->in.velocity_state[i] >= 0;
    return only;
}

/* Whether a velocity cannot reach 0 in the closed step: its values at both ends and the slopes of
   all stages exclude it, or it starts at 0 and all slopes lead away. */
static int keeps_away(const Run *run, double h, long long i) {
    const long long m = run->in.velocity_state[i];
    const double a = run->modes[i] * run->out.x[m], b = run->modes[i] * run->x_new[m];
    double least = INFINITY, most = -INFINITY;
    for (int j = 0; j < N_STAGES + 1; j++) {
        const double slope = run->modes[i] * run->k[j][m];
        least = smaller(least, slope), most = larger(most, slope);
    }
    const double rest = small(run, i), near = smaller(a, b);
    if (b > rest && least > 0.3 * most) return a >= run->level[i];
    const double falls = smaller(least, 0.0), rises = larger(most, 0.0), width = rises - falls;
    return near > rest && a * rises - b * falls + h * falls * rises > 0.3 * near * width;
}

/* Whether the closed step has no event because no velocity can reach 0. Saves the polynomial. */
int keep_sliding(Run *run, double h) {
    if (run->in.k || !only_velocities(run)) return 0;
    fetch_stages(run);
    for (long long i = 0; i < n_exact(run); i++)
        if (!keeps_away(run, h, i)) return 0;
    for (long long i = 0; i < n_exact(run); i++) run->level[i] = 0.0;
    return 1;
}

static void values_within(Run *run, double theta, double h, double *value) {
    if (only_velocities(run)) {
        for (long long i = 0; i < n_exact(run); i++)
            value[i] = run->modes[i] * dense_component(run, run->in.velocity_state[i], theta);
        return;
    }
    dense_state(run, theta, run->column, run->in.n_x);
    event_values(run, run->out.t + theta * h, run->column, value);
}

static double value_within(Run *run, long long j, double theta, double h) {
    if (j < n_exact(run) && run->modes[j] != 0.0 && run->in.velocity_state[j] >= 0)
        return run->modes[j] * dense_component(run, run->in.velocity_state[j], theta);
    values_within(run, theta, h, run->value);
    return run->value[j];
}

/* Least value of function j between a and b by golden section. */
static double lowest(Run *run, long long j, double h, double a, double b, double *at) {
    const double ratio = 0.6180339887498949;
    double p = b - ratio * (b - a), q = a + ratio * (b - a);
    double vp = value_within(run, j, p, h), vq = value_within(run, j, q, h);
    while (b - a > 1e-7) {
        if (vp < vq) {
            b = q, q = p, vq = vp;
            p = b - ratio * (b - a), vp = value_within(run, j, p, h);
        } else {
            a = p, p = q, vp = vq;
            q = a + ratio * (b - a), vq = value_within(run, j, q, h);
        }
    }
    *at = vp < vq ? p : q;
    return smaller(vp, vq);
}

/* Where function j falls through the level between a and b: regula falsi (Illinois), safeguarded. */
static double crossing(Run *run, long long j, double h, double a, double b, double va, double vb,
                       double level) {
    va -= level, vb -= level;
    if (va <= 0.0) return a;
    for (int i = 0, side = 0; i < 100 && b - a > 1e-15; i++) {
        double c = isfinite(va) && isfinite(vb) && i < 40 ? (a * vb - b * va) / (vb - va) : NAN;
        if (!(c > a && c < b)) c = 0.5 * (a + b);
        if (c == a || c == b) break;
        double vc = value_within(run, j, c, h) - level;
        if (vc > 0.0) {
            a = c, va = vc;
            if (side == 1) vb *= 0.5;
            side = 1;
        } else {
            b = c, vb = vc;
            if (side == -1) va *= 0.5;
            side = -1;
            if (vc == 0.0) break;
        }
    }
    return b;
}

/* First crossing of function j in the sampled step if it is before `limit`, else 2; notes its level
   if it has none. The values at the limit are the last row but one. */
static double first_crossing(Run *run, long long j, double h, const double *value, double limit) {
    const long long n = n_functions(run);
    double level = run->level[j];
    for (int k = 0; k < N_SAMPLES; k++) {
        const double here = value[k * n + j], at_limit = value[N_SAMPLES * n + j];
        if (k > 0 && SAMPLES[k - 1] >= limit) return 2.0;
        if (here < level) {
            if (k == 0) return 0.0;
            const double before = value[(k - 1) * n + j];
            if (limit >= SAMPLES[k])
                return crossing(run, j, h, SAMPLES[k - 1], SAMPLES[k], before, here, level);
            if (at_limit >= level) return 2.0;
            return crossing(run, j, h, SAMPLES[k - 1], limit, before, at_limit, level);
        }
        if (k >= 2) { /* a dip between samples */
            double a = value[(k - 2) * n + j], b = value[(k - 1) * n + j], at;
            double depth = smaller(a, here) - b;
            if (b < a && b <= here && b - level < 4 * larger(larger(a, here) - b, depth)) {
                const double least = lowest(run, j, h, SAMPLES[k - 2], SAMPLES[k], &at);
                if (least < level) {
                    double low = value_within(run, j, at, h);
                    return crossing(run, j, h, SAMPLES[k - 2], at, a, low, level);
                }
                if (run->in.k) note_touch(run, j, at, least, larger(a, here));
            }
        }
        if (k > 0 && here > small(run, j)) level = 0.0;
    }
    run->scan[(N_SAMPLES + 1) * n + j] = level;
    return 2.0;
}

/* Where function j, found to cross at theta, falls through its level, which is noted. The level of
   a fired switch is 0 if the function was above 0 since, even between samples. */
static double crossing_since(Run *run, long long j, double h, double theta) {
    const long long n = n_functions(run);
    double *level = run->scan + (N_SAMPLES + 1) * n + j;
    *level = run->level[j];
    if (j < n_exact(run) || *level == 0.0 || theta * h <= floor_of_step(run)) return theta;
    for (int k = 1; k < N_SAMPLES && SAMPLES[k] < theta; k++)
        if (run->scan[k * n + j] > 0.0) *level = 0.0;
    for (double at = 0.5 * theta; *level != 0.0 && at > 1e-3 * theta; at *= 0.5) {
        const double up = value_within(run, j, at, h);
        if (!(up > 0.0)) continue;
        theta = crossing(run, j, h, at, theta, up, value_within(run, j, theta, h), 0.0);
        if (theta * h > floor_of_step(run)) *level = 0.0;
        break;
    }
    return theta;
}

/* Reject a prescribed velocity that stays 0 for a while: its contact force is undetermined. */
static void check_moves(Run *run, double h) {
    const long long n = n_functions(run);
    const int is_long = h > AT_REST * (run->in.t_end - run->in.t_start);
    for (long long i = 0; i < n_exact(run); i++) {
        double most = 0.0;
        if (!is_prescribed(run, i)) continue;
        for (int k = 0; k < N_SAMPLES; k++) most = larger(most, fabs(run->scan[k * n + i]));
        if (most <= (is_long ? run->in.v_rest[i] : 0.0)) run->out.status = OPEN_FORCE;
    }
}

/* First event of the step of length h, as a fraction of it; 2 if there is none. */
double find_event(Run *run, double h, long long *which) {
    const long long n = n_functions(run);
    for (int k = 0; k < N_SAMPLES; k++) values_within(run, SAMPLES[k], h, run->scan + k * n);
    for (long long i = 0; i < N_SAMPLES * n; i++)
        if (isnan(run->scan[i])) run->out.status = NOT_FINITE;
    check_moves(run, h);
    double first = 2.0;
    for (long long j = 0; j < n && run->in.k; j++) run->touch[j] = INFINITY;
    for (long long j = 0; j < n; j++) {
        double theta = first_crossing(run, j, h, run->scan, first);
        if (theta >= first) continue;
        first = crossing_since(run, j, h, theta), *which = j;
        values_within(run, first, h, run->scan + N_SAMPLES * n);
    }
    if (first > 1.0) memcpy(run->level, run->scan + (N_SAMPLES + 1) * n, n * sizeof(double));
    else run->level[*which] = run->scan[(N_SAMPLES + 1) * n + *which];
    /* functions well above 0 before the event are armed, whichever has the event */
    for (int k = 1; k < N_SAMPLES && SAMPLES[k] < first && first <= 1.0; k++)
        for (long long j = 0; j < n; j++)
            if (j != *which && run->scan[k * n + j] > small(run, j)) run->level[j] = 0.0;
    if (run->in.k) doubt_touches(run, h, first);
    return first;
}

/* Whether function j would fall only negligibly below 0 after theta, and rise again in the step. */
int grazes(Run *run, double h, double theta, long long j) {
    const long long n = n_functions(run);
    const double end = run->scan[(N_SAMPLES - 1) * n + j];
    int rises = 0;
    for (int k = 0; k < N_SAMPLES - 1; k++) rises |= SAMPLES[k] > theta && run->scan[k * n + j] < end;
    double at, largest = 0.0;
    for (int k = 0; k < N_SAMPLES; k++) largest = larger(largest, fabs(run->scan[k * n + j]));
    return (rises || end > 0.0)
           && lowest(run, j, h, theta, 1.0, &at) >= -run->in.small_value * function_size(run, j, largest);
}

/* Whether a switch that has just fired fires again while its guard falls: a ball on its way up from
   a floor that lies between two numbers. The step of length h was to go much further. */
int fires_by_rounding(Run *run, double h, long long which) {
    const long long k = which - n_exact(run);
    if (run->out.t - run->fired[k] > SAMPLES[1] * h) return 0;
    event_values(run, run->out.t, run->out.x, run->value);
    return run->guard[run->in.n_switches + k] < 0.0;
}

/* Shift the end of a step of length h by a time so short that its slope there is exact to the last
   bit. Returns whether the time was that short. */
static int shift_end(Run *run, double h, double shift) {
    const long long n = run->in.n_x;
    if (run->in.k) return 0;
    close_step(run, h);
    const double *start = run->k[0], *slope = run->k[12];
    double *x = run->x_new;
    int fine = 1;
    for (long long m = 0; m < n; m++) {
        const double off = shift * shift * fabs(slope[m] - start[m]), unit = run->in.absolute[m] / run->in.unit;
        fine &= off <= 0.01 * DBL_EPSILON * unit * h;
    }
    for (long long m = 0; m < n && fine; m++) x[m] += shift * slope[m];
    return fine;
}

/* Length of the step that ends at the event. The polynomial is of a lower order than the steps, so
   the step itself is taken and corrected by Newton's method; x_new holds its end. */
double polish_event(Run *run, double h, double theta, long long which) {
    const double delta = 1e-4, length = theta * h;
    const double slope = (value_within(run, which, smaller(theta + delta, 1.0), h)
                          - value_within(run, which, larger(theta - delta, 0.0), h))
                         / ((smaller(theta + delta, 1.0) - larger(theta - delta, 0.0)) * h);
    double best = length, least = INFINITY, next = length;
    for (int i = 0; i < 4; i++) {
        stages(run, next);
        event_values(run, run->out.t + next, run->x_new, run->value);
        double value = run->value[which];
        if (fabs(value) < least) least = fabs(value), best = next;
        if (run->level[which] != 0.0 || !(slope < 0.0) || fabs(value) <= 1e-3 * small(run, which)
            || fabs(value) > least)
            break;
        double corrected = next - value / slope;
        if (!(corrected > 0.0 && corrected <= h) || corrected == next) break;
        if (shift_end(run, next, corrected - next)) return corrected;
        next = corrected;
    }
    if (next != best) stages(run, best);
    return best;
}

/* Value above which an event function is well above 0: for a switch more than its change in a time
   of rounding. */
static double clearly_above(const Run *run, long long j) {
    if (j < n_exact(run)) return small(run, j);
    const double rate = run->guard[run->in.n_switches + j - n_exact(run)];
    return larger(small(run, j), 1e3 * floor_of_step(run) * fabs(rate));
}

/* Raise levels of functions well above 0; at the start of a run those of all guards not above 0. */
void set_levels(Run *run, int at_start) {
    event_values(run, run->out.t, run->out.x, run->value);
    for (long long j = 0; j < n_functions(run); j++) {
        int guard = j >= n_exact(run);
        if (at_start) run->level[j] = !guard ? -small(run, j) : run->value[j] < 0.0 ? -INFINITY : 0.0;
        if (run->value[j] > clearly_above(run, j)) run->level[j] = 0.0;
    }
}
