/* Benchmark MAG2 as one would write it by hand in C: DOP853 with the two masses and their contacts
   written out. No closed form is used, though there is one. A step is taken with the contacts as they
   are; where a function that keeps them so has changed its sign at its end, the step is shortened
   until it ends there: first by the cubic through its ends, then by Newton's method on the step
   itself, the last and least correction along the slope. Signs at the ends of steps are all that is
   looked at: steps are short enough here. It shares nothing with the package's own driver. */
#include <math.h>

#define N 4 /* x0 x1 v0 v1 */

static const double EPS = 0.036, NU = 1.4322135623730952; /* sqrt(2) + EPS / 2 */
static const double BACK = 0.036, AHEAD = 0.018; /* friction against motion backward and forward */

typedef struct {
    int mode[2];       /* +1, -1: slides so; 0: rests */
    double friction[2]; /* of what slides */
    long long evaluations, events;
} Pair;

static inline double pull(double t, const double *y) {
    return y[0] - y[1] + EPS * (1.0 + cos(NU * t));
}

static inline void rhs(Pair *pair, double t, const double *y, double *dy) {
    const double u = pull(t, y);
    pair->evaluations++;
    dy[0] = y[2], dy[1] = y[3];
    dy[2] = pair->mode[0] ? pair->friction[0] - u : 0.0;
    dy[3] = pair->mode[1] ? pair->friction[1] + u : 0.0;
}

/* Force on mass i without friction. */
static inline double load(int i, double t, const double *y) { return i ? pull(t, y) : -pull(t, y); }

/* Positive while mass i goes on as it does; its slope along dy. */
static inline double keeps(const Pair *pair, int i, double t, const double *y) {
    if (pair->mode[i]) return pair->mode[i] * y[2 + i];
    const double f = load(i, t, y);
    return fmin(AHEAD - f, BACK + f);
}

static inline double slope(const Pair *pair, int i, double t, const double *y, const double *dy) {
    if (pair->mode[i]) return pair->mode[i] * dy[2 + i];
    const double f = load(i, t, y), rate = dy[0] - dy[1] - EPS * NU * sin(NU * t);
    return (AHEAD - f < BACK + f ? -1.0 : 1.0) * (i ? rate : -rate);
}

/* Mass i stands still: it rests if friction can hold it, else it goes where it is pushed. */
static void decide(Pair *pair, int i, double t, double *y, int let_go) {
    const double f = load(i, t, y);
    y[2 + i] = 0.0;
    pair->mode[i] = 0;
    if (let_go ? AHEAD - f < BACK + f : f > AHEAD) pair->mode[i] = 1;
    if (let_go ? AHEAD - f >= BACK + f : f < -BACK) pair->mode[i] = -1;
    pair->friction[i] = pair->mode[i] > 0 ? -AHEAD : BACK;
}

#define MOTION Pair
#include "dop853.h"

/* Last share of a step at which the cubic with these values and slopes at its ends is 0: at the first
   there may be one, of an event just left. */
static double cubic_root(double a, double b, double da, double db) {
    double low = 0.0, high = 1.0, s = 1.0;
    for (int i = 0; i < 30 && high - low > 1e-9; i++) {
        const double square = 3 * (b - a) - 2 * da - db, cube = da + db - 2 * (b - a);
        const double value = a + s * (da + s * (square + s * cube));
        const double next = s - value / (da + s * (2 * square + s * 3 * cube));
        if (value > 0.0) low = s; else high = s;
        if (fabs(next - s) < 1e-9) break;
        s = next > low && next < high ? next : 0.5 * (low + high);
    }
    return s;
}

/* From rest at t = 0 to t_end; y (4) is the state at the end. Gives the number of accepted steps,
   negative if the step became too small. counts: rejected steps, evaluations, events. */
long long mag2(double t_end, double rtol, double atol, double *y, long long *counts) {
    double buffer[2][N] = {{0.0}}, k1[N], slope_new[N];
    double *now = buffer[0], *next = buffer[1], t = 0.0, h = 1e-3;
    long long steps = 0, rejected = 0;
    Pair pair = {{0, 0}, {0.0, 0.0}, 0, 0};
    for (int i = 0; i < 2; i++) decide(&pair, i, t, now, 0);
    rhs(&pair, t, now, k1);
    while (t < t_end) {
        const int last = t + h >= t_end;
        double length = last ? t_end - t : h, error = step(&pair, t, length, now, k1, next, rtol, atol);
        double factor = error > 0.0 ? 0.9 * pow(error, -0.125) : 6.0, wanted;
        if (!(error <= 1.0)) {
            rejected++;
            h = length * (error == error ? fmax(factor, 1.0 / 3) : 0.1);
            if (h < 1e-14) return -steps - 1;
            continue;
        }
        wanted = length * fmin(fmax(factor, 1.0 / 3), 6.0);
        rhs(&pair, t + length, next, slope_new);
        int which = -1;
        double first = 1.0;
        for (int i = 0; i < 2; i++) {
            const double b = keeps(&pair, i, t + length, next);
            if (b >= 0.0) continue;
            const double a = fmax(keeps(&pair, i, t, now), 0.0);
            const double s = cubic_root(a, b, length * slope(&pair, i, t, now, k1),
                                        length * slope(&pair, i, t + length, next, slope_new));
            if (which < 0 || s < first) which = i, first = s;
        }
        if (which >= 0) {
            const int let_go = pair.mode[which] == 0;
            wanted = h;
            length *= first;
            for (int trial = 0; trial < 6; trial++) {
                step(&pair, t, length, now, k1, next, rtol, atol);
                rhs(&pair, t + length, next, slope_new);
                const double shift = -keeps(&pair, which, t + length, next)
                                     / slope(&pair, which, t + length, next, slope_new);
                length += shift;
                if (fabs(shift) > 1e-8) continue;
                EACH next[i] += shift * slope_new[i];
                break;
            }
            pair.events++;
            decide(&pair, which, t + length, next, let_go);
            rhs(&pair, t + length, next, slope_new);
        }
        t = last && which < 0 ? t_end : t + length;
        h = last && which < 0 ? h : wanted;
        double *old = now;
        now = next, next = old;
        EACH k1[i] = slope_new[i];
        steps++;
    }
    EACH y[i] = now[i];
    counts[0] = rejected, counts[1] = pair.evaluations, counts[2] = pair.events;
    return steps;
}
