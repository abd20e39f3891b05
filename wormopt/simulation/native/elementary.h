/* exp, tanh, sine and cosine of a `vec`: one number, or one for each run side by side. They use the
   names that the compiler knows, since reading math.h takes a tenth of the compile time. */
#ifndef WORMOPT_ELEMENTARY_H
#define WORMOPT_ELEMENTARY_H

/* adding this number moves the nearest integer to the last bits */
#define TO_INTEGER 0x1.8p52

/* exp(a) = power (1 + sum) for |a| up to 600: Taylor's series about the nearest multiple of log 2 */
INLINE vec grown(vec a, vec *power) {
    const vec shifted = a * 1.4426950408889634 + TO_INTEGER, n = shifted - TO_INTEGER;
    const vec r = (a - n * 0.693147180369123816490) - n * 1.90821492927058770002e-10;
    /* by powers of powers of r: Horner's rule would make each term wait for the one before */
    const vec r2 = r * r, r4 = r2 * r2;
    const vec low = (r * (1 / 6.0) + 0.5) + r2 * (r * (1 / 120.0) + 1 / 24.0);
    const vec middle = (r * (1 / 5040.0) + 1 / 720.0) + r2 * (r * (1 / 362880.0) + 1 / 40320.0);
    const vec high = (r * (1 / 39916800.0) + 1 / 3628800.0)
                     + r2 * (r * (1 / 6227020800.0) + 1 / 479001600.0);
    const vec sum = low + r4 * (middle + r4 * high);
    *power = NUMBER((BITS(shifted) + 1023) << 52);
    return sum * r2 + r;
}

/* 1 to the last bit from 20 on */
INLINE vec lane_tanh(vec a) {
    const vec size = lane_abs(a), most = PICK(size > 20.0, ALL(20.0), size);
    vec power, sum = grown(2.0 * most, &power);
    const vec expm1 = power * sum + (power - 1.0), found = expm1 / (expm1 + 2.0);
    return NUMBER(BITS(found) | (BITS(a) & ~NO_SIGN));
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
    const ivec quarter = BITS(shifted) + quarters;
    const vec found = PICK(-(quarter & 1), even, odd);
    return NUMBER(BITS(found) ^ ((quarter & 2) << 62));
}

INLINE vec lane_sin(vec a) {
    return ELSE_EACH(sin, a, lane_abs(a) < 1e5, turned_sine(a, 0));
}

INLINE vec lane_cos(vec a) {
    return ELSE_EACH(cos, a, lane_abs(a) < 1e5, turned_sine(a, 1));
}

#endif
