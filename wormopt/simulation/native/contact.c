/* The contact automaton: which contacts slide, which rest, and when that changes.

   Event function j is positive while things stay as they are: for a sliding contact its velocity in
   the direction of sliding, for a resting one the distance of its force from the nearer bound, for
   a switch minus its guard. In the plane a contact slides while its speed is above that of a stop;
   its onset lasts while it goes ahead, and until it is fast enough and its error counts. An event
   is where it falls below its level. The level is 0 once it has been well above 0; until then it is
   a little lower, so that a contact that has just been let go, with no velocity and perhaps no
   acceleration, is not caught again by a rounding error. A switch that has just fired and whose
   guard goes on rising has no level at all. */
#include <math.h>
#include <string.h>

#include "run.h"

enum { N_SAMPLES = 11 };
static const double F_REST = 1e-13; /* as in `InitialValueProblem.f_rest` */
static const double SAMPLES[N_SAMPLES] = {0.0,   1.0 / 64, 0.125, 0.25,      0.375, 0.5,
                                          0.625, 0.75,     0.875, 63.0 / 64, 1.0};

static long long n_exact(const Run *run) { return run->in.exact ? run->in.n_contacts : 0; }

long long n_functions(const Run *run) { return n_exact(run) + run->in.n_switches; }

/* Size below which event function j is nothing but rounding. */
static double small(const Run *run, long long j) {
    if (j >= n_exact(run)) return 0.0;
    return run->modes[j] ? run->in.v_rest[j] : run->in.f_rest[j];
}

static double margin(const double *probe, long long n, long long i) {
    double force = probe[2 * n + i], least = probe[3 * n + i], largest = probe[4 * n + i];
    return fmin(force - least, largest - force);
}

/* Of a moving contact in the plane. `reach`: speed of a stop; least and largest speed at the end of
   an onset, the least over its largest error. */
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

static void values_within(Run *run, double theta, double h, double *value) {
    dense_state(run, theta, run->column, run->in.n_x);
    event_values(run, run->out.t + theta * h, run->column, value);
}

static double value_within(Run *run, long long j, double theta, double h) {
    if (j < n_exact(run) && run->modes[j] != 0.0 && run->in.velocity_state[j] >= 0)
        return run->modes[j] * dense_component(run, run->in.velocity_state[j], theta);
    values_within(run, theta, h, run->value);
    return run->value[j];
}

/* Least value of function j between a and b by golden sections. */
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
    return fmin(vp, vq);
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
   if there is none at all. The values at the limit are the last row but one. */
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
            double depth = fmin(a, here) - b;
            if (b < a && b <= here && b - level < 4 * fmax(fmax(a, here) - b, depth)) {
                const double least = lowest(run, j, h, SAMPLES[k - 2], SAMPLES[k], &at);
                if (least < level) {
                    double low = value_within(run, j, at, h);
                    return crossing(run, j, h, SAMPLES[k - 2], at, a, low, level);
                }
                if (run->in.k) note_touch(run, j, at, least, fmax(a, here));
            }
        }
        if (k > 0 && here > small(run, j)) level = 0.0;
    }
    run->scan[(N_SAMPLES + 1) * n + j] = level;
    return 2.0;
}

/* First event of the step of length h, as a fraction of it; 2 if there is none. */
double find_event(Run *run, double h, long long *which) {
    const long long n = n_functions(run);
    for (int k = 0; k < N_SAMPLES; k++) values_within(run, SAMPLES[k], h, run->scan + k * n);
    for (long long i = 0; i < N_SAMPLES * n; i++)
        if (isnan(run->scan[i])) run->out.status = NOT_FINITE;
    double first = 2.0;
    for (long long j = 0; j < n && run->in.k; j++) run->touch[j] = INFINITY;
    for (long long j = 0; j < n; j++) {
        double theta = first_crossing(run, j, h, run->scan, first);
        if (theta >= first) continue;
        first = theta, *which = j;
        values_within(run, first, h, run->scan + N_SAMPLES * n);
    }
    if (first > 1.0) memcpy(run->level, run->scan + (N_SAMPLES + 1) * n, n * sizeof(double));
    /* what has been well above 0 before the event is armed, whoever has it */
    for (int k = 1; k < N_SAMPLES && SAMPLES[k] < first && first <= 1.0; k++)
        for (long long j = 0; j < n; j++)
            if (j != *which && run->scan[k * n + j] > small(run, j)) run->level[j] = 0.0;
    if (run->in.k) doubt_touches(run, h, first);
    return first;
}

