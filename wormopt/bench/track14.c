/* Benchmark TRACK14 as one would write it by hand in C: DOP853 (Hairer, Norsett, Wanner, Solving
   Ordinary Differential Equations I, section II.10) with the worm of three masses, tracker (14) and
   the chapter's data written out. It shares nothing with the package's own driver. */
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

#define EACH for (int i = 0; i < N; i++)
#define STAGE(k, c, sum)                \
    EACH z[i] = y[i] + h * (sum);       \
    rhs(third, t + (c) * h, z, k);

/* One step from (t, y) with derivative k1; y_new is its end. Gives the error, good if at most 1. */
static double step(Third *third, double t, double h, const double *restrict y,
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

/* The right-hand side alone, so many times over: what an evaluation costs. */
double track14_rhs(long long times) {
    double y[N] = {0.1, 2.1, 4.1, 0.3, -0.2, 0.5, 5.0, 0.3, -0.4}, dy[N];
    Third third = {0.0, MIDDLE[0], WAVE[0], 0};
    for (long long i = 0; i < times; i++) {
        rhs(&third, 1e-7 * i, y, dy);
        EACH y[i] += 1e-12 * dy[i]; /* so that nothing is the same as before */
    }
    return y[0];
}
