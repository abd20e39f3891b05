/* Vectors of one double per run; operations of right-hand sides besides those of elementary.h. */
#ifndef WORMOPT_LANES_H
#define WORMOPT_LANES_H

/* fuse multiply-add: separate rounding is not needed, and lanes gain a fifth */
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
#define BITS(a) ((ivec)(a))
#define NUMBER(bits) ((vec)(bits))
/* with the sign of a zero */
#define ALL(a) ((a) - (vec){})
/* a where a mask is set, else b */
#define PICK(mask, a, b) ((vec)(((mask) & (ivec)(a)) | (~(mask) & (ivec)(b))))
#define WHERE(mask, a) ((vec)((mask) & (ivec)(a)))
#define TRUTH(mask) ((vec)((mask) & (ivec)((vec){} + 1.0)))
/* any function of the C library, run by run */
#define EACH(f, a)                                                     \
    ({ vec each_ = (a);                                                \
       for (int l = 0; l < LANES; l++) each_[l] = __builtin_##f(each_[l]); each_; })
#define EACH_2(f, a, b)                                                \
    ({ vec each_ = (a), with_ = (b);                                   \
       for (int l = 0; l < LANES; l++) each_[l] = __builtin_##f(each_[l], with_[l]); each_; })

/* `found`, or the result of the C library where a mask is not set, whatever the other runs do */
#define ELSE_EACH(f, a, mask, found)                                                            \
    ({ const vec at_ = (a); const ivec good_ = (mask); vec found_ = (found);                    \
       long long all_ = -1;                                                                     \
       for (int l = 0; l < LANES; l++) all_ &= good_[l];                                        \
       if (!all_)                                                                               \
           for (int l = 0; l < LANES; l++) if (!good_[l]) found_[l] = __builtin_##f(at_[l]);    \
       found_; })

INLINE vec lane_abs(vec a) { return (vec)((ivec)a & NO_SIGN); }
INLINE vec lane_max(vec a, vec b) { return PICK((a >= b) | (b != b), a, b); }
INLINE vec lane_min(vec a, vec b) { return PICK((a <= b) | (b != b), a, b); }
INLINE vec lane_sign(vec a) {
    return PICK((a > 0.0) | (a < 0.0), TRUTH(a > 0.0) - TRUTH(a < 0.0), a);
}
INLINE vec lane_square(vec a) { return a * a; }
INLINE vec lane_sqrt(vec a) { return EACH(sqrt, a); }

#endif
