/* Steps of Moreau and Jean, see simulation/moreau.py. Functions have CasADi's form. */
#include <string.h>

typedef int (*Function)(const double **arg, double **res, long long *iw, double *w, int mem);

/* Pointers of a call: its arguments and results come first, then the room that it needs. */
typedef struct {
    Function function;
    const double **arg;
    double **res;
    long long *iw;
    double *w;
} Call;

/* Columns of `states` after the first: places, rates and accumulated values after each stride of
   `steps` steps. `scheduled` and `sizes` of steps are given for each stride. The first arguments of
   `inputs` are places and scheduled values, its result the third argument of `kick`. */
void march(Call *inputs, Call *kick, const long long *counts, const double *scheduled,
           const double *p, const double *sizes, double *states)
{
    const long long strides = counts[0], steps = counts[1], half = counts[2], gathered = counts[3];
    const long long n_scheduled = counts[4], n = 2 * half + gathered;
    double *const after = kick->res[0], *const more = kick->res[1];
    for (long long k = 0; k < strides; k++) {
        const double h = sizes[k];
        double *const q = states + (k + 1) * n, *const v = q + half, *const sum = v + half;
        memcpy(q, states + k * n, n * sizeof *q);
        for (long long i = 0; i < steps; i++) {
            for (long long j = 0; j < half; j++) q[j] += h / 2 * v[j];
            const double *const values = scheduled + k * n_scheduled;
            if (inputs->function) {
                inputs->arg[0] = q, inputs->arg[1] = values, inputs->res[0] = (double *)kick->arg[2];
                inputs->function(inputs->arg, inputs->res, inputs->iw, inputs->w, 0);
            }
            kick->arg[0] = q, kick->arg[1] = v, kick->arg[3] = p, kick->arg[4] = &h;
            kick->res[0] = after, kick->res[1] = more;
            kick->function(kick->arg, kick->res, kick->iw, kick->w, 0);
            memcpy(v, after, half * sizeof *v);
            for (long long j = 0; j < half; j++) q[j] += h / 2 * v[j];
            for (long long j = 0; j < gathered; j++) sum[j] += more[j];
        }
    }
}
