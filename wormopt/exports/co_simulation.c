/* Co-simulation: the method of Dormand and Prince of order 5(4) with error control. Inputs are held
   over a step of communication; breaks of schedules are found by the error. */

static const double stage_at[7] = {0, 1.0 / 5, 3.0 / 10, 4.0 / 5, 8.0 / 9, 1, 1};
static const double stage[7][6] = {
    {0},
    {1.0 / 5},
    {3.0 / 40, 9.0 / 40},
    {44.0 / 45, -56.0 / 15, 32.0 / 9},
    {19372.0 / 6561, -25360.0 / 2187, 64448.0 / 6561, -212.0 / 729},
    {9017.0 / 3168, -355.0 / 33, 46732.0 / 5247, 49.0 / 176, -5103.0 / 18656},
    {35.0 / 384, 0, 500.0 / 1113, 125.0 / 192, -2187.0 / 6784, 11.0 / 84}};
static const double error_of[7] = {71.0 / 57600, 0, -71.0 / 16695, 71.0 / 1920,
                                   -17253.0 / 339200, 22.0 / 525, -1.0 / 40};

static int move_to(casadi_fmi_memory* m, double t, const double* x) {
  size_t i;
  for (i = 0; i < N_X; ++i) m->v[x_vr[i]] = x[i];
  m->t = m->v[0] = t;
  return evaluate(m);
}

static fmi3Status step_to(casadi_fmi_memory* m, double t, double end) {
  double x[N_X + 1], next[N_X + 1], k[7][N_X + 1], h, error, size, most, factor;
  size_t i, j, s;
  int last, accepted;
  for (i = 0; i < N_X; ++i) x[i] = m->v[x_vr[i]];
  if (!(m->h > 0)) m->h = (end - t) / 100;
  while (t < end) {
    last = t + 1.01 * m->h >= end;
    h = last ? end - t : m->h;
    for (s = 0; s < 7; ++s) {
      for (i = 0; i < N_X; ++i) {
        next[i] = x[i];
        for (j = 0; j < s; ++j) next[i] += h * stage[s][j] * k[j][i];
      }
      if (move_to(m, t + stage_at[s] * h, next)) return fmi3Error;
      for (i = 0; i < N_X; ++i) k[s][i] = m->xdot[i];
    }
    most = 0; /* the last stage is the end of the step */
    for (i = 0; i < N_X; ++i) {
      error = 0;
      for (j = 0; j < 7; ++j) error += h * error_of[j] * k[j][i];
      size = fmax(fmax(fabs(x[i]), fabs(next[i])), nominal[i]);
      size = fabs(error) / size;
      if (size > most || size != size) most = size; /* NaN remains */
    }
    most /= m->relative;
    accepted = most <= 1;
    if (!accepted && h < 1e-14 * fmax(fabs(t), fabs(end))) return fmi3Error;
    factor = most < 1e-4 ? 5 : most < 1e4 ? fmin(5, fmax(0.2, 0.9 * pow(most, -0.2))) : 0.1;
    if (accepted) {
      t = last ? end : t + h;
      for (i = 0; i < N_X; ++i) x[i] = next[i];
    }
    /* a step shortened by the end says little about the next one */
    m->h = accepted && last ? fmax(m->h, h * factor) : h * factor;
  }
  m->up_to_date = 0;
  return move_to(m, end, x) ? fmi3Error : fmi3OK;
}

