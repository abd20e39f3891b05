/* The contact automaton: decides which contacts slide and which rest, and fires switches. */
#include "run.h"

static const double OPEN = 1e-10;   /* least determinant that determines forces, see contacts.py */
static const double HELD = 1e-2;    /* share of the holding force at rest, above errors of events */

static int allowed(const Run *run, long long i, double direction) {
    return (run->in.directions[i] & (signbit(direction) ? 2 : 1)) != 0;
}

/* Mode of a contact of prescribed velocity; at velocity 0 its acceleration decides. */
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

/* Modes from velocities alone; a contact without velocity rests. */
static void modes_by_velocity(Run *run, long long forced, const double *v) {
    for (long long i = 0; i < run->in.n_contacts; i++) {
        const double slow = run->before[i] == 0.0 ? run->in.v_drift[i] : run->in.v_stop[i];
        const double sign = copysign(1.0, v[i]);
        if (i != forced && in_onset(run, i)) continue;
        if (is_prescribed(run, i))
            go_as_prescribed(run, i, forced, v[i]);
        else if (i != forced && fabs(v[i]) > slow)
            run->modes[i] = allowed(run, i, sign) ? sign : 0.0;
        else if (run->released[i] != run->out.t) /* unless released at this instant */
            rest(run, i);
    }
}

/* Velocity above which a stop needs an impulse. */
static double jump_from(const Run *run, long long i) {
    if (run->before[i] == 0.0) return run->in.v_drift[i];
    return fmax(1e3 * run->in.v_rest[i], run->in.v_stop[i]);
}

/* Set the velocities of resting contacts to 0. */
static void stop(Run *run) {
    evaluate(run, run->in.project, run->out.t, run->out.x, run->column);
    memcpy(run->out.x, run->column, run->in.n_x * sizeof(double));
}

/* Let planar contacts rest that others have stopped: their slip direction is undefined. */
static void take_along(Run *run) {
    evaluate(run, run->in.probe, run->out.t, run->out.x, run->probe);
    for (long long i = 0; i < run->in.n_contacts; i++)
        if (run->modes[i] != 0.0 && run->in.planar[i] >= 0 && !in_onset(run, i)
            && run->probe[i] <= run->in.v_stop[i])
            run->modes[i] = 0.0;
}

/* Stop resting contacts that still move after a jump, by impulses on these contacts only. */
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

/* Note contacts that rest now and whose velocity was above rounding. Returns whether any was. */
static int strike(Run *run, long long forced) {
    int any = 0;
    for (long long i = 0; i < run->in.n_contacts; i++)
        if (run->modes[i] == 0.0 && i != forced && fabs(run->scan[i]) > jump_from(run, i))
            run->struck[i] = any = 1;
    return any;
}

/* Force that a resting contact lacks, in units of rounding. */
static double excess(const Run *run, long long i) {
    if (run->modes[i] != 0.0) return -INFINITY;
    return -margin(run->probe, run->in.n_contacts, i) / run->in.f_rest[i];
}

/* Whether resting contacts share a degree of freedom, so that their forces are undetermined. */
static int is_open(const Run *run) { return !(run->probe[5 * run->in.n_contacts] > OPEN); }

/* Whether a resting contact that is to be released holds after all, see contacts.py. */
static int is_held(const Run *run, long long i) {
    return run->modes[i] == 0.0 && run->in.coupled && !is_open(run) && share_left(run, i) > HELD;
}

/* Largest acceleration of all contacts, each in units of its drift, which is proportional to its
   nominal speed. */
static double largest_acceleration(const Run *run) {
    const long long n = run->in.n_contacts;
    double most = 0.0;
    for (long long i = 0; i < n; i++)
        most = fmax(most, fabs(run->probe[n + i]) / run->in.v_drift[i]);
    return most;
}

/* Among the contacts that `part` lets slide, the one that moves most against its mode; -1: none.
   A contact that an event released stays released. */
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

/* Find how contacts part from their motion at time t; 0 if undetermined. */
static int parts(Run *run, double t, long long gone, double way) {
    const long long n = run->in.n_contacts;
    const double *rested = run->scan + n; /* modes from velocities */
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
        if (ahead > -rounding) return 0; /* the contact hardly parts from the others */
        run->modes[worst] = 0.0;
    }
    return 0;
}

/* Let contacts slide that cannot rest together, such as one on the ground and one on a belt. All
   slide forward at first; then the one that moves most against its mode is stopped, and released
   the other way if its force does not hold it. `gone` was released by an event. See contacts.py. */
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

/* Before stopping anything, release geared contacts that their force cannot hold: stopping them
   without an acting force would stop everything that moves. */
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

/* Release a contact in the direction of its force, after `look_where`. */
static void release(Run *run, long long i) {
    run->modes[i] = way_out(run, i);
    if (!allowed(run, i, run->modes[i])) run->out.status = NO_CONTACT_MODE;
    begin_onset(run, i);
}

/* Release resting contacts whose force is out of bounds, the worst one first if contacts act on
   each other. Returns whether there was any. */
static int let_go(Run *run) {
    const long long n = run->in.n_contacts;
    long long worst = -1;
    for (long long i = 0; i < n; i++)
        if (excess(run, i) > (worst < 0 ? 1.0 : excess(run, worst))) worst = i;
    if (worst < 0) return 0;
    if (is_open(run)) run->out.status = NO_CONTACT_MODE; /* undetermined which one */
    look_where(run);
    for (long long i = 0; i < n; i++) {
        if (run->in.coupled ? i != worst : !(excess(run, i) > 1.0)) continue;
        if (run->in.k && -share_left(run, i) <= run->in.small_value)
            doubt(run, run->out.t, i, way_out(run, i), EDGE);
        release(run, i);
    }
    return 1;
}

