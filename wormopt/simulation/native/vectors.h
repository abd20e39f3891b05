/* Basis of the code of a model with loops: vectors of equal operations of neighbours in a chain,
   their loading and storing, and the same operations for one number with the prefix one_. */
#pragma GCC push_options
#include "lanes.h"
#include "elementary.h"
#pragma GCC pop_options
typedef double near __attribute__((vector_size(8 * LANES), aligned(8), may_alias));
#define NEXT(place) (*(near *)&(place))
#define EVERY(place) ({ vec v_; for (int l = 0; l < LANES; l++) v_[l] = (place); v_; })
#define SPREAD(place, value) \
    do { const vec v_ = (value); for (int l = 0; l < LANES; l++) (place) = v_[l]; } while (0)
#define one_ALL(a) (a)
#define one_TRUTH(condition) ((double)(condition))
#define one_WHERE(condition, a) ((condition) ? (a) : 0.0)
#define one_EACH(f, a) __builtin_##f(a)
#define one_EACH_2(f, a, b) __builtin_##f(a, b)
#define one_lane_sqrt __builtin_sqrt
#define one_lane_abs __builtin_fabs
#define one_lane_max __builtin_fmax
#define one_lane_min __builtin_fmin
#define one_lane_tanh __builtin_tanh
#define one_lane_exp __builtin_exp
#define one_lane_sin __builtin_sin
#define one_lane_cos __builtin_cos
INLINE double one_lane_square(double a) { return a * a; }
INLINE double one_lane_sign(double a) { return a < 0 ? -1 : a > 0 ? 1 : a; }
