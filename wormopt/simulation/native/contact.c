/* The contact automaton: which contacts slide and which rest, and what switches do. */
#include <math.h>
#include <string.h>

#include "run.h"

static const double F_REST = 1e-13; /* as in `InitialValueProblem.f_rest` */
static const double OPEN = 1e-10;   /* least determinant that leaves no forces open, see contacts.py */
static const double HELD = 1e-2;    /* share of what holds at rest, more than errors of an event */

static int allowed(const Run *run, long long i, double direction) {
    return (run->in.directions[i] & (signbit(direction) ? 2 : 1)) != 0;
}

/* Whether no force changes the velocity of a contact: it slides at all times. */
int is_prescribed(const Run *run, long long i) { return (run->in.directions[i] & 4) != 0; }

/* Mode of a contact of prescribed velocity; at 0 it goes on as it accelerates. */
static void go_as_prescribed(Run *run, long long i, long long forced, double v) {
    double ahead = run->probe[run->in.n_contacts + i];
    if (fabs(v) > run->in.v_stop[i]) ahead = v;
    if (i == forced) ahead = -run->modes[i];
    if (ahead != 0.0) run->modes[i] = copysign(1.0, ahead);
    if (!allowed(run, i, run->modes[i])) run->out.status = NO_CONTACT_MODE;
}

static void rest(Run *run, long long i) {
    run->modes[i] = 0.0;
    end_onset(run, i);
}

/* Modes by velocity alone; what does not move is at rest. */
static void modes_by_velocity(Run *run, long long forced, const double *v) {
    for (long long i = 0; i < run->in.n_contacts; i++) {
        const double slow = run->before[i] == 0.0 ? run->in.v_drift[i] : run->in.v_stop[i];
        const double sign = copysign(1.0, v[i]);
        if (i != forced && in_onset(run, i)) continue;
        if (is_prescribed(run, i))
            go_as_prescribed(run, i, forced, v[i]);
        else if (i != forced && fabs(v[i]) > slow)
            run->modes[i] = allowed(run, i, sign) ? sign : 0.0;
        else if (run->released[i] != run->out.t) /* else let go this very instant */
            rest(run, i);
    }
}

/* Velocity above which what stops has been stopped by an impulse. */
static double jump_from(const Run *run, long long i) {
    if (run->before[i] == 0.0) return run->in.v_drift[i];
    return fmax(1e3 * run->in.v_rest[i], run->in.v_stop[i]);
}

/* Stop what rests. */
static void stop(Run *run) {
    evaluate(run, run->in.project, run->out.t, run->out.x, run->column);
    memcpy(run->out.x, run->column, run->in.n_x * sizeof(double));
}

/* Let contacts in the plane rest that others have stopped: they have no direction left. */
static void take_along(Run *run) {
    evaluate(run, run->in.probe, run->out.t, run->out.x, run->probe);
    for (long long i = 0; i < run->in.n_contacts; i++)
        if (run->modes[i] != 0.0 && run->in.planar[i] >= 0 && !in_onset(run, i)
            && run->probe[i] <= run->in.v_stop[i])
            run->modes[i] = 0.0;
}

/* Stop what is held, and moves as after a jump, by impulses on nothing else. */
static void hold(Run *run) {
    const long long n = run->in.n_contacts;
    int hit = 0;
    for (long long i = 0; i < n; i++) {
        run->struck[i] = run->in.directions[i] == 0 && fabs(run->probe[i]) > jump_from(run, i);
        hit |= run->struck[i] != 0.0;
    }
    if (!hit) return;
    for (long long i = 0; i < n; i++) run->modes[i] = run->in.directions[i] != 0;
    carry(run, run->in.project_along, 0);
    stop(run);
    memcpy(run->modes, run->before, n * sizeof(double));
    evaluate(run, run->in.probe, run->out.t, run->out.x, run->probe);
}