/* Whether function j would fall next to nothing below 0 after theta, and rise again in the step. */
int grazes(Run *run, double h, double theta, long long j) {
    const long long n = n_functions(run);
    const double end = run->scan[(N_SAMPLES - 1) * n + j];
    int rises = 0;
    for (int k = 0; k < N_SAMPLES - 1; k++) rises |= SAMPLES[k] > theta && run->scan[k * n + j] < end;
    double at, largest = 0.0;
    for (int k = 0; k < N_SAMPLES; k++) largest = fmax(largest, fabs(run->scan[k * n + j]));
    return (rises || end > 0.0)
           && lowest(run, j, h, theta, 1.0, &at) >= -run->in.small_value * function_size(run, j, largest);
}

/* Length of the step that ends at the event. The polynomial is of a lower order than the steps, so
   the step itself is taken and corrected by Newton's method; x_new holds its end. */
double polish_event(Run *run, double h, double theta, long long which) {
    const double delta = 1e-4, length = theta * h;
    const double slope = (value_within(run, which, fmin(theta + delta, 1.0), h)
                          - value_within(run, which, fmax(theta - delta, 0.0), h))
                         / ((fmin(theta + delta, 1.0) - fmax(theta - delta, 0.0)) * h);
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
        next = corrected;
    }
    if (next != best) stages(run, best);
    return best;
}

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

/* Value above which an event function counts as well above 0: for a switch more than it loses in
   a time that is nothing but rounding. */
static double clearly_above(const Run *run, long long j) {
    if (j < n_exact(run)) return small(run, j);
    double rate = run->guard[run->in.n_switches + j - n_exact(run)];
    return rate > 0.0 ? 1e3 * floor_of_step(run) * rate : 0.0;
}

/* Raise levels of what is well above 0; at the start of a run those of all guards not above 0. */
void set_levels(Run *run, int at_start) {
    event_values(run, run->out.t, run->out.x, run->value);
    for (long long j = 0; j < n_functions(run); j++) {
        int guard = j >= n_exact(run);
        if (at_start) run->level[j] = !guard ? -small(run, j) : run->value[j] < 0.0 ? -INFINITY : 0.0;
        if (run->value[j] > clearly_above(run, j)) run->level[j] = 0.0;
    }
}

static int allowed(const Run *run, long long i, double direction) {
    return (run->in.directions[i] & (direction > 0.0 ? 1 : 2)) != 0;
}

/* Modes by velocity alone; what does not move is at rest. Tells whether a velocity must jump. */
static int modes_by_velocity(Run *run, long long forced, const double *v) {
    const long long n = run->in.n_contacts;
    int jump = 0;
    for (long long i = 0; i < n; i++) {
        double *mode = run->modes + i, rest = run->in.v_stop[i];
        if (i != forced && in_onset(run, i)) continue;
        end_onset(run, i);
        if (i == forced || fabs(v[i]) <= (run->before[i] == 0.0 ? run->in.v_drift[i] : rest)) {
            if (run->released[i] == run->out.t) continue; /* let go this very instant */
            *mode = 0.0;
            jump |= v[i] != 0.0;
        } else if (allowed(run, i, v[i])) {
            *mode = v[i] > 0.0 ? 1.0 : -1.0;
        } else {
            *mode = 0.0;
            jump = 1;
        }
    }
    return jump;
}

static double jump_from(const Run *run, long long i) {
    if (run->before[i] == 0.0) return run->in.v_drift[i];
    return fmax(1e3 * run->in.v_rest[i], run->in.v_stop[i]);
}

