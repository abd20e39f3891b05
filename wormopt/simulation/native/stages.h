/* Sums of DOP853, for numbers and for vectors, each written for component m of derivatives k;
   STAGE(i, sum) defines the use of the sum of stage i. */
#ifndef WORMOPT_STAGES_H
#define WORMOPT_STAGES_H

#include "tableau.h"

/* term of a stage: coefficient j of row i */
#define T(i, j) A[i][j] * k[j][m]

#define STAGES                                                                                  \
    STAGE(1, T(1, 0));                                                                          \
    STAGE(2, T(2, 0) + T(2, 1));                                                                \
    STAGE(3, T(3, 0) + T(3, 2));                                                                \
    STAGE(4, T(4, 0) + T(4, 2) + T(4, 3));                                                      \
    STAGE(5, T(5, 0) + T(5, 3) + T(5, 4));                                                      \
    STAGE(6, T(6, 0) + T(6, 3) + T(6, 4) + T(6, 5));                                            \
    STAGE(7, T(7, 0) + T(7, 3) + T(7, 4) + T(7, 5) + T(7, 6));                                  \
    STAGE(8, T(8, 0) + T(8, 3) + T(8, 4) + T(8, 5) + T(8, 6) + T(8, 7));                        \
    STAGE(9, T(9, 0) + T(9, 3) + T(9, 4) + T(9, 5) + T(9, 6) + T(9, 7) + T(9, 8));              \
    STAGE(10, T(10, 0) + T(10, 3) + T(10, 4) + T(10, 5) + T(10, 6) + T(10, 7) + T(10, 8)        \
                  + T(10, 9));                                                                  \
    STAGE(11, T(11, 0) + T(11, 3) + T(11, 4) + T(11, 5) + T(11, 6) + T(11, 7) + T(11, 8)        \
                  + T(11, 9) + T(11, 10))

#define OF_STEP(E, j) E[j] * k[j][m]
/* of the step (B), or of its difference to an embedded formula (E6, E5, E3) */
#define STEP_SUM(E)                                                                             \
    (OF_STEP(E, 0) + OF_STEP(E, 5) + OF_STEP(E, 6) + OF_STEP(E, 7) + OF_STEP(E, 8)              \
     + OF_STEP(E, 9) + OF_STEP(E, 10) + OF_STEP(E, 11))

#endif
