/* What each kind of sample does to the fusion, which has moved to its moment: fusion.c alone calls these. */
#ifndef FUSION_INTAKE_H
#define FUSION_INTAKE_H

#include "fusion.h"

/* Takes an epoch of receiver i (from 0). */
fusion_verdict_t fusion_take_gps(fusion_t *fusion, int i, const sample_t *sample);

fusion_verdict_t fusion_take_compass(fusion_t *fusion, const sample_t *sample);

fusion_verdict_t fusion_take_imu(fusion_t *fusion, const sample_t *sample);

#endif
