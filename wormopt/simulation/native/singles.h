/* Basis of the code of a model without loops: every number by itself, and functions that are
   not calls of the C library. In code of loops (vectors.h) these are called one_. */
#include "numbers.h"
#include "elementary.h"
#define exp lane_exp
#define tanh lane_tanh
#define sin lane_sin
#define cos lane_cos
#define fmax lane_max
#define fmin lane_min
#define one_ALL ALL
#define one_TRUTH TRUTH
#define one_WHERE WHERE
#define one_EACH EACH
#define one_EACH_2 EACH_2
#define one_lane_sqrt lane_sqrt
#define one_lane_abs lane_abs
#define one_lane_max lane_max
#define one_lane_min lane_min
#define one_lane_square lane_square
#define one_lane_sign lane_sign
#define one_lane_tanh lane_tanh
#define one_lane_exp lane_exp
#define one_lane_sin lane_sin
#define one_lane_cos lane_cos
