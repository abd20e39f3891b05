/* Several runs of one system side by side: stages of their steps are computed together, one run in
   each lane of a vector. Each run keeps its own step length, error, breaks, samples and events. */
#include <stdint.h>

#include "lanes.h"
#include "run.h"
#include "stages.h"

typedef struct {
    Run **runs;
    long long count; /* lanes in use; the others repeat the first */
    LaneFunction rhs;
    vec t, h;
    vec *k[N_STAGES + 1], *x, *end, *stage, *p, *s;
    double changed[LANES]; /* per lane the break up to which p is valid */
    void *memory;
} Lanes;

static int make_room(Lanes *lanes) {
    const Problem *in = &lanes->runs[0]->in;
    const long long n = in->n_x, rows = (N_STAGES + 4) * n + in->n_p + in->n_s;
    lanes->memory = calloc((size_t)rows + 1, sizeof(vec));
    if (!lanes->memory) return 0;
    vec *next = (vec *)(((uintptr_t)lanes->memory + sizeof(vec) - 1) / sizeof(vec) * sizeof(vec));
    for (int i = 0; i <= N_STAGES; i++) lanes->k[i] = next, next += n;
    lanes->x = next, lanes->end = next + n, lanes->stage = next + 2 * n;
    lanes->p = next + 3 * n, lanes->s = lanes->p + in->n_p;
    return 1;
}

static void put(vec *to, int lane, const double *from, long long count) {
    double *numbers = (double *)to + lane;
    for (long long m = 0; m < count; m++) numbers[LANES * m] = from[m];
}

static void take(double *to, const vec *from, int lane, long long count) {
    const double *numbers = (const double *)from + lane;
    for (long long m = 0; m < count; m++) to[m] = numbers[LANES * m];
}

/* Copy the present state of a run to its lane. */
static void load(Lanes *lanes, int lane) {
    const Run *run = lanes->runs[lane < lanes->count ? lane : 0];
    lanes->t[lane] = run->out.t;
    put(lanes->x, lane, run->out.x, run->in.n_x);
    put(lanes->k[0], lane, run->k[0], run->in.n_x);
    put(lanes->s, lane, run->modes, run->in.n_s);
    if (lanes->changed[lane] == run->t_break) return;
    lanes->changed[lane] = run->t_break;
    put(lanes->p, lane, run->out.p, run->in.n_p);
}

static void all_stages(Lanes *lanes) {
    const long long n = lanes->runs[0]->in.n_x;
    const vec h = lanes->h, *x = lanes->x;
    vec **k = lanes->k, *y = lanes->stage, *end = lanes->end;
#define STAGE(i, sum)                                                   \
    for (long long m = 0; m < n; m++) y[m] = x[m] + h * (sum);          \
    vec t##i = lanes->t + C[i] * h;                                     \
    lanes->rhs(&t##i, y, lanes->p, lanes->s, k[i])
    STAGES;
#undef STAGE
    for (long long m = 0; m < n; m++) end[m] = x[m] + h * STEP_SUM(B);
    const vec t = lanes->t + h;
    lanes->rhs(&t, end, lanes->p, lanes->s, k[N_STAGES]);
}

/* As `step_error`. */
static vec all_errors(Lanes *lanes) {
    const Problem *in = &lanes->runs[0]->in;
    const vec *x = lanes->x, *end = lanes->end;
    vec **k = lanes->k, six = {}, five = {}, three = {};
    for (long long m = 0; m < in->n_x; m++) {
        const vec size = lane_max(lane_abs(x[m]), lane_abs(end[m]));
        const vec scale = 1.0 / (in->absolute[m] + in->relative * size);
        const vec e6 = STEP_SUM(E6) * scale;
        const vec e5 = STEP_SUM(E5) * scale, e3 = STEP_SUM(E3) * scale;
        six += e6 * e6;
        five += e5 * e5;
        three += e3 * e3;
    }
    five = lane_max(five, six);
    const vec scale = five + 0.01 * three;
    const vec error = lane_abs(lanes->h) * five / lane_sqrt((double)in->n_x * scale);
    const vec known = PICK(scale > 0.0, error, (vec){});
    return PICK(scale < INFINITY, known, (vec){} + NAN);
}

/* Copy the stages of its step to a run, see `fetch_stages`. */
static void take_from_lane(Run *run) {
    const Lanes *lanes = run->lanes;
    for (int i = 1; i < N_STAGES; i++) take(run->k[i], lanes->k[i], run->lane, run->in.n_x);
    take(run->stage, lanes->stage, run->lane, run->in.n_x);
}

static void finish(Lanes *lanes, int lane, double error) {
    Run *run = lanes->runs[lane];
    run->lane = lane, run->fetched = 0;
    run->out.n_evaluations += N_STAGES - 1 + (error <= 1.0);
    take(run->x_new, lanes->end, lane, run->in.n_x);
    take(run->k[N_STAGES], lanes->k[N_STAGES], lane, run->in.n_x);
    run->lanes = lanes, run->take_stages = take_from_lane;
    judge(run, lanes->h[lane], error);
    run->lanes = NULL;
    load(lanes, lane);
}

/* Whether all runs continue; if so, the lengths of their next steps. */
static int all_go_on(Lanes *lanes) {
    int good = 1;
    for (int l = 0; l < lanes->count; l++) {
        Run *run = lanes->runs[l];
        if (goes_on(run)) lanes->h[l] = next_length(run);
        good &= run->out.status == RUNNING;
    }
    return good;
}

/* Advance up to LANES runs by at most this many steps each, or until one of them ends. The runs
   differ in numbers only and have no directions. */
EXPORT long long wormopt_advance_lanes(Run **runs, long long count, LaneFunction rhs,
                                       long long steps) {
    Lanes lanes = {.runs = runs, .count = count, .rhs = rhs};
    if (!make_room(&lanes)) return NO_MEMORY;
    for (int l = 0; l < LANES; l++) lanes.changed[l] = -INFINITY, load(&lanes, l);
    while (all_go_on(&lanes) && steps-- > 0) {
        all_stages(&lanes);
        const vec errors = all_errors(&lanes);
        for (int l = 0; l < count; l++) finish(&lanes, l, errors[l]);
    }
    for (int l = 0; l < count; l++) emit_end(runs[l]), runs[l]->out.h = runs[l]->h_next;
    free(lanes.memory);
    return RUNNING;
}
