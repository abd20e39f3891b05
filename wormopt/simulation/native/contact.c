/* The contact automaton: which contacts slide and which rest, and what switches do. */
#include <math.h>
#include <string.h>

#include "run.h"

static const double F_REST = 1e-13; /* as in `InitialValueProblem.f_rest` */

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

/* Largest acceleration of all contacts, each in units of its drift, which goes with its nominal
   speed. */
static double largest_acceleration(const Run *run) {
    const long long n = run->in.n_contacts;
    double most = 0.0;
    for (long long i = 0; i < n; i++)
        most = fmax(most, fabs(run->probe[n + i]) / run->in.v_drift[i]);
    return most;
}

/* Catch again what was let go but would move against its mode, by more than rounding; only where
   contacts act on each other can that be. */
static int catch_again(Run *run) {
    const long long n = run->in.n_contacts;
    const double rounding = 1e-9 * largest_acceleration(run);
    for (long long i = 0; i < n; i++) {
        int moves = fabs(run->probe[i]) > run->in.v_stop[i];
        if (moves || run->modes[i] == 0.0 || run->released[i] == run->out.t) continue;
        if (run->modes[i] * run->probe[n + i] / run->in.v_drift[i] < -rounding) {
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
