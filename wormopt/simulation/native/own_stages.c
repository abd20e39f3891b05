/* Stages of a step for one model. This file follows the model's code, where own_rhs is the
   right-hand side and N_X the number of states. The compiler inlines own_rhs, so that terms of
   parameters and modes are computed once and results of a stage stay in registers. */
#include "stages.h"

/* fuse multiply-add, as in lanes.h */
#pragma GCC optimize("fp-contract=fast")

void own_stages(double t, double h, const double *start, const double *p, const double *s,
                double **slopes, double *stage, double *end) {
    double x[N_X], y[N_X], k[N_STAGES][N_X], at;
    const double *arg[] = {&at, y, p, s};
    for (int m = 0; m < N_X; m++) x[m] = start[m], k[0][m] = slopes[0][m];
#define STAGE(i, sum)                                             \
    for (int m = 0; m < N_X; m++) y[m] = x[m] + h * (sum);        \
    at = t + C[i] * h;                                            \
    own_rhs(arg, (double *[]){k[i]}, 0, 0, 0)
    STAGES;
#undef STAGE
    for (int m = 0; m < N_X; m++) end[m] = x[m] + h * STEP_SUM(B), stage[m] = y[m];
    for (int i = 1; i < N_STAGES; i++)
        for (int m = 0; m < N_X; m++) slopes[i][m] = k[i][m];
}
