/* Positions of the PCC chain as one would write them in C: a peer to measure the batched numpy against. */
#include <math.h>

static void tangent(const double *q, double *t)
{
    t[0] = 2.0 * (q[0] * q[2] + q[1] * q[3]);
    t[1] = 2.0 * (q[1] * q[2] - q[0] * q[3]);
    t[2] = 1.0 - 2.0 * (q[0] * q[0] + q[1] * q[1]);
}

/* stations: sweeps x (sections + 1) x 4, x y z w; positions: sweeps x (sections * links + 2) x 3, the base first.
 * Each section has `links` links of `length`, oriented as slerp at (2k + 1) / 2n; one more of `rest` goes straight on. */
void pcc_positions(const double *stations, int sweeps, int sections, int links, double length, double rest,
                   double *positions)
{
    for (int sweep = 0; sweep < sweeps; sweep++) {
        double p[3] = {0.0, 0.0, 0.0}, q[4], t[3];
        for (int c = 0; c < 3; c++)
            *positions++ = p[c];
        for (int section = 0; section < sections; section++, stations += 4) {
            const double *a = stations, *b = stations + 4;
            double dot = a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3];
            double sign = dot < 0.0 ? -1.0 : 1.0;
            double angle = acos(fmin(sign * dot, 1.0));
            double sine = sin(angle);
            for (int k = 0; k < links; k++) {
                double at = (2 * k + 1) / (2.0 * links);
                double wa = 1.0 - at, wb = at;
                if (angle > 1e-7) {
                    wa = sin((1.0 - at) * angle) / sine;
                    wb = sin(at * angle) / sine;
                }
                for (int c = 0; c < 4; c++)
                    q[c] = wa * a[c] + wb * sign * b[c];
                tangent(q, t);
                for (int c = 0; c < 3; c++)
                    *positions++ = p[c] += length * t[c];
            }
        }
        tangent(stations, t);
        for (int c = 0; c < 3; c++)
            *positions++ = p[c] + rest * t[c];
        stations += 4;
    }
}