/* Stop what rests. */
static void stop(Run *run) {
    evaluate(run, run->in.project, run->out.t, run->out.x, run->column);
    carry(run, run->in.project_along, 0);
    memcpy(run->out.x, run->column, run->in.n_x * sizeof(double));
    for (long long r = 0; r < run->in.n_rows; r++)
        if (run->modes[run->in.row_contact[r]] == 0.0 && run->in.row_state[r] >= 0)
            run->out.x[run->in.row_state[r]] = 0.0;
}

/* Let contacts in the plane rest that others have stopped: they have no direction left. Tells
   whether there was one. */
static int take_along(Run *run) {
    int any = 0;
    evaluate(run, run->in.probe, run->out.t, run->out.x, run->probe);
    for (long long i = 0; i < run->in.n_contacts; i++)
        if (run->modes[i] != 0.0 && run->in.planar[i] >= 0 && !in_onset(run, i)
            && fabs(run->probe[i]) <= run->in.v_stop[i])
            any = 1, run->modes[i] = run->scan[i] = 0.0;
    evaluate(run, run->in.probe, run->out.t, run->out.x, run->probe);
    return any;
}

/* Stop what is held, and moves as after a jump, by impulses on nothing else. */
static void hold(Run *run) {
    const long long n = run->in.n_contacts;
    int any = 0;
    for (long long i = 0; i < n; i++) {
        run->struck[i] = run->in.directions[i] == 0 && fabs(run->probe[i]) > jump_from(run, i);
        any |= run->struck[i] != 0.0;
    }
    if (!any) return;
    memset(run->modes, 0, run->in.n_s * sizeof(double));
    for (long long i = 0; i < n; i++) run->modes[i] = run->in.directions[i] != 0;
    stop(run);
    memcpy(run->modes, run->before, run->in.n_s * sizeof(double));
    evaluate(run, run->in.probe, run->out.t, run->out.x, run->probe);
}

/* Whether the velocity of a contact that rests now was more than rounding. */
static int jumps(const Run *run, long long i, long long forced) {
    return i != forced && fabs(run->scan[i]) > jump_from(run, i);
}

/* Whether an impulse is needed; of contacts that act on each other it would not be determined by
   their velocities alone. */
static int must_jump(const Run *run, long long forced) {
    for (long long i = 0; i < run->in.n_contacts; i++)
        if (run->modes[i] == 0.0 && jumps(run, i, forced)) return 1;
    return 0;
}

double way_out(const Run *run, long long i) {
    const long long n = run->in.n_contacts;
    double force = run->probe[2 * n + i], least = run->probe[3 * n + i];
    return force - least < run->probe[4 * n + i] - force ? 1.0 : -1.0;
}

double force_scale(const Run *run, long long i) { return run->in.f_rest[i] / F_REST; }

/* Share of what holds a resting contact that is not needed. */
double share_left(const Run *run, long long i) {
    return margin(run->probe, run->in.n_contacts, i) / force_scale(run, i);
}

static double excess(const Run *run, long long i) {
    return -margin(run->probe, run->in.n_contacts, i) / fmax(run->in.f_rest[i], 1e-300);
}

/* Let go of resting contacts whose force is out of bounds, the worst one first where they act on
   each other. Tells whether there was one. */
static int let_go(Run *run) {
    const long long n = run->in.n_contacts;
    long long worst = -1;
    for (long long i = 0; i < n; i++)
        if (run->modes[i] == 0.0 && excess(run, i) > (worst < 0 ? 1.0 : excess(run, worst))) worst = i;
    if (worst < 0) return 0;
    if (!(run->probe[5 * n] > 1e-10)) run->out.status = NO_CONTACT_MODE; /* who goes is open */
    if (run->out.status == NO_CONTACT_MODE) return 1;
    look_where(run);
    for (long long i = 0; i < n; i++) {
        if (run->modes[i] != 0.0 || (run->in.coupled ? i != worst : !(excess(run, i) > 1.0))) continue;
        if (!allowed(run, i, way_out(run, i))) run->out.status = NO_CONTACT_MODE;
        if (run->in.k && -share_left(run, i) <= run->in.small_value)
            doubt(run, run->out.t, i, way_out(run, i), EDGE);
        run->modes[i] = way_out(run, i);
        begin_onset(run, i);
    }
    for (long long i = 0; i < n; i++) /* the probe is still that before; what moves had no excess */
        if (run->in.coupled ? i == worst : excess(run, i) > 1.0) turn_onset(run, i);
    return 1;
}

