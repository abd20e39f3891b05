/* The state of one simulation, shared by the files of the driver only. */
#ifndef WORMOPT_RUN_H
#define WORMOPT_RUN_H

/* before everything is hidden; for all files */
#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#ifndef _WIN32
#pragma GCC visibility push(hidden) /* calls within the driver need no look-up */
#endif

#include "driver.h"
#include "tableau.h"

#ifdef _WIN32
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif

enum { N_ONSET = 4 }; /* entries of s for the onset of a contact in the plane */

typedef struct Run Run;

struct Run {
    Report out; /* must stay first: callers see only this part */
    Problem in;
    double *k[N_ALL];      /* derivatives of the stages */
    double *x_new, *stage; /* end of the step; scratch, and the state of the last stage */
    double *dense;         /* 8 rows of n_all */
    double *modes, *before; /* s, now and before the last decision: +1, -1, 0 per contact, then
                               onsets */
    double *bend;          /* velocities with kinks of force, and speeds, at both ends of a step */
    double *aims, *toward; /* per contact in the plane: 3 of `aims`; direction of its force */
    double *struck;        /* whether a resting contact has just been stopped */
    double *fresh;         /* whether a contact has begun to slip at this instant */
    double *released;      /* time of the last release of a contact */
    long long *cycle, *piece; /* current piece of each schedule */
    double *probe;         /* velocities, accelerations, forces, least, largest force */
    double *guard, *reset; /* guards and their rates; states after switches */
    double *value, *level; /* per event function: value, and the level below which it is an event */
    double *passed;        /* per switch: rounding error of its guard since it fired */
    double *fired;         /* per switch: time it last fired */
    double *near, *approach; /* per switch: guards up to this are 0; their rates before an event */
    double *jumps, *origin; /* switches that jump at an event, and the state there */
    double *jumped;        /* per crossed switch: whether its guard jumped */
    double *scan;          /* values at the samples of a step, at the first event, levels */
    double *column;        /* a state in between */
    double *event_along;   /* derivatives of the time of the current event; else 0 */
    double *slope;         /* x' where an event begins or ends */
    double *slopes_x, *slopes_p; /* entries of Jacobians */
    double *nearby;        /* the same at 4 nearby points, where some entries are NaN */
    double *column_x, *column_p, *change; /* of S and of the directions; change along them */
    double *suspect;       /* whether a contact stops along with another, see doubts.c */
    double *touch;         /* per event function where it nearly reaches 0 in a step, or INFINITY */
    double *last_along, last_time; /* of the last event: derivatives of its time, its time */
    long long last;        /* its index */
    int grazing;           /* the current event hardly falls below 0 */
    int last_stop;         /* it was the stop of a contact that acts on no other */
    double *column_error;  /* size and errors of each column of S */
    long long seen, stride; /* number of steps so far; every stride-th is kept */
    double t_break;        /* next break of any schedule */
    double h_next, h_whole; /* next step; the step that a break or the end has cut */
    double end;            /* of the step under way */
    const void *lanes;     /* location of the stages of the step, see lanes.c; NULL: k */
    void (*take_stages)(Run *run); /* copies them to k and stage */
    int lane, fetched;     /* lane of the run; whether k and stage are up to date */
    long long since_check, stiff_hints, unstiff_hints;
    long long crowd; /* events since crowd_start */
    double crowd_start;
    int by_columns;        /* the error of the step is that of S */
    int bad_number;        /* the last rejection was for a NaN or infinite value */
    int has_dense;         /* the polynomial of the current step is fitted */
    const double **arg;
    double **res;
    long long *iw;
    double *w;
};

/* The functions of math.h are calls, since they handle NaN. */
static inline double smaller(double a, double b) { return a < b ? a : b; }
static inline double larger(double a, double b) { return a > b ? a : b; }

static inline void evaluate(Run *run, Function f, double t, const double *x, double *result) {
    run->arg[0] = &t;
    run->arg[1] = x;
    run->arg[2] = run->out.p;
    run->arg[3] = run->modes;
    run->res[0] = result;
    f(run->arg, run->res, run->iw, run->w, 0);
}

/* Have the stages of a step in k and stage, once more than both ends is needed. */
static inline void fetch_stages(Run *run) {
    if (!run->lanes || run->fetched) return;
    run->fetched = 1;
    run->take_stages(run);
}

