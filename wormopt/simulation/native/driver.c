/* One simulation from start to end: steps, breaks of schedules, events, samples. */
#include "run.h"

/* -- schedules ------------------------------------------------------------------------------- */

static double break_after(const Run *run, long long i) {
    const Schedule *s = run->in.schedules + i;
    if (!s->periodic && run->piece[i] == s->pieces - 1) return INFINITY;
    return s->start + run->cycle[i] * s->breaks[s->pieces] + s->breaks[run->piece[i] + 1];
}

static void next_piece(Run *run, long long i) {
    if (++run->piece[i] == run->in.schedules[i].pieces) run->piece[i] = 0, run->cycle[i]++;
}

/* Set every scheduled parameter to its value at time t, and t_break. */
static void follow_schedules(Run *run) {
    run->t_break = INFINITY;
    for (long long i = 0; i < run->in.n_schedules; i++) {
        const Schedule *s = run->in.schedules + i;
        while (break_after(run, i) - run->out.t <= 4 * DBL_EPSILON * fabs(run->out.t))
            next_piece(run, i);
        double *p = run->out.p + s->offset;
        p[0] = s->start + run->cycle[i] * s->breaks[s->pieces] * (s->periodic != 0)
               + s->breaks[run->piece[i]];
        memcpy(p + 1, s->values + run->piece[i] * s->size, s->size * sizeof(double));
        const long long many = s->size * run->in.k;
        if (s->along)
            memcpy(run->out.p + run->in.n_p + (s->offset + 1) * run->in.k,
                   s->along + run->piece[i] * many, many * sizeof(double));
        run->t_break = fmin(run->t_break, break_after(run, i));
    }
}

static void start_schedules(Run *run) {
    for (long long i = 0; i < run->in.n_schedules; i++) {
        const Schedule *s = run->in.schedules + i;
        if (s->periodic) run->cycle[i] = (long long)floor((run->out.t - s->start) / s->breaks[s->pieces]);
    }
    follow_schedules(run);
}

/* -- samples --------------------------------------------------------------------------------- */

/* Whether the polynomial of a step with this end is needed. */
static int wants_dense(const Run *run, double end) {
    const long long next = run->out.n_sampled;
    return run->in.keep_dense || (next < run->in.n_times && run->in.times[next] < end);
}

static void fit(Run *run, double h) {
    if (!run->has_dense) fit_dense(run, h);
    run->has_dense = 1;
}

/* Keep the beginning of a step; drop every second one when the table is full. */
static void keep_start(Run *run) {
    Table *kept = &run->out.kept;
    if (run->seen++ % run->stride) return;
    double *row = grow(run, kept);
    if (!row) return;
    row[0] = run->out.t;
    memcpy(row + 1, run->out.x, run->in.n_all * sizeof(double));
    if (kept->rows < run->in.keep) return;
    kept->rows = (kept->rows + 1) / 2, run->stride *= 2;
    for (long long i = 1; i < kept->rows; i++)
        memcpy(kept->data + i * kept->width, kept->data + 2 * i * kept->width,
               kept->width * sizeof(double));
}

/* Samples within the closed step of length h; its end belongs to the next step. */
static void emit(Run *run, double h, double end) {
    const long long n = run->in.n_all;
    while (run->out.n_sampled < run->in.n_times && run->in.times[run->out.n_sampled] < end) {
        double theta = (run->in.times[run->out.n_sampled] - run->out.t) / h;
        fit(run, h);
        dense_state(run, larger(theta, 0.0), run->out.samples + n * run->out.n_sampled++, n);
    }
    if (run->in.keep) keep_start(run);
    if (!run->in.keep_dense) return;
    fit(run, h);
    double *row = grow(run, &run->out.dense);
    if (!row) return;
    row[0] = end;
    memcpy(row + 1, run->dense, N_DENSE * n * sizeof(double));
}

void emit_end(Run *run) {
    const long long n = run->in.n_all;
    while (run->out.n_sampled < run->in.n_times && run->in.times[run->out.n_sampled] <= run->out.t)
        memcpy(run->out.samples + n * run->out.n_sampled++, run->out.x, n * sizeof(double));
}

/* -- steps ----------------------------------------------------------------------------------- */

static void reject(Run *run, double h, double factor) {
    run->out.n_rejected++;
    run->h_next = h * factor;
    if (run->h_next < floor_of_step(run))
        run->out.status = run->by_columns    ? STEEP_DERIVATIVES
                          : run->bad_number ? NOT_FINITE
                                            : STEP_TOO_SMALL;
}

static void swap(double **a, double **b) {
    double *c = *a;
    *a = *b, *b = c;
}

/* Accept x_new and the time; the derivative there is k[12] if the step is closed. */
static void take_over(Run *run, double end) {
    run->out.t = end;
    swap(&run->out.x, &run->x_new);
    run->out.n_steps++;
}

/* Process all changes at one instant after schedules, state or modes have jumped. */
static void start_afresh(Run *run) {
    fire_jumped_switches(run);
    arrive(run);
    derivative(run, run->out.t, run->out.x, run->k[0]);
}

/* Whether a switch has fired and not been above 0 since. A crossed switch may have been 0 for a
   while, and its guard may have jumped. */
static int fires_in_vain(Run *run, double h, long long which) {
    const long long k = which - n_exact(run);
    if (run->in.crosses[k])
        return !run->jumped[k] && run->out.t - run->fired[k] <= floor_of_step(run);
    return run->level[which] != 0.0 || fires_by_rounding(run, h, which);
}

