/* What both forms of the peer are made of: plain loops over sizes passed along, every product accumulated in place. */
#ifndef TINYEKF_MATRICES_H
#define TINYEKF_MATRICES_H

#include <math.h>
#include <string.h>

#include "tinyekf.h"

/* c = a b */
static void multiply(const double *a, const double *b, double *c, int rows, int inner, int columns)
{
    for (int i = 0; i < rows; i++) {
        for (int j = 0; j < columns; j++) {
            c[i * columns + j] = 0;
            for (int k = 0; k < inner; k++) {
                c[i * columns + j] += a[i * inner + k] * b[k * columns + j];
            }
        }
    }
}

static void transpose(const double *a, double *at, int rows, int columns)
{
    for (int i = 0; i < rows; i++) {
        for (int j = 0; j < columns; j++) {
            at[j * rows + i] = a[i * columns + j];
        }
    }
}

/* c = a + sign b */
static void combine(const double *a, const double *b, double sign, double *c, int count)
{
    for (int i = 0; i < count; i++) {
        c[i] = a[i] + sign * b[i];
    }
}

/* a = I - a */
static void from_identity(double *a, int n)
{
    for (int i = 0; i < n * n; i++) {
        a[i] = -a[i];
    }
    for (int i = 0; i < n; i++) {
        a[i * n + i] += 1;
    }
}

/* Inverse of the symmetric A by its Cholesky factor: factor, invert the factor, multiply it by its transpose. Returns 1
 * when a pivot is not positive. */
static int invert(const double *A, double *a, double *diagonal, int n)
{
    memcpy(a, A, (size_t)(n * n) * sizeof *a);
    for (int i = 0; i < n; i++) {
        for (int j = i; j < n; j++) {
            double sum = a[i * n + j];
            for (int k = i - 1; k >= 0; k--) {
                sum -= a[i * n + k] * a[j * n + k];
            }
            if (i != j) {
                a[j * n + i] = sum / diagonal[i];
            } else if (sum <= 0) {
                return 1;
            } else {
                diagonal[i] = sqrt(sum);
            }
        }
    }
    for (int i = 0; i < n; i++) {
        a[i * n + i] = 1 / diagonal[i];
        for (int j = i + 1; j < n; j++) {
            double sum = 0;
            for (int k = i; k < j; k++) {
                sum -= a[j * n + k] * a[k * n + i];
            }
            a[j * n + i] = sum / diagonal[j];
        }
    }
    for (int i = 0; i < n; i++) {
        for (int j = i; j < n; j++) {
            double sum = 0;
            for (int k = j; k < n; k++) {
                sum += a[k * n + i] * a[k * n + j];
            }
            a[i * n + j] = sum;
        }
        for (int j = 0; j < i; j++) {
            a[i * n + j] = a[j * n + i];
        }
    }
    return 0;
}

/* The boat's step, but for z. */
static void boat_step(tinyekf_step_t *step, const double x[3], double u, double rate, double dt, const double q[3],
                      const double r[3])
{
    const double north = dt * u * cos(x[2]);
    const double east = dt * u * sin(x[2]);
    step->fx[0] = x[0] + north;
    step->fx[1] = x[1] + east;
    step->fx[2] = x[2] + dt * rate;
    for (int i = 0; i < 3; i++) {
        for (int j = 0; j < 3; j++) {
            const int k = 3 * i + j;
            step->F[k] = step->H[k] = i == j;
            step->Q[k] = i == j ? q[i] * dt : 0;
            step->R[k] = i == j ? r[i] : 0;
        }
    }
    step->F[2] = -east;
    step->F[5] = north;
}

#endif