/* Catch again what was let go but would move against its mode; only where contacts act on each
   other can that be. */
static int catch_again(Run *run) {
    const long long n = run->in.n_contacts;
    for (long long i = 0; i < n; i++) {
        int moves = fabs(run->probe[i]) > run->in.v_stop[i];
        if (moves || run->modes[i] == 0.0 || run->released[i] == run->out.t) continue;
        double pull = run->modes[i] * run->probe[n + i];
        if (pull < -1e-9 * (1.0 + fabs(run->probe[n + i]))) {
            run->modes[i] = 0.0;
            end_onset(run, i);
            return 1;
        }
    }
    return 0;
}

static void record_change(Run *run, long long i, long long forced, int jumped) {
    double before = run->before[i], now = run->modes[i];
    if (before == now && i != forced && !jumped) return;
    Kind kind = before == 0.0 ? RELEASE : now == 0.0 ? STICK : REVERSAL;
    if (jumped) kind = IMPACT;
    double *row = grow(&run->out.events);
    if (!row) {
        run->out.status = NO_MEMORY;
        return;
    }
    row[0] = run->out.t, row[1] = i, row[2] = kind, row[3] = now;
    memcpy(row + 4, run->event_along, run->in.k * sizeof(double));
}

/* Decide which contacts rest, from velocities and then from forces. `forced` is the contact of an
   event, or -1: moving, it is at rest now; resting, it is let go. */
void decide_modes(Run *run, long long forced, int record) {
    const long long n = run->in.n_contacts;
    if (!run->in.exact || n == 0) return;
    int ended = 0;
    memcpy(run->before, run->modes, run->in.n_s * sizeof(double));
    evaluate(run, run->in.probe, run->out.t, run->out.x, run->probe);
    if (forced >= 0 && in_onset(run, forced)
        && run->probe[forced] > 0.5 * run->in.reach[n + forced]) {
        end_onset(run, forced); /* fast enough for a direction of its own */
        memcpy(run->before, run->modes, run->in.n_s * sizeof(double));
        forced = -1;
        ended = 1;
    }
    hold(run);
    memcpy(run->scan, run->probe, n * sizeof(double)); /* velocities before a jump */
    double toward = forced >= 0 ? way_out(run, forced) : 0.0;
    const int jump = modes_by_velocity(run, forced, run->scan);
    if (run->in.k) suspect(run, forced);
    if (jump) {
        if (run->in.coupled && must_jump(run, forced)) run->out.status = NO_CONTACT_MODE;
        do stop(run);
        while (run->in.coupled && run->in.aims && take_along(run));
    }
    memcpy(run->scan + n, run->modes, n * sizeof(double)); /* modes before anything is let go */
    if (forced >= 0 && run->before[forced] == 0.0) { /* what it had of drift has been stopped */
        if (!(run->probe[5 * n] > 1e-10)) run->out.status = NO_CONTACT_MODE;
        look_where(run);
        run->modes[forced] = toward;
        begin_onset(run, forced);
        turn_onset(run, forced);
        run->released[forced] = run->out.t;
    }
    long long trials = 0;
    for (int again = 1; again; trials++) {
        if (trials > 8 + 8 * n) {
            run->out.status = NO_CONTACT_MODE;
            return;
        }
        evaluate(run, run->in.probe, run->out.t, run->out.x, run->probe);
        /* contacts that share a freedom leave forces open */
        if (!run->in.shares && !(run->probe[5 * n] > 1e-10)) run->out.status = NO_CONTACT_MODE;
        if (run->out.status == NO_CONTACT_MODE) return;
        again = let_go(run);
        if (!again && run->in.coupled) again = catch_again(run);
    }
    if (run->in.k) doubt_decision(run, forced, !record);
    for (long long i = 0, any = 0; run->in.k && i < n && !any; i++) /* what rests has no velocity */
        if ((any = run->modes[i] == 0.0)) carry(run, run->in.project_along, 0);
    if (run->in.coupled) sweep_onsets(run);
    if (run->in.aims) follow_onsets(run);
    int changed = !record || ended
                  || memcmp(run->before + n, run->modes + n, (run->in.n_s - n) * sizeof(double));
    for (long long i = 0; i < n; i++) {
        int jumped = run->struck[i] || (jumps(run, i, forced) && run->scan[n + i] == 0.0);
        if (record) record_change(run, i, forced, jumped);
        if (run->before[i] != run->modes[i]) changed = 1;
        if (run->before[i] != run->modes[i] || i == forced || run->scan[n + i] == 0.0)
            run->level[i] = -small(run, i);
    }
    double *row = changed ? grow(&run->out.modes) : NULL;
    if (row) row[0] = run->out.t, memcpy(row + 1, run->modes, run->in.n_s * sizeof(double));
}