static inline double floor_of_step(const Run *run) {
    return 8 * DBL_EPSILON * larger(fabs(run->out.t), 1e-3 * fabs(run->in.t_end - run->in.t_start));
}

/* Event functions of contacts in exact treatment; those of switches follow, see crossings.c. */
static inline long long n_exact(const Run *run) { return run->in.exact ? run->in.n_contacts : 0; }
static inline long long n_functions(const Run *run) { return n_exact(run) + run->in.n_switches; }

/* Whether no force changes the velocity of a contact: its slip is prescribed. */
static inline int is_prescribed(const Run *run, long long i) {
    return (run->in.directions[i] & 4) != 0;
}

/* Distance of the force on a contact at rest from the nearer bound. */
static inline double margin(const double *probe, long long n, long long i) {
    const double force = probe[2 * n + i], least = probe[3 * n + i], largest = probe[4 * n + i];
    return fmin(force - least, largest - force);
}

/* Direction of the nearer bound. */
static inline double way_out(const Run *run, long long i) {
    const long long n = run->in.n_contacts;
    const double force = run->probe[2 * n + i], least = run->probe[3 * n + i];
    return force - least < run->probe[4 * n + i] - force ? 1.0 : -1.0;
}

static inline double force_scale(const Run *run, long long i) {
    const double rounding = 1e-13; /* F_REST of initial_value.py */
    return run->in.f_rest[i] / rounding;
}

/* Unused share of the holding force of a contact at rest. */
static inline double share_left(const Run *run, long long i) {
    return margin(run->probe, run->in.n_contacts, i) / force_scale(run, i);
}

/* Every file calls those before it only. */

/* run.c */
int allocate(Run *run);
double *grow(Run *run, Table *table);
EXPORT void wormopt_free(Run *run);

/* variation.c */
typedef struct {
    double value, parts; /* of an event function; sizes of its summands */
} Rate;
double change_along(Run *run, Function f, long long c);
void vary(Run *run, double t, const double *x, double *dx);
double columns_error(Run *run, double h);
Rate leave(Run *run, long long which);
void carry(Run *run, Function along, long long offset);
void arrive(Run *run);

/* stepper.c */
void derivative(Run *run, double t, const double *x, double *dx);
void stages(Run *run, double h);
double step_error(Run *run, double h);
double lengthening(double error);
void close_step(Run *run, double h);
void fit_dense(Run *run, double h);
double dense_component(const Run *run, long long i, double theta);
void dense_state(const Run *run, double theta, double *x, long long count);
double first_step(Run *run);
int looks_stiff(Run *run, double h);

/* layer.c */
int dips_into_layer(Run *run, double h);
int goes_over_bend(Run *run, double h);

/* aiming.c */
int in_onset(const Run *run, long long i);
void end_onset(Run *run, long long i);
void look_where(Run *run);
void begin_onset(Run *run, long long i);
int sweep_onsets(Run *run);
void follow_onsets(Run *run);

/* doubts.c */
void doubt(Run *run, double t, long long which, double mode, Reason reason);
void doubt_event(Run *run, long long which, Rate rate);
void suspect(Run *run, long long forced);
void doubt_decision(Run *run, long long forced, int at_start);
double function_size(const Run *run, long long j, double range);
void note_touch(Run *run, long long j, double at, double value, double range);
void doubt_landings(Run *run);
void doubt_touches(Run *run, double h, double first);

/* crossings.c */
double small(const Run *run, long long j);
void event_values(Run *run, double t, const double *x, double *value);
int keep_sliding(Run *run, double h);
double find_event(Run *run, double h, long long *which);
double polish_event(Run *run, double h, double theta, long long which);
int grazes(Run *run, double h, double theta, long long j);
int fires_by_rounding(Run *run, double h, long long which);
void set_levels(Run *run, int at_start);

/* contact.c */
void decide_modes(Run *run, long long forced, int record);
void apply_event(Run *run, long long which, int jumped);
void fire_jumped_switches(Run *run);

/* driver.c */
double next_length(Run *run);
void judge(Run *run, double h, double error);
int goes_on(Run *run);
void emit_end(Run *run);

/* lanes.c calls driver.c, and nothing calls it. */

#endif
