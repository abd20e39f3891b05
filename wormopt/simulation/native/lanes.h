/* Vectors of one double per run, and the functions that right-hand sides need of them. */
#ifndef WORMOPT_LANES_H
#define WORMOPT_LANES_H

#include <math.h>

/* a product and a sum in one: nothing here wants them rounded apart, and lanes gain a fifth */
#pragma GCC optimize("fp-contract=fast")

enum { LANES = 8 };

typedef double vec __attribute__((vector_size(8 * LANES)));
typedef long long ivec __attribute__((vector_size(8 * LANES)));

typedef void (*LaneFunction)(const vec *t, const vec *x, const vec *p, const vec *s, vec *dx);

static const ivec NO_SIGN = {
    0x7fffffffffffffff, 0x7fffffffffffffff, 0x7fffffffffffffff, 0x7fffffffffffffff,
    0x7fffffffffffffff, 0x7fffffffffffffff, 0x7fffffffffffffff, 0x7fffffffffffffff,
};

#define INLINE static inline __attribute__((always_inline, unused))
/* a where a mask is set, else b */
#define PICK(mask, a, b) ((vec)(((mask) & (ivec)(a)) | (~(mask) & (ivec)(b))))
#define WHERE(mask, a) ((vec)((mask) & (ivec)(a)))
#define TRUTH(mask) ((vec)((mask) & (ivec)((vec){} + 1.0)))
/* a sum with this number has the nearest integer in its last bits */
#define TO_INTEGER 0x1.8p52

/* any function of the C library, run by run */
#define EACH(f, a)                                                     \
    ({ vec each_ = (a); for (int l = 0; l < LANES; l++) each_[l] = f(each_[l]); each_; })
#define EACH_2(f, a, b)                                                \
    ({ vec each_ = (a), with_ = (b);                                   \
       for (int l = 0; l < LANES; l++) each_[l] = f(each_[l], with_[l]); each_; })

/* found, and where a mask is not set what the C library finds: whatever the other runs are at */
#define ELSE_EACH(f, a, mask, found)                                                            \
    ({ const vec at_ = (a); const ivec good_ = (mask); vec found_ = (found);                    \
       long long all_ = -1;                                                                     \
       for (int l = 0; l < LANES; l++) all_ &= good_[l];                                        \
       if (!all_) for (int l = 0; l < LANES; l++) if (!good_[l]) found_[l] = f(at_[l]);         \
       found_; })

INLINE vec lane_abs(vec a) { return (vec)((ivec)a & NO_SIGN); }
INLINE vec lane_max(vec a, vec b) { return PICK((a >= b) | (b != b), a, b); }
INLINE vec lane_min(vec a, vec b) { return PICK((a <= b) | (b != b), a, b); }
INLINE vec lane_sign(vec a) { return PICK(a == a, TRUTH(a > 0.0) - TRUTH(a < 0.0), a); }
INLINE vec lane_square(vec a) { return a * a; }
INLINE vec lane_sqrt(vec a) { return EACH(sqrt, a); }

/* exp(a) = power (1 + sum) for |a| up to 600: Taylor's series about the nearest multiple of log 2 */
INLINE vec grown(vec a, vec *power) {
    const vec shifted = a * 1.4426950408889634 + TO_INTEGER, n = shifted - TO_INTEGER;
    const vec r = (a - n * 0.693147180369123816490) - n * 1.90821492927058770002e-10;
    vec sum = r * (1 / 6227020800.0) + 1 / 479001600.0;
    sum = sum * r + 1 / 39916800.0;
    sum = sum * r + 1 / 3628800.0;
    sum = sum * r + 1 / 362880.0;
    sum = sum * r + 1 / 40320.0;
    sum = sum * r + 1 / 5040.0;
    sum = sum * r + 1 / 720.0;
    sum = sum * r + 1 / 120.0;
    sum = sum * r + 1 / 24.0;
    sum = sum * r + 1 / 6.0;
    sum = sum * r + 0.5;
    *power = (vec)(((ivec)shifted + 1023) << 52);
    return sum * (r * r) + r;
}

/* it is 1 to the last bit from 20 on */
INLINE vec lane_tanh(vec a) {
    const vec size = lane_abs(a), most = PICK(size > 20.0, (vec){} + 20.0, size);
    vec power, sum = grown(2.0 * most, &power);
    const vec expm1 = power * sum + (power - 1.0), found = expm1 / (expm1 + 2.0);
    return (vec)((ivec)found | ((ivec)a & ~NO_SIGN));
}

INLINE vec lane_exp(vec a) {
    vec power, sum = grown(a, &power);
    return ELSE_EACH(exp, a, lane_abs(a) < 600.0, power * sum + power);
}

/* sine of a + quarters of a turn; the polynomials are those of Sun's fdlibm, on [-pi/4, pi/4] */
INLINE vec turned_sine(vec a, long long quarters) {
    const vec shifted = a * 0.6366197723675814 + TO_INTEGER, n = shifted - TO_INTEGER;
    const vec r = ((a - n * 1.57079632673412561417) - n * 6.07710050630396597660e-11)
                  - n * 2.02226624879595063154e-21;
    const vec z = r * r;
    vec odd = z * 1.58969099521155010221e-10 - 2.50507602534068634195e-08;
    odd = odd * z + 2.75573137070700676789e-06;
    odd = odd * z - 1.98412698298579493134e-04;
    odd = odd * z + 8.33333333332248946124e-03;
    odd = odd * z - 1.66666666666666324348e-01;
    odd = odd * z * r + r;
    vec even = z * -1.13596475577881948265e-11 + 2.08757232129817482790e-09;
    even = even * z - 2.75573143513906633035e-07;
    even = even * z + 2.48015872894767294178e-05;
    even = even * z - 1.38888888888741095749e-03;
    even = even * z + 4.16666666666666019037e-02;
    even = even * (z * z) - 0.5 * z + 1.0;
    const ivec quarter = (ivec)shifted + quarters;
    const vec found = PICK(-(quarter & 1), even, odd);
    return (vec)((ivec)found ^ ((quarter & 2) << 62));
}

INLINE vec lane_sin(vec a) {
    return ELSE_EACH(sin, a, lane_abs(a) < 1e5, turned_sine(a, 0));
}

INLINE vec lane_cos(vec a) {
    return ELSE_EACH(cos, a, lane_abs(a) < 1e5, turned_sine(a, 1));
}

#endif