static void go_to_event(Run *run, double h, double theta, long long which) {
    double length = theta * h;
    run->grazing = run->in.k && grazes(run, h, theta, which);
    if (length > floor_of_step(run)) {
        length = polish_event(run, h, theta, which);
        run->has_dense = 0;
        if (wants_dense(run, run->out.t + length)) close_step(run, length);
        emit(run, length, run->out.t + length);
        take_over(run, run->out.t + length);
    }
    if (which >= n_exact(run) && fires_in_vain(run, h, which)) run->out.status = EVENTS_ACCUMULATE;
    if (run->out.t - run->crowd_start > 1e-10 * (run->in.t_end - run->in.t_start))
        run->crowd = 0, run->crowd_start = run->out.t;
    if (++run->crowd > 32 + 16 * n_functions(run)) run->out.status = EVENTS_ACCUMULATE;
    if (run->in.k) doubt_event(run, which, leave(run, which));
    if (run->out.status == RUNNING) apply_event(run, which, 0);
    if (run->out.status == RUNNING) start_afresh(run);
    run->h_next = h;
}

static void accept(Run *run, double h, double end, double error) {
    emit(run, h, end);
    double factor = error > 0.0 ? 0.9 * lengthening(error) : 6.0;
    run->h_next = larger(h * smaller(larger(factor, 1.0 / 3.0), 6.0), run->h_whole);
    int stiff = looks_stiff(run, h) && (run->in.t_end - end) / h > run->in.stiff_steps;
    take_over(run, end);
    swap(&run->k[0], &run->k[12]);
    if (stiff && run->out.status == RUNNING) run->out.status = STIFF;
    if (end < run->t_break) return;
    follow_schedules(run);
    decide_modes(run, -1, 1);
    start_afresh(run);
}

/* Length of the next step; sets the status if there is none. */
double next_length(Run *run) {
    const double stop = smaller(run->in.t_end, run->t_break), left = stop - run->out.t;
    if (run->h_next <= 0.0) run->h_next = first_step(run);
    run->h_next = smaller(run->h_next, run->in.max_step);
    int last = 1.01 * run->h_next >= left;
    double h = last ? left : run->h_next;
    if (h < floor_of_step(run) && !last) {
        run->out.status = STEP_TOO_SMALL;
    }
    run->h_whole = last && h < run->h_next ? run->h_next : 0.0;
    run->end = last ? stop : run->out.t + h;
    return h;
}

/* Accept or reject a step of known error; an accepted step is closed. */
void judge(Run *run, double h, double error) {
    run->has_dense = 0;
    run->bad_number = error != error;
    if (!(error <= 1.0)) {
        reject(run, h, run->bad_number ? 0.1 : larger(0.9 * lengthening(error), 0.1));
        return;
    }
    if ((!run->in.exact && run->in.n_contacts && dips_into_layer(run, h))
        || (run->in.bends && goes_over_bend(run, h))) {
        reject(run, h, 0.5);
        return;
    }
    if (n_functions(run) && !keep_sliding(run, h)) {
        long long which = -1;
        fit(run, h);
        double theta = find_event(run, h, &which);
        if (run->out.status != RUNNING) return;
        if (theta <= 1.0) {
            go_to_event(run, h, theta, which);
            return;
        }
    }
    accept(run, h, run->end, error);
}

static void step(Run *run) {
    const double h = next_length(run);
    if (run->out.status != RUNNING) return;
    stages(run, h);
    const double error = step_error(run, h);
    if (error <= 1.0) close_step(run, h);
    judge(run, h, error);
}

/* Whether a run has not ended. */
int goes_on(Run *run) {
    if (run->out.status != RUNNING) return 0;
    if (run->out.t >= run->in.t_end)
        run->out.status = DONE;
    else if (run->out.n_steps + run->out.n_rejected >= run->in.max_steps)
        run->out.status = TOO_MANY_STEPS;
    return run->out.status == RUNNING;
}

/* -- the interface --------------------------------------------------------------------------- */

/* Advance by at most this many steps; returns the status. */
EXPORT long long wormopt_advance(Run *run, long long steps) {
    while (steps-- > 0 && goes_on(run)) step(run);
    emit_end(run);
    run->out.h = run->h_next;
    return run->out.status;
}

/* Begin a run from x (n_all) with parameters and their directions p (n_p, then row by row; those
   that are scheduled of no matter). NULL if memory is out. The arrays of the problem must outlive
   the run, x and p need not. */
EXPORT Run *wormopt_start(const Problem *problem, const double *x, const double *p) {
    Run *run = calloc(1, sizeof(Run));
    if (!run) return NULL;
    run->in = *problem;
    if (!allocate(run)) {
        wormopt_free(run);
        return NULL;
    }
    memcpy(run->out.x, x, problem->n_all * sizeof(double));
    memcpy(run->out.p, p, problem->n_p * (1 + problem->k) * sizeof(double));
    run->out.t = problem->t_start;
    run->stride = 1;
    run->crowd_start = run->last_time = -INFINITY;
    for (long long i = 0; i < problem->n_contacts; i++) {
        run->released[i] = -INFINITY;
        run->modes[i] = 1.0; /* the velocities decide below, before anything is recorded */
    }
    for (long long k = 0; k < problem->n_switches; k++) run->fired[k] = -INFINITY;
    start_schedules(run);
    decide_modes(run, -1, 0);
    set_levels(run, 1);
    start_afresh(run);
    for (long long m = problem->n_all - 1; m >= 0; m--)
        if (!isfinite(run->out.x[m]) || !isfinite(run->k[0][m]))
            run->out.status = m < problem->n_x ? NOT_FINITE : STEEP_DERIVATIVES;
    return run;
}
