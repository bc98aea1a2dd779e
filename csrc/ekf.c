/* The public functions of ekf.h. */
#define EKF_PUBLIC
#include "ekf_inline.h"
