/* Memory of a run: its arrays, and tables that grow. */
#include "run.h"

/* Next row of a table, NULL if memory is exhausted, which ends the run. */
double *grow(Run *run, Table *table) {
    if (table->rows == table->room) {
        long long room = table->room ? 2 * table->room : 64;
        double *data = realloc(table->data, room * table->width * sizeof(double));
        if (!data) {
            run->out.status = NO_MEMORY;
            return NULL;
        }
        table->data = data, table->room = room;
    }
    return table->data + table->width * table->rows++;
}

/* Make the arrays of a run; 0 if memory is out. */
int allocate(Run *run) {
    const Problem *in = &run->in;
    const long long n = in->n_all, c = in->n_contacts, f = n_functions(run);
    int good = 1;
#define ROOM(pointer, count) good &= (pointer = calloc((size_t)(count) + 3, sizeof *(pointer))) != NULL
    ROOM(run->out.x, n);
    ROOM(run->out.p, in->n_p * (1 + in->k));
    ROOM(run->out.samples, in->n_times * n);
    for (int i = 0; i < N_ALL; i++) ROOM(run->k[i], n);
    ROOM(run->x_new, n);
    ROOM(run->stage, n);
    ROOM(run->dense, N_DENSE * n);
    ROOM(run->modes, in->n_s + c); /* with smooth contact n_s is 0 */
    ROOM(run->before, in->n_s + c);
    ROOM(run->aims, 3 * c);
    ROOM(run->toward, 2 * c);
    ROOM(run->bend, 4 * c);
    ROOM(run->released, c);
    ROOM(run->struck, c);
    ROOM(run->fresh, c);
    ROOM(run->probe, 5 * c + 1);
    ROOM(run->guard, 2 * in->n_switches);
    ROOM(run->reset, n * (in->n_switches + 1));
    ROOM(run->value, f);
    ROOM(run->level, f);
    ROOM(run->passed, in->n_switches);
    ROOM(run->fired, in->n_switches);
    ROOM(run->jumped, in->n_switches);
    ROOM(run->near, in->n_switches);
    ROOM(run->approach, in->n_switches);
    ROOM(run->jumps, in->n_switches);
    ROOM(run->origin, in->n_x);
    ROOM(run->scan, 13 * f + 2 * c);
    ROOM(run->column, n);
    ROOM(run->event_along, in->k);
    ROOM(run->last_along, in->k);
    ROOM(run->suspect, c);
    ROOM(run->touch, f);
    ROOM(run->slope, in->n_x);
    ROOM(run->slopes_x, in->in_x.count);
    ROOM(run->slopes_p, in->in_p.count);
    ROOM(run->nearby, 4 * (in->in_x.count + in->in_p.count));
    ROOM(run->column_x, in->n_x);
    ROOM(run->column_p, in->n_p);
    ROOM(run->change, in->n_x * (in->n_switches + 1) + 3 * c);
    ROOM(run->column_error, 4 * in->k);
    ROOM(run->cycle, in->n_schedules);
    ROOM(run->piece, in->n_schedules);
    ROOM(run->iw, in->n_iw);
    ROOM(run->w, in->n_w);
    ROOM(run->arg, in->n_arg);
    ROOM(run->res, in->n_res);
#undef ROOM
    run->out.events.width = 4 + in->k;
    run->out.modes.width = 1 + in->n_s;
    run->out.doubts.width = 4;
    run->out.dense.width = 1 + N_DENSE * n;
    run->out.kept.width = 1 + n;
    return good;
}

EXPORT void wormopt_free(Run *run) {
    if (!run) return;
    double *owned[] = {
        run->out.x,  run->out.p,  run->out.samples, run->out.events.data, run->out.modes.data,
        run->out.dense.data,      run->x_new,       run->stage,           run->dense,
        run->modes,  run->before, run->aims,        run->toward,          run->bend,
        run->fresh,  run->struck, run->released,    run->probe,           run->guard,
        run->reset,  run->value,  run->level,       run->scan,            run->column,
        run->passed, run->fired,          run->jumped,      run->near,            run->approach,
        run->jumps,  run->origin,
        run->w,      run->event_along,          run->slope,           run->slopes_x,
        run->slopes_p, run->column_x,           run->column_p,        run->change,
        run->column_error,        run->last_along,  run->suspect,         run->touch,
        run->out.doubts.data,     run->out.kept.data,
        run->nearby,
    };
    for (size_t i = 0; i < sizeof owned / sizeof *owned; i++) free(owned[i]);
    for (int i = 0; i < N_ALL; i++) free(run->k[i]);
    free(run->cycle), free(run->piece), free(run->iw), free(run->arg), free(run->res), free(run);
}
