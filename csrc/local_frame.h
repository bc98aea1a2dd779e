/* Metres north and east of a local origin, on the WGS-84 radii at the origin's latitude. */
#ifndef LOCAL_FRAME_H
#define LOCAL_FRAME_H

typedef struct {
    double lat0;       /* rad */
    double lon0;       /* rad */
    double metres_lat; /* per radian of latitude: the meridian radius M */
    double metres_lon; /* per radian of longitude: N cos(lat0) */
} local_frame_t;

/* A frame with its origin at lat, lon (rad). */
void local_frame_set(local_frame_t *frame, double lat, double lon);

/* Position (rad) to metres in the frame. */
void local_frame_to_metres(const local_frame_t *frame, double lat, double lon, double *north, double *east);

/* Metres in the frame to position (rad; longitude in (-pi, pi]). */
void local_frame_to_position(const local_frame_t *frame, double north, double east, double *lat, double *lon);

#endif