/* Note what rests now though its velocity was more than rounding. Tells whether there was any. */
static int strike(Run *run, long long forced) {
    int any = 0;
    for (long long i = 0; i < run->in.n_contacts; i++)
        if (run->modes[i] == 0.0 && i != forced && fabs(run->scan[i]) > jump_from(run, i))
            run->struck[i] = any = 1;
    return any;
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

/* By how much a resting contact lacks force, in units of what is nothing but rounding. */
static double excess(const Run *run, long long i) {
    if (run->modes[i] != 0.0) return -INFINITY;
    return -margin(run->probe, run->in.n_contacts, i) / run->in.f_rest[i];
}

/* Whether resting contacts share a freedom and leave their forces open. */
static int is_open(const Run *run) { return !(run->probe[5 * run->in.n_contacts] > OPEN); }

/* Whether a contact at rest that is to be let go is held after all, see contacts.py. */
static int is_held(const Run *run, long long i) {
    return run->modes[i] == 0.0 && run->in.coupled && !is_open(run) && share_left(run, i) > HELD;
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

/* Of the contacts that `part` lets slide, that which moves most against its mode; -1: none. What
   an event lets go stays so. */
static long long most_against(const Run *run, const double *modes, long long gone) {
    const long long n = run->in.n_contacts;
    long long worst = -1;
    double least = INFINITY;
    for (long long i = 0; i < n; i++) {
        const double ahead = run->modes[i] * run->probe[n + i] / run->in.v_drift[i];
        if (modes[i] != 0.0 || run->modes[i] == 0.0 || i == gone || ahead >= least) continue;
        worst = i, least = ahead;
    }
    return worst;
}

/* Find how contacts part, as they move at time t; 0 where it remains open. */
static int parts(Run *run, double t, long long gone, double way) {
    const long long n = run->in.n_contacts;
    const double *rested = run->scan + n; /* modes as velocities have them */
    for (long long i = 0; i < n; i++)
        if (rested[i] == 0.0 && run->in.directions[i])
            run->modes[i] = i == gone ? way : allowed(run, i, 1.0) ? 1.0 : -1.0;
    for (long long trials = 2 * n + 1; trials > 0; trials--) {
        int again = 0;
        evaluate(run, run->in.probe, t, run->out.x, run->probe);
        if (is_open(run)) return 0;
        for (long long i = 0; i < n; i++) {
            if (!(rested[i] == 0.0 && run->in.directions[i] && excess(run, i) > 1.0)) continue;
            run->modes[i] = way_out(run, i), again = 1;
            if (!allowed(run, i, run->modes[i])) return 0;
        }
        if (again) continue;
        const long long worst = most_against(run, rested, gone);
        if (worst < 0) return 1;
        const double ahead = run->modes[worst] * run->probe[n + worst] / run->in.v_drift[worst];
        const double rounding = 1e-9 * largest_acceleration(run);
        if (ahead > rounding) return 1;
        if (ahead > -rounding) return 0; /* it hardly parts from the others */
        run->modes[worst] = 0.0;
    }
    return 0;
}

/* Let contacts slide that cannot rest together: one is on the ground, another on a belt. All slide
   forward at first; then the one that moves most against its mode is caught, and let go the other
   way if its force does not hold it. `gone` has been let go by an event. See contacts.py. */
static void part(Run *run, long long gone) {
    const double later[] = {0.0, 1e-7, 1e-5, 1e-3}, span = run->in.t_end - run->in.t_start;
    const double way = gone < 0 ? 0.0 : way_out(run, gone);
    if (!run->in.coupled || run->in.shares) return;
    evaluate(run, run->in.probe, run->out.t, run->out.x, run->probe);
    if (!is_open(run)) return;
    for (int i = 0; i < 4; i++)
        if (parts(run, run->out.t + later[i] * span, gone, way)) return;
    run->out.status = NO_CONTACT_MODE;
}

/* Let go, before anything is stopped, of geared contacts that their force cannot hold: what stopped
   them where none of it acts would stop all that moves. */
static void slide_through(Run *run) {
    const long long n = run->in.n_contacts;
    for (long long i = 0; i < n; i++) {
        if (!(run->in.directions[i] & 8) || run->modes[i] != 0.0 || run->struck[i] != 0.0) continue;
        evaluate(run, run->in.probe, run->out.t, run->out.x, run->probe);
        if (!(excess(run, i) > 1.0)) continue;
        run->modes[i] = way_out(run, i);
        if (!allowed(run, i, run->modes[i])) run->out.status = NO_CONTACT_MODE;
    }
}

/* Let a contact go the way it is pulled, after `look_where`. */
static void release(Run *run, long long i) {
    run->modes[i] = way_out(run, i);
    if (!allowed(run, i, run->modes[i])) run->out.status = NO_CONTACT_MODE;
    begin_onset(run, i);
}

/* Let go of resting contacts whose force is out of bounds, the worst one first where they act on
   each other. Tells whether there was one. */
static int let_go(Run *run) {
    const long long n = run->in.n_contacts;
    long long worst = -1;
    for (long long i = 0; i < n; i++)
        if (excess(run, i) > (worst < 0 ? 1.0 : excess(run, worst))) worst = i;
    if (worst < 0) return 0;
    if (is_open(run)) run->out.status = NO_CONTACT_MODE; /* who goes is open */
    look_where(run);
    for (long long i = 0; i < n; i++) {
        if (run->in.coupled ? i != worst : !(excess(run, i) > 1.0)) continue;
        if (run->in.k && -share_left(run, i) <= run->in.small_value)
            doubt(run, run->out.t, i, way_out(run, i), EDGE);
        release(run, i);
    }
    return 1;
}

/* Catch again what was let go but would move against its mode, by more than rounding; only where
   contacts act on each other can that be. */
static int catch_again(Run *run) {
    const long long n = run->in.n_contacts;
    const double rounding = 1e-9 * largest_acceleration(run);
    for (long long i = 0; i < n; i++) {
        const double ahead = run->modes[i] * run->probe[n + i] / run->in.v_drift[i];
        const int moves = fabs(run->probe[i]) > run->in.v_stop[i];
        if (moves || is_prescribed(run, i) || run->released[i] == run->out.t || !(ahead < -rounding))
            continue;
        rest(run, i);
        return 1;
    }
    return 0;
}

static void note_event(Run *run, long long which, Kind kind, double mode) {
    double *row = grow(run, &run->out.events);
    if (!row) return;
    row[0] = run->out.t, row[1] = which, row[2] = kind, row[3] = mode;
    memcpy(row + 4, run->event_along, run->in.k * sizeof(double));
}

static void note_change(Run *run, long long i, long long forced) {
    const double before = run->before[i], now = run->modes[i];
    const int struck = run->struck[i] != 0.0;
    if (before == now && i != forced && !struck) return;
    Kind kind = before == 0.0 ? RELEASE : now == 0.0 ? STICK : REVERSAL;
    note_event(run, i, struck ? IMPACT : kind, now);
}

static void note_modes(Run *run) {
    double *row = grow(run, &run->out.modes);
    if (row) row[0] = run->out.t, memcpy(row + 1, run->modes, run->in.n_s * sizeof(double));
}

/* Let go of what has to be and catch what has to be, one after the other, until nothing has. */
static void settle(Run *run) {
    int again = 1, fit = 1;
    for (long long trials = 9 + 8 * run->in.n_contacts; again && trials > 0; trials--) {
        if (run->in.coupled) fit = sweep_onsets(run);
        evaluate(run, run->in.probe, run->out.t, run->out.x, run->probe);
        if (!run->in.shares && is_open(run)) run->out.status = NO_CONTACT_MODE;
        again = let_go(run);
        if (!again && run->in.coupled) again = catch_again(run);
        if (run->out.status == NO_CONTACT_MODE) return;
    }
    if (again || !fit) run->out.status = NO_CONTACT_MODE; /* which steps in Python may find */
}

/* Decide which contacts rest, from velocities and then from forces. `forced` is the contact of an
   event, or -1: moving, it is at rest now; resting, it is let go. */
void decide_modes(Run *run, long long forced, int record) {
    const long long n = run->in.n_contacts;
    if (!run->in.exact || n == 0) return;
    memcpy(run->before, run->modes, run->in.n_s * sizeof(double));
    evaluate(run, run->in.probe, run->out.t, run->out.x, run->probe);
    if (forced >= 0 && in_onset(run, forced) && run->probe[forced] > run->in.v_stop[forced]) {
        end_onset(run, forced); /* fast enough for a direction of its own */
        forced = -1;
    }
    if (forced >= 0 && is_held(run, forced)) forced = -1;
    hold(run);
    memcpy(run->scan, run->probe, n * sizeof(double)); /* velocities before a jump */
    modes_by_velocity(run, forced, run->scan);
    if (run->in.k) suspect(run, forced);
    if (strike(run, forced)) {
        /* where contacts act on each other velocities alone would not determine the impulse */
        if (run->in.coupled) run->out.status = NO_CONTACT_MODE;
        carry(run, run->in.project_along, 0);
    }
    memcpy(run->scan + n, run->modes, n * sizeof(double)); /* modes before anything is let go */
    part(run, forced >= 0 && run->before[forced] == 0.0 ? forced : -1);
    if (run->out.status == NO_CONTACT_MODE) return;
    slide_through(run);
    stop(run);
    if (run->in.shares) {
        take_along(run), stop(run);
        for (long long i = 0; i < n; i++) run->scan[n + i] *= run->modes[i] != 0.0;
    }
    if (forced >= 0 && run->before[forced] == 0.0) { /* what it had of drift has been stopped */
        if (is_open(run)) run->out.status = NO_CONTACT_MODE;
        look_where(run);
        release(run, forced);
        run->released[forced] = run->out.t;
    }
    settle(run);
    if (run->out.status == NO_CONTACT_MODE) return;
    if (run->in.k) doubt_decision(run, forced, !record);
    carry(run, run->in.project_along, 0); /* what rests has no velocity */
    if (run->in.aims) follow_onsets(run);
    for (long long i = 0; i < n; i++) {
        if (record) note_change(run, i, forced);
        if (run->scan[n + i] != 0.0 && !is_prescribed(run, i)) continue;
        run->level[i] = fmin(-small(run, i), 2.0 * run->modes[i] * run->probe[i]);
    }
    if (!record || memcmp(run->before, run->modes, run->in.n_s * sizeof(double))) note_modes(run);
}

/* A switch that has fired may do so again at once if its guard falls now, be it from a rounding
   error above 0: a ball that bounces lower and lower must not fall through the floor. Else it does
   once its guard was below 0 by more than that error. `rate` is that of the guard as it fired. */
static void note_fired(Run *run, long long which, double residual, double rate, int jumped) {
    event_values(run, run->out.t, run->out.x, run->value);
    const double value = run->value[which];
    const long long k = which - n_exact(run);
    const int falls = run->guard[run->in.n_switches + k] < -1e-9 * rate;
    const int near = value >= -residual; /* left clearly above 0, it must come from below */
    const int again = run->in.crosses[k] || falls;
    run->level[which] = again && near ? 2.0 * fmin(value, 0.0) - 1e-300 : -INFINITY;
    run->jumped[k] = jumped && run->in.crosses[k];
    run->passed[k] = residual, run->fired[k] = run->out.t;
}

/* Reset the state as switch k does. */
static void reset_state(Run *run, long long k) {
    evaluate(run, run->in.resets, run->out.t, run->out.x, run->reset);
    memcpy(run->out.x, run->reset + k * run->in.n_x, run->in.n_x * sizeof(double));
}

/* The same, for good. */
static void fire(Run *run, long long k) {
    carry(run, run->in.resets_along, k * run->in.n_x);
    reset_state(run, k);
    note_event(run, run->in.n_contacts + k, SWITCH, 0.0);
}

/* Of the state whose event values are known: whether a switch that must be crossed is at its guard;
   whether its guard has jumped above 0; whether the motion is led back to it, or is beyond it. */
static int is_at(const Run *run, long long k) {
    return fabs(run->value[n_exact(run) + k]) <= run->near[k];
}

static int has_jumped(const Run *run, long long k) {
    const long long j = n_exact(run) + k;
    return run->near[k] >= 0.0 && run->value[j] < smaller(run->level[j], -run->near[k]);
}

static int returns(const Run *run, long long k) {
    const double rate = run->guard[run->in.n_switches + k];
    return has_jumped(run, k) || (is_at(run, k) && rate > 1e-9 * run->approach[k]);
}

/* The same, or it stays there. */
static int lingers(const Run *run, long long k) {
    const double rate = run->guard[run->in.n_switches + k];
    return has_jumped(run, k) || (is_at(run, k) && rate > -1e-9 * run->approach[k]);
}

/* First switch of which it is so; -1: none. */
static long long first_of(Run *run, int (*is)(const Run *, long long)) {
    event_values(run, run->out.t, run->out.x, run->value);
    for (long long k = 0; k < run->in.n_switches; k++)
        if (is(run, k)) return k;
    return -1;
}

/* Fire the switches of a choice, and those whose guards jump then; gives how many these are. */
static long long choose(Run *run, const long long *at, int choice, void (*how)(Run *, long long)) {
    long long n = 0, k;
    for (int bit = 0; choice >> bit; bit++)
        if (choice >> bit & 1) how(run, at[bit]);
    while (n < run->in.n_switches && (k = first_of(run, has_jumped)) >= 0)
        run->jumps[n++] = (double)k, how(run, k);
    return n;
}

static int count_bits(int bits) { return bits ? (bits & 1) + count_bits(bits >> 1) : 0; }

/* Fire all switches that must fire with switch k, which must be crossed. Where several guards are 0
   together, or jump, the first choice of these switches is taken with which the motion leaves all
   their guards. It slides if none does, and it is led back to that of switch k. `residual`, `rate`:
   how exactly k has been found; the rates of all guards before it fired are in `approach`. */
static void cross(Run *run, long long k, double residual, double rate) {
    enum { TOGETHER = 8 };
    const long long n = run->in.n_switches, m = n_exact(run), size = run->in.n_x;
    const double late = rate > 0.0 ? residual / rate : floor_of_step(run);
    long long at[TOGETHER];
    int (*const wrong[])(const Run *, long long) = {lingers, returns};
    int found = -1, together = 0;
    event_values(run, run->out.t, run->out.x, run->value);
    for (long long j = 0; j < n; j++) {
        const double change = larger(run->approach[j], fabs(run->guard[n + j]));
        run->near[j] = !run->in.crosses[j] ? -1.0 : j == k ? residual : late * change;
        if (is_at(run, j) && together < TOGETHER) at[together++] = j;
    }
    memcpy(run->origin, run->out.x, size * sizeof(double));
    for (int weak = 0; weak < 2; weak++)
        for (int count = 0; count <= together; count++)
            for (int choice = 0; choice < 1 << together && found < 0; choice++) {
                if (count_bits(choice) != count) continue;
                choose(run, at, choice, reset_state);
                if (first_of(run, wrong[weak]) < 0) found = choice;
                memcpy(run->out.x, run->origin, size * sizeof(double));
            }
    if (found < 0) {
        event_values(run, run->out.t, run->out.x, run->value);
        if (returns(run, k)) run->out.status = EVENTS_ACCUMULATE;
        return;
    }
    const long long jumped = choose(run, at, found, fire);
    if (found || jumped) decide_modes(run, -1, 1);
    for (long long i = 0; i < jumped; i++) note_fired(run, m + (long long)run->jumps[i], 0.0, 0.0, 1);
    for (long long j = 0; j < n; j++) { /* those that have not fired must not do so by rounding */
        event_values(run, run->out.t, run->out.x, run->value);
        if (is_at(run, j)) note_fired(run, m + j, run->near[j], run->approach[j], 0);
    }
}

void apply_event(Run *run, long long which, int jumped) {
    const long long k = which - n_exact(run), n = run->in.n_switches;
    if (k < 0) {
        decide_modes(run, which, 1);
        return;
    }
    double residual = 0.0, rate = 0.0; /* how far from 0 the guard may be by rounding */
    if (!jumped) {
        event_values(run, run->out.t, run->out.x, run->value);
        for (long long j = 0; j < n; j++) run->approach[j] = fabs(run->guard[n + j]);
        rate = run->approach[k];
        residual = 2.0 * fabs(run->value[which]) + rate * floor_of_step(run);
    }
    fire(run, k);
    decide_modes(run, -1, 1);
    note_fired(run, which, residual, rate, jumped);
    if (run->in.crosses[k] && !jumped && run->out.status == RUNNING) cross(run, k, residual, rate);
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
