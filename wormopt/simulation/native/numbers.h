/* What right-hand sides need beside elementary.h where a `vec` is a single number, see lanes.h. */
#ifndef WORMOPT_NUMBERS_H
#define WORMOPT_NUMBERS_H

typedef double vec;
typedef unsigned long long ivec;

static const ivec NO_SIGN = 0x7fffffffffffffff;

#define INLINE static inline __attribute__((always_inline, unused))
#define ALL(a) (a)
#define PICK(condition, a, b) ((condition) ? (a) : (b))
#define WHERE(condition, a) ((condition) ? (a) : 0.0)
#define TRUTH(condition) ((double)(condition))
#define EACH(f, a) __builtin_##f(a)
#define EACH_2(f, a, b) __builtin_##f(a, b)
#define ELSE_EACH(f, a, condition, found) ((condition) ? (found) : __builtin_##f(a))

INLINE ivec BITS(double a) {
    ivec bits;
    __builtin_memcpy(&bits, &a, sizeof bits);
    return bits;
}

INLINE double NUMBER(ivec bits) {
    double a;
    __builtin_memcpy(&a, &bits, sizeof a);
    return a;
}

#define lane_sqrt __builtin_sqrt
#define lane_abs __builtin_fabs
/* those of the C library are calls */
INLINE double lane_max(double a, double b) { return a >= b || b != b ? a : b; }
INLINE double lane_min(double a, double b) { return a <= b || b != b ? a : b; }
INLINE double lane_square(double a) { return a * a; }
INLINE double lane_sign(double a) { return a < 0 ? -1 : a > 0 ? 1 : a; }

#endif