/* A switch that has fired may do so again at once if its guard falls now, be it from a rounding
   error above 0: a ball that bounces lower and lower must not fall through the floor. */
static void note_fired(Run *run, long long which, double residual) {
    event_values(run, run->out.t, run->out.x, run->value);
    double rate = run->guard[run->in.n_switches + which - n_exact(run)];
    int near = run->value[which] >= -residual; /* left clearly above 0, it must come from below */
    run->level[which] = rate < 0.0 && near ? 2.0 * fmin(run->value[which], 0.0) - 1e-300 : -INFINITY;
}

void apply_event(Run *run, long long which, int jumped) {
    const long long k = which - n_exact(run);
    if (k < 0) {
        decide_modes(run, which, 1);
        return;
    }
    double residual = 0.0; /* how far above 0 the guard may be by rounding */
    if (!jumped) {
        event_values(run, run->out.t, run->out.x, run->value);
        double rate = run->guard[run->in.n_switches + k];
        residual = 2.0 * fabs(run->value[which]) + fabs(rate) * floor_of_step(run);
    }
    evaluate(run, run->in.resets, run->out.t, run->out.x, run->reset);
    carry(run, run->in.resets_along, k * run->in.n_x);
    memcpy(run->out.x, run->reset + k * run->in.n_x, run->in.n_x * sizeof(double));
    double *row = grow(&run->out.events);
    if (!row) {
        run->out.status = NO_MEMORY;
        return;
    }
    row[0] = run->out.t, row[1] = run->in.n_contacts + k, row[2] = SWITCH, row[3] = 0.0;
    memcpy(row + 4, run->event_along, run->in.k * sizeof(double));
    decide_modes(run, -1, 1);
    note_fired(run, which, residual);
    if (run->in.terminal[k] && run->out.status == RUNNING) run->out.status = DONE;
}

/* After a jump of state or schedule, fire switches whose guards have jumped above 0. */
void fire_jumped_switches(Run *run) {
    const long long n = n_exact(run);
    for (long long trial = 0; trial <= 10 * run->in.n_switches; trial++) {
        long long fired = -1;
        if (run->in.n_switches == 0) return;
        event_values(run, run->out.t, run->out.x, run->value);
        if (run->in.k) doubt_landings(run);
        for (long long j = n; j < n_functions(run) && fired < 0; j++)
            if (run->value[j] < run->level[j]) fired = j;
        if (fired < 0) {
            set_levels(run, 0);
            return;
        }
        apply_event(run, fired, 1);
        if (run->out.status != RUNNING) return;
    }
    run->out.status = EVENTS_ACCUMULATE;
}
