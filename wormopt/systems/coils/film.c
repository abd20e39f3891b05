/* The equations of film_code.py and their Jacobian, from `local` and `local_slopes` of all cells.
   Constants, macros, these two and sparsities come before this text. State: volume left of each of
   the M inner faces, position and velocity of the float, then further sums over the cells. */
enum { M = N - 1, BAND = 2 * NEAR + 3, ALONG = BAND + 2, OUT = (1 + SUMS) * (1 + ALONG) };
enum { WORK = (OUT + ROWS) * N + 1 + 2 * (N + BAND) + 2 * N }; /* too much for a stack */

/* out[k][i] of each cell i: flow through its right face, its parts of the sums, then for each of
   these the derivatives by the volumes at the faces near, by position and velocity */
static double (*all(const double **arg, Local *function, double *w))[N]
{
    const double t = *arg[0], *x = arg[1], *given = GIVEN, s = SINCE;
    double (*out)[N] = (double (*)[N])w, *field = w + OUT * N, *volume = field + ROWS * N + 1;
    double *middle = volume + N + BAND, *face = middle + N + BAND, *inner = face + N;
    for (int i = 0; i < N + BAND; i++) {
        /* walls are mirrors: cells beyond them are as thick, and covered, as those before them */
        const int cell = i - NEAR, wall = i - NEAR;
        const int seen = cell < 0 ? -1 - cell : cell < N ? cell : 2 * N - 1 - cell;
        const int at = wall < 0 ? -wall : wall <= N ? wall : 2 * N - wall;
        middle[i] = START + STEP * (seen + 0.5);
        volume[i] = at == 0 || at == N ? 0.0 : at == wall ? x[at - 1] : -x[at - 1];
    }
    for (int i = 0; i < N; i++) {
        face[i] = START + STEP * (i + 1);
        inner[i] = i < M;
    }
    for (int i = 0; i < ROWS * N; i++) {
        field[i] = 0.0;
        for (int k = POWERS - 1; k >= 0; k--) field[i] = field[i] * s + given[k * ROWS * N + i];
    }
    field[ROWS * N] = 0.0;
    const double common[] = {x[M], x[M + 1], PACE};
    for (int k = 0; k < N; k += LANES) {
        const int i = k < N - LANES ? k : N - LANES;
        function(volume + i, middle + i, face + i, inner + i, field + i, common, &out[0][i]);
    }
    return out;
}

int dae(const double **arg, double **res, long long *iw, double *w, int mem)
{
    double *found = res[0], (*out)[N];
    if (!found) return 0;
    out = all(arg, local, w);
    for (int i = 0; i < M; i++) found[i] = out[0][i];
    found[M] = VELOCITY * PACE * arg[1][M + 1];
    for (int k = 0; k < SUMS; k++) {
        found[M + 1 + k] = 0.0;
        for (int i = 0; i < N; i++) found[M + 1 + k] += out[1 + k][i];
    }
    return 0;
}

int daeF(const double **arg, double **res, long long *iw, double *w, int mem)
{
    return dae(arg, res, iw, w, mem);
}

int jacF(const double **arg, double **res, long long *iw, double *w, int mem)
{
    double *found = res[0], (*out)[N];
    const long long *first = jacF_sparsity_out(0) + 2, *row = first + N + SUMS + 1;
    if (!found) return 0;
    out = all(arg, local_slopes, w);
    for (int k = 0; k < first[N + SUMS]; k++) found[k] = 0.0;
    found[first[M + 2] - SUMS - 1] = VELOCITY * PACE;
    for (int k = 0; k < ALONG; k++) {
        for (int i = 0; i < N; i++) {
            int column = i - NEAR + k, sign = 1; /* a face, before the columns of the float */
            if (k >= BAND) {
                column = M + 1 + k - BAND;
            } else {
                if (column < 0 || column > N) sign = -1;
                column = column < 0 ? -column : column <= N ? column : 2 * N - column;
                if (column == 0 || column == N) continue;
            }
            const long long begin = first[column - 1], end = first[column];
            if (i < M) found[begin + i - row[begin]] += sign * out[1 + SUMS + k][i];
            for (int j = 0; j < SUMS; j++)
                found[end - SUMS + j] += sign * out[1 + SUMS + (1 + j) * ALONG + k][i];
        }
    }
    return 0;
}

static int work(long long *arg, long long *res, long long *iw, long long *w)
{
    *arg = 5;
    *res = 4;
    *iw = 0;
    *w = WORK;
    return 0;
}

int dae_work(long long *arg, long long *res, long long *iw, long long *w)
{
    return work(arg, res, iw, w);
}

int daeF_work(long long *arg, long long *res, long long *iw, long long *w)
{
    return work(arg, res, iw, w);
}

int jacF_work(long long *arg, long long *res, long long *iw, long long *w)
{
    return work(arg, res, iw, w);
}
