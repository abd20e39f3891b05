/* Benchmark TRACK14 as one would write it by hand in C: DOP853 with the worm of three masses, tracker
   (14) and the chapter's data written out. It shares nothing with the package's own driver. */
#include <math.h>

#define PI 3.14159265358979323846
#define N 9 /* x0 x1 x2 v0 v1 v2 k theta1 theta2 */

static const double PERIOD = 1.0, REST = 2.0, ELONGATION = 0.15; /* gait (15) */
static const double STIFFNESS = 10.0, DAMPING = 5.0, TUBE = 0.2;

/* y_ref is middle + wave cos(3 pi s) on each third of the period, s since the third began */
static const double MIDDLE[3][2] = {{1, -1}, {1, -2}, {0, -1}};
static const double WAVE[3][2] = {{-1, 1}, {1, 0}, {0, -1}};

typedef struct {
    double begin;       /* of the third */
    const double *middle, *wave;
    long long evaluations;
} Third;

static inline double friction(double v) { return 4.5 - 5.5 * tanh(40.0 * v); }

static inline void rhs(Third *third, double t, const double *y, double *dy) {
    const double *x = y, *v = y + 3, k = y[6], *theta = y + 7;
    const double c = cos(3.0 * PI / PERIOD * (t - third->begin)), size = REST * ELONGATION;
    const double l1 = x[0] - x[1], l2 = x[1] - x[2];
    const double e1 = l1 - (REST + size * (third->middle[0] + third->wave[0] * c));
    const double e2 = l2 - (REST + size * (third->middle[1] + third->wave[1] * c));
    const double outside = sqrt(e1 * e1 + e2 * e2) - TUBE;
    const double dk = outside > 0.0 ? outside * outside : 0.0;
    const double dtheta1 = k * k * (e1 - theta[0]), dtheta2 = k * k * (e2 - theta[1]);
    const double u1 = -((k + dk) * theta[0] + k * dtheta1);
    const double u2 = -((k + dk) * theta[1] + k * dtheta2);
    const double mu1 = STIFFNESS * l1 + DAMPING * (v[0] - v[1]) - u1;
    const double mu2 = STIFFNESS * l2 + DAMPING * (v[1] - v[2]) - u2;
    third->evaluations++;
    dy[0] = v[0], dy[1] = v[1], dy[2] = v[2];
    dy[3] = friction(v[0]) - mu1;
    dy[4] = friction(v[1]) + mu1 - mu2;
    dy[5] = friction(v[2]) + mu2;
    dy[6] = dk, dy[7] = dtheta1, dy[8] = dtheta2;
}

#define MOTION Third
#include "dop853.h"

/* From t = 0 to t_end; y (9) is the state at the end. Gives the number of accepted steps, negative
   if the step became too small. counts: rejected steps, evaluations. */
long long track14(double t_end, double rtol, double atol, double *y, long long *counts) {
    double buffer[2][N] = {{0.0, 2.0, 4.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0}}, k1[N];
    double *now = buffer[0], *next = buffer[1], t = 0.0, h = 1e-4;
    long long steps = 0, rejected = 0, thirds = 0;
    Third third = {0.0, MIDDLE[0], WAVE[0], 0};
    rhs(&third, t, now, k1);
    while (t < t_end) {
        double stop = fmin((thirds + 1) * PERIOD / 3, t_end);
        int last = t + 1.01 * h >= stop; /* land on the end of the third, but keep h */
        double length = last ? stop - t : h;
        double error = step(&third, t, length, now, k1, next, rtol, atol);
        double factor = error > 0.0 ? 0.9 * pow(error, -0.125) : 6.0;
        if (!(error <= 1.0)) {
            rejected++;
            h = length * (error == error ? fmax(factor, 1.0 / 3) : 0.1);
            if (h < 1e-14) return -steps - 1;
            continue;
        }
        if (!last || factor < h / length) h = length * fmin(fmax(factor, 1.0 / 3), 6.0);
        t = last ? stop : t + length;
        double *old = now;
        now = next, next = old;
        steps++;
        if (last) {
            thirds++;
            third.begin = stop;
            third.middle = MIDDLE[thirds % 3], third.wave = WAVE[thirds % 3];
        }
        rhs(&third, t, now, k1);
    }
    EACH y[i] = now[i];
    counts[0] = rejected, counts[1] = third.evaluations;
    return steps;
}