/* Stop again released contacts that would move against their mode by more than rounding. This
   happens only where contacts act on each other. */
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

/* Alternate releases and stops until neither is needed. */
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
    if (again || !fit) run->out.status = NO_CONTACT_MODE; /* steps in Python may find the mode */
}

/* Decide which contacts rest, from velocities and then from forces. `forced` is the contact of an
   event, or -1: a moving contact rests from now on, a resting one is released. */
void decide_modes(Run *run, long long forced, int record) {
    const long long n = run->in.n_contacts;
    if (!run->in.exact || n == 0) return;
    memcpy(run->before, run->modes, run->in.n_s * sizeof(double));
    evaluate(run, run->in.probe, run->out.t, run->out.x, run->probe);
    if (forced >= 0 && in_onset(run, forced) && run->probe[forced] > run->in.v_stop[forced]) {
        end_onset(run, forced); /* fast enough to define its own direction */
        forced = -1;
    }
    if (forced >= 0 && is_held(run, forced)) forced = -1;
    hold(run);
    memcpy(run->scan, run->probe, n * sizeof(double)); /* velocities before a jump */
    modes_by_velocity(run, forced, run->scan);
    if (run->in.k) suspect(run, forced);
    if (strike(run, forced)) {
        /* where contacts act on each other, velocities alone do not determine the impulse */
        if (run->in.coupled) run->out.status = NO_CONTACT_MODE;
        carry(run, run->in.project_along, 0);
    }
    memcpy(run->scan + n, run->modes, n * sizeof(double)); /* modes before any release */
    part(run, forced >= 0 && run->before[forced] == 0.0 ? forced : -1);
    if (run->out.status == NO_CONTACT_MODE) return;
    slide_through(run);
    stop(run);
    if (run->in.shares) {
        take_along(run), stop(run);
        for (long long i = 0; i < n; i++) run->scan[n + i] *= run->modes[i] != 0.0;
    }
    if (forced >= 0 && run->before[forced] == 0.0) { /* its remaining drift is removed */
        if (is_open(run)) run->out.status = NO_CONTACT_MODE;
        look_where(run);
        release(run, forced);
        run->released[forced] = run->out.t;
    }
    settle(run);
    if (run->out.status == NO_CONTACT_MODE) return;
    if (run->in.k) doubt_decision(run, forced, !record);
    carry(run, run->in.project_along, 0); /* resting contacts have no velocity */
    if (run->in.aims) follow_onsets(run);
    for (long long i = 0; i < n; i++) {
        if (record) note_change(run, i, forced);
        if (run->scan[n + i] != 0.0 && !is_prescribed(run, i)) continue;
        run->level[i] = fmin(-small(run, i), 2.0 * run->modes[i] * run->probe[i]);
    }
    if (!record || memcmp(run->before, run->modes, run->in.n_s * sizeof(double))) note_modes(run);
}

/* Arm a switch that has fired. It may fire again at once if its guard falls now, even from a
   rounding error above 0: a ball that bounces lower and lower must not fall through the floor.
   Otherwise it may fire once its guard was below 0 by more than that error. `rate` is the rate of
   the guard when it fired. */
static void note_fired(Run *run, long long which, double residual, double rate, int jumped) {
    event_values(run, run->out.t, run->out.x, run->value);
    const double value = run->value[which];
    const long long k = which - n_exact(run);
    const int falls = run->guard[run->in.n_switches + k] < -1e-9 * rate;
    const int near = value >= -residual; /* otherwise it must come from below */
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

/* Reset the state as switch k does, and record the event. */
static void fire(Run *run, long long k) {
    carry(run, run->in.resets_along, k * run->in.n_x);
    reset_state(run, k);
    note_event(run, run->in.n_contacts + k, SWITCH, 0.0);
}

/* Predicates after event_values. is_at: a crossed switch is at its guard; has_jumped: its guard has
   jumped above 0; returns: the motion leads back to the guard, or is beyond it. */
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

/* Like `returns`, or the motion stays at the guard. */
static int lingers(const Run *run, long long k) {
    const double rate = run->guard[run->in.n_switches + k];
    return has_jumped(run, k) || (is_at(run, k) && rate > -1e-9 * run->approach[k]);
}

/* First switch that satisfies the predicate; -1: none. */
static long long first_of(Run *run, int (*is)(const Run *, long long)) {
    event_values(run, run->out.t, run->out.x, run->value);
    for (long long k = 0; k < run->in.n_switches; k++)
        if (is(run, k)) return k;
    return -1;
}

/* Fire the switches of a choice, and those whose guards then jump; returns how many these are. */
static long long choose(Run *run, const long long *at, int choice, void (*how)(Run *, long long)) {
    long long n = 0, k;
    for (int bit = 0; choice >> bit; bit++)
        if (choice >> bit & 1) how(run, at[bit]);
    while (n < run->in.n_switches && (k = first_of(run, has_jumped)) >= 0)
        run->jumps[n++] = (double)k, how(run, k);
    return n;
}

static int count_bits(int bits) { return bits ? (bits & 1) + count_bits(bits >> 1) : 0; }

/* Fire all switches that must fire together with the crossed switch k. If several guards are 0 or
   jump at once, take the first choice of switches after which the motion leaves all their guards.
   It slides if no choice does so and the motion leads back to the guard of switch k. `residual` and
   `rate`: accuracy of the event; `approach` contains the rates of all guards before it fired. */
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
    for (long long j = 0; j < n; j++) { /* switches that have not fired must not fire by rounding */
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
    double residual = 0.0, rate = 0.0; /* rounding error of the guard */
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
