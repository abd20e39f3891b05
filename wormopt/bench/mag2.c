/* Benchmark MAG2 as one would write it by hand in C: DOP853 (Hairer, Norsett, Wanner, Solving
   Ordinary Differential Equations I, section II.10) with the two masses and their contacts written
   out. No closed form is used, though there is one. A step is taken with the contacts as they are;
   where a function that keeps them so has changed its sign at its end, the step is shortened until
   it ends there: first by the cubic through its ends, then by Newton's method on the step itself,
   the last and least correction along the slope. Signs at the ends of steps are all that is looked
   at: steps are short enough here. It shares nothing with the package's own driver. */
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

#define EACH for (int i = 0; i < N; i++)
#define STAGE(k, c, sum)                \
    EACH z[i] = y[i] + h * (sum);       \
    rhs(pair, t + (c) * h, z, k);

/* One step from (t, y) with derivative k1; y_new is its end. Gives the error, good if at most 1. */
static double step(Pair *pair, double t, double h, const double *restrict y,
                   const double *restrict k1, double *restrict y_new, double rtol, double atol) {
    double k2[N], k3[N], k4[N], k5[N], k6[N], k7[N], k8[N], k9[N], k10[N], k11[N], k12[N], z[N];
    STAGE(k2, 0.05260015195876773, 0.05260015195876773 * k1[i])
    STAGE(k3, 0.0789002279381516, 0.0197250569845379 * k1[i] + 0.0591751709536137 * k2[i])
    STAGE(k4, 0.1183503419072274, 0.02958758547680685 * k1[i] + 0.08876275643042054 * k3[i])
    STAGE(k5, 0.2816496580927726,
          0.2413651341592667 * k1[i] - 0.8845494793282861 * k3[i] + 0.924834003261792 * k4[i])
    STAGE(k6, 0.3333333333333333,
          0.037037037037037035 * k1[i] + 0.17082860872947386 * k4[i] + 0.12546768756682242 * k5[i])
    STAGE(k7, 0.25,
          0.037109375 * k1[i] + 0.17025221101954405 * k4[i] + 0.06021653898045596 * k5[i]
              - 0.017578125 * k6[i])
    STAGE(k8, 0.3076923076923077,
          0.03709200011850479 * k1[i] + 0.17038392571223998 * k4[i] + 0.10726203044637328 * k5[i]
              - 0.015319437748624402 * k6[i] + 0.008273789163814023 * k7[i])
    STAGE(k9, 0.6512820512820513,
          0.6241109587160757 * k1[i] - 3.3608926294469414 * k4[i] - 0.868219346841726 * k5[i]
              + 27.59209969944671 * k6[i] + 20.154067550477894 * k7[i] - 43.48988418106996 * k8[i])
    STAGE(k10, 0.6,
          0.47766253643826434 * k1[i] - 2.4881146199716677 * k4[i] - 0.590290826836843 * k5[i]
              + 21.230051448181193 * k6[i] + 15.279233632882423 * k7[i] - 33.28821096898486 * k8[i]
              - 0.020331201708508627 * k9[i])
    STAGE(k11, 0.8571428571428571,
          -0.9371424300859873 * k1[i] + 5.186372428844064 * k4[i] + 1.0914373489967295 * k5[i]
              - 8.149787010746927 * k6[i] - 18.52006565999696 * k7[i] + 22.739487099350505 * k8[i]
              + 2.4936055526796523 * k9[i] - 3.0467644718982196 * k10[i])
    STAGE(k12, 1.0,
          2.273310147516538 * k1[i] - 10.53449546673725 * k4[i] - 2.0008720582248625 * k5[i]
              - 17.9589318631188 * k6[i] + 27.94888452941996 * k7[i] - 2.8589982771350235 * k8[i]
              - 8.87285693353063 * k9[i] + 12.360567175794303 * k10[i] + 0.6433927460157636 * k11[i])
    double five = 0.0, three = 0.0;
    EACH {
        double b = 0.054293734116568765 * k1[i] + 4.450312892752409 * k6[i]
                   + 1.8915178993145003 * k7[i] - 5.801203960010585 * k8[i]
                   + 0.3111643669578199 * k9[i] - 0.1521609496625161 * k10[i]
                   + 0.20136540080403034 * k11[i] + 0.04471061572777259 * k12[i];
        double e5 = 0.01312004499419488 * k1[i] - 1.2251564463762044 * k6[i]
                    - 0.4957589496572502 * k7[i] + 1.6643771824549864 * k8[i]
                    - 0.35032884874997366 * k9[i] + 0.3341791187130175 * k10[i]
                    + 0.08192320648511571 * k11[i] - 0.022355307863886294 * k12[i];
        double e3 = b - 0.2440944881889764 * k1[i] - 0.7338466882816118 * k9[i]
                    - 0.022058823529411766 * k12[i];
        y_new[i] = y[i] + h * b;
        double scale = 1.0 / (atol + rtol * fmax(fabs(y[i]), fabs(y_new[i])));
        e5 *= scale, e3 *= scale;
        five += e5 * e5, three += e3 * e3;
    }
    double both = five + 0.01 * three;
    return both > 0.0 ? h * five / sqrt(N * both) : 0.0;
}

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
