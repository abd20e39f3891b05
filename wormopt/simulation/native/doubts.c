/* Where the derivatives of a motion do not exist or are one-sided; see simulation/saltation.py. */
#include "run.h"

static const double AT_ONCE = 1e-10;  /* of the whole time */
static const double ALIKE = 1e-6;     /* relative; smaller differences do not count */

void doubt(Run *run, double t, long long which, double mode, Reason reason) {
    double *row = grow(run, &run->out.doubts);
    if (!row) return;
    if (!run->in.exact) which += run->in.n_contacts; /* only switches have events */
    row[0] = t, row[1] = which, row[2] = mode, row[3] = reason;
}

static double largest(const double *values, long long count) {
    double found = 0.0;
    for (long long c = 0; c < count; c++) found = fmax(found, fabs(values[c]));
    return found;
}

/* Doubt an event with known derivatives of its time, by the rate of its function. */
void doubt_event(Run *run, long long which, Rate rate) {
    const long long k = run->in.k, contacts = n_exact(run);
    const double mode = which < contacts ? run->modes[which] : 0.0, t = run->out.t;
    if (run->grazing || fabs(rate.value) <= run->in.small_rate * rate.parts) doubt(run, t, which, mode, GRAZING);
    /* stops of contacts that do not act on each other commute */
    const int stop = mode != 0.0 && !run->in.coupled;
    double apart = 0.0;
    for (long long c = 0; c < k; c++)
        apart = fmax(apart, fabs(run->event_along[c] - run->last_along[c]));
    const double size = fmax(largest(run->event_along, k), largest(run->last_along, k));
    if (t - run->last_time <= AT_ONCE * (run->in.t_end - run->in.t_start) && which != run->last
        && apart > ALIKE * size && !(stop && run->last_stop))
        doubt(run, t, which, mode, SIMULTANEOUS);
    run->last = which, run->last_time = t, run->last_stop = stop;
    memcpy(run->last_along, run->event_along, k * sizeof(double));
}

/* Doubt stops of contacts other than that of an event, if their velocities would change. */
void suspect(Run *run, long long forced) {
    const long long n = run->in.n_contacts, k = run->in.k;
    int any = 0;
    for (long long i = 0; i < n; i++) {
        run->suspect[i] = 0.0;
        any |= i != forced && run->before[i] != 0.0 && run->modes[i] == 0.0;
    }
    for (long long c = 0; c < k && any; c++) {
        const double size = change_along(run, run->in.contacts_along, c);
        for (long long i = 0; i < n; i++) {
            const int stops = i != forced && run->before[i] != 0.0 && run->modes[i] == 0.0;
            if (stops && fabs(run->change[i]) > ALIKE * size * run->in.nominal_speed[i])
                run->suspect[i] = 1.0;
        }
    }
}

/* Whether a resting contact would slide on if it moved in the direction of its force: its holding
   force exceeds its sliding force. Beyond velocities and modes, `scan` is free. */
static int slides_on(Run *run, long long i) {
    const long long n = run->in.n_contacts;
    double *probe = run->scan + 2 * n;
    run->modes[i] = way_out(run, i);
    evaluate(run, run->in.probe, run->out.t, run->out.x, probe);
    const int slides = run->modes[i] * probe[n + i] > 0.0;
    run->modes[i] = 0.0;
    return slides;
}

/* Doubt a decision; the probe is that of the decided modes. Nothing precedes the start. */
void doubt_decision(Run *run, long long forced, int at_start) {
    const long long n = run->in.n_contacts;
    const int stop = forced >= 0 && run->before[forced] != 0.0 && !run->in.coupled;
    for (long long i = 0; i < n; i++) {
        const double mode = run->modes[i], share = share_left(run, i);
        if (mode == 0.0 && share <= run->in.small_value) doubt(run, run->out.t, i, mode, EDGE);
        if (run->suspect[i] == 0.0) continue;
        if (at_start ? mode != 0.0 || slides_on(run, i) : mode != 0.0 || !stop)
            doubt(run, run->out.t, i, mode, at_start ? EDGE : SIMULTANEOUS);
    }
}

/* Size of event function j, to which small values are compared. */
double function_size(const Run *run, long long j, double range) {
    if (j >= n_exact(run)) return range;
    return run->modes[j] != 0.0 ? run->in.nominal_speed[j] : force_scale(run, j);
}

/* Doubt the lowest value of event function j without an event, against its range there. */
void note_touch(Run *run, long long j, double at, double value, double range) {
    const double size = function_size(run, j, range);
    if (value <= run->in.small_value * size && run->touch[j] > at) run->touch[j] = at;
}

/* Doubt near events before `first` in the step of length h. */
void doubt_touches(Run *run, double h, double first) {
    const long long n = n_exact(run);
    for (long long j = 0; j < n_functions(run); j++)
        if (run->touch[j] < first)
            doubt(run, run->out.t + run->touch[j] * h, j, j < n ? run->modes[j] : 0.0, GRAZING);
}

static int is_doubted(const Run *run, long long which, Reason reason) {
    const Table *known = &run->out.doubts;
    for (long long r = known->rows - 1; r >= 0; r--) {
        const double *row = known->data + known->width * r;
        if (row[0] != run->out.t) return 0;
        if (row[1] == which + (run->in.exact ? 0 : run->in.n_contacts) && row[3] == reason) return 1;
    }
    return 0;
}

/* Doubt moving guards that are near 0 after a jump: small changes decide whether their switches
   fire. Guards that reach 0 along with that of the event do not move. Values are known. */
void doubt_landings(Run *run) {
    const long long n = n_functions(run) - run->in.n_switches;
    double *parts = run->reset;
    evaluate(run, run->in.guard_parts, run->out.t, run->out.x, parts);
    for (long long c = 0; c < run->in.k; c++) {
        change_along(run, run->in.guards_along, c);
        for (long long j = 0; j < run->in.n_switches; j++) {
            const double change = fabs(run->change[j]), value = fabs(run->value[n + j]);
            if (run->level[n + j] == 0.0 && change > ALIKE * parts[j] * fabs(run->event_along[c])
                && value * run->in.column_size[c] <= run->in.small_value * change
                && !is_doubted(run, n + j, EDGE))
                doubt(run, run->out.t, n + j, 0.0, EDGE);
        }
    }
}
