/* Input and output of the driver. kernel.py mirrors both structs: change both. */
#ifndef WORMOPT_DRIVER_H
#define WORMOPT_DRIVER_H

/* Form of the functions that CasADi generates. */
typedef int (*Function)(const double **arg, double **res, long long *iw, double *w, int mem);

/* The stages of a step, see own_stages.c. */
typedef void (*Stages)(double t, double h, const double *x, const double *p, const double *s,
                       double **k, double *stage, double *end);

/* Parameters that are constant on pieces of time; on piece k they are values[k]. */
typedef struct {
    double start;
    long long pieces, size, offset, periodic; /* offset of `begin` in p; the values follow it */
    const double *breaks, *values;
    const double *along; /* per piece and value k entries of directions; NULL where there are none */
} Schedule;

/* Positions of the entries of a Jacobian. */
typedef struct {
    long long count;
    const long long *rows, *columns;
} Entries;

typedef struct {
    long long n_x, n_all; /* states; with their derivatives along the directions, see variation.c */
    long long n_model, n_p, k; /* states of the model, parameters, directions */
    long long n_contacts, n_rows, n_s, n_switches, n_schedules, n_times;
    long long n_iw, n_w, n_arg, n_res; /* work space of the generated functions */
    long long exact, coupled, shares, keep_dense, max_steps, stiff_steps;
    long long keep; /* most ends of steps to keep; 0: samples at `times` */
    Function rhs;      /* (t, x, p, s) -> x' */
    Function velocities; /* (t, x, p, s) -> velocities of the contacts; smooth only, not where all
                            are states */
    Function probe;    /* (t, x, p, s) -> velocities, accelerations, forces, least and largest force
                          that holds, how well resting contacts determine their forces; exact only */
    Function aims;     /* (t, x, p, s) -> per contact in the plane a direction and its error */
    Function bends;    /* (t, x, p, s) -> per planar contact velocity at the kink, and speed */
    Function project;  /* (t, x, p, s) -> x with the velocities of contacts with s = 0 made zero */
    Function guards;   /* (t, x, p, s) -> guards of the switches, then their rates */
    Function resets;   /* (t, x, p, s) -> states after each switch, one column each */
    Function slopes;   /* (t, x, p, s) -> x', entries of its derivatives by the model's x and by p */
    /* (t, x, p, s, dt, dx, dp) -> changes of velocities and of distances from the least and the
       largest force that hold; of project; of guards; of resets */
    Function contacts_along, project_along, guards_along, resets_along;
    /* (t, x, p, s) -> sizes of the integrands; see doubts.c */
    Function contact_parts, guard_parts;
    Stages own_stages; /* includes rhs; NULL if it would be too long */
    Entries in_x, in_p;
    const long long *velocity_state; /* per contact the state that is its velocity, or -1 */
    const long long *planar;         /* per contact its index among those in the plane, or -1 */
    const long long *row_contact, *row_state; /* per component of velocity */
    const long long *directions;     /* per contact 1 forward, 2 backward, 3 both; and 4 where no
                                        force changes its velocity, 8 where none does in places */
    const long long *terminal;       /* per switch: whether the motion ends with it */
    const long long *crosses;        /* per switch: whether the motion must leave it, see Switch */
    const double *v_rest;            /* per contact: slower is at rest */
    const double *v_drift;           /* the same for a contact at rest */
    const double *f_rest;            /* per contact: negligible force */
    const double *v_stop;            /* per contact: speed to be stopped */
    const double *nominal_force, *nominal_speed; /* per contact */
    const double *reach;             /* 4 rows, per contact: see event_values */
    const double *v_layer;           /* per contact: where the smooth law is steep */
    const double *absolute;          /* per state */
    const double *column_size;       /* per direction the expected size of S, in nominal sizes */
    const Schedule *schedules;
    const double *times;             /* ascending, within [t, t_end] */
    double relative, max_step, t_start, t_end;
    double small_rate, small_value; /* negligible shares */
    double unit;  /* absolute tolerance of a state of nominal size 1 */
    double slack; /* how much less exact derivatives may be than states */
} Problem;

typedef enum {
    RUNNING = 0,
    DONE = 1,
    STEP_TOO_SMALL = -1,
    NOT_FINITE = -2,
    TOO_MANY_STEPS = -3,
    STIFF = -4,
    EVENTS_ACCUMULATE = -5,
    NO_CONTACT_MODE = -6,
    NO_MEMORY = -7,
    STEEP_DERIVATIVES = -8,
    OPEN_FORCE = -9
} Status;

typedef enum { REVERSAL = 0, STICK = 1, RELEASE = 2, IMPACT = 3, SWITCH = 4 } Kind;

typedef enum { GRAZING = 0, SIMULTANEOUS = 1, EDGE = 2 } Reason;

/* Rows of doubles that grow. */
typedef struct {
    double *data;
    long long rows, width, room;
} Table;

typedef struct {
    double t, h;
    long long status, n_steps, n_rejected, n_evaluations, n_sampled;
    double *x;       /* n_all */
    double *p;       /* parameters, then row by row their directions; both as scheduled */
    double *samples; /* n_times rows of n_all */
    Table events;    /* time, index of contact or n_contacts + index of switch, kind, mode, k
                        derivatives of the time */
    Table modes;     /* time, modes and directions of onset */
    Table doubts;    /* time, index as in events, mode, reason */
    Table dense;     /* end of the step, 8 n_all coefficients */
    Table kept;      /* beginning of a step, n_all: every one, or every 2nd, 4th, ... */
} Report;

#endif
