/* The stages of a step of one model: put behind its code, where own_rhs is its right-hand side and
   N_X counts its states. That function stands in the place of its calls, so that what it makes of
   parameters and modes is made once, and numbers of one stage wait in registers for the next. */
#include "stages.h"

/* as in lanes.h: a product and a sum in one */
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
