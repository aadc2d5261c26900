/* The path cost of auvplan.path.cost.score in C, one thread, single precision.
 *
 * Paths are scored LANES at a time, one path a vector lane, and their samples in chunks of ROWS, so that the
 * planes [ROWS + 1, LANES] stay in the first-level cache. Row 0 of a plane is the last row of the chunk
 * before.
 *
 * Compile with -O3 -march=native -ffast-math -fno-associative-math. */
#include <stdint.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#define LANES 16
#define ROWS 16
#define TINY 1e-8f
#define FAR 1e6f
#define SPEED_FLOOR 0.05f
#define CLEARANCE_SCALE 50.0f
#define LIMITS 7
#define PI 3.14159265f

typedef struct {
    int32_t samples, controls, order, vortices, obstacles, north, east;
    float depart;
    float speed, surge_max, sway_max, turn_rate_max, pitch_speed; /* |v| sin(pitch_max), m/s */
    float coast_margin, obstacle_margin, uncertain_price, chart_error;
    float origin_north, origin_east, pixel_size, straight;
    float uniform[3], weights[LIMITS];
    const int32_t *first;    /* [samples], first control point that a sample depends on */
    const float *basis;      /* [samples, order], weights of the control points from there on */
    const int32_t *first_step; /* [samples], first control point that the way to a sample depends on */
    const float *step;       /* [samples, order], weights of the polygon's sides in the way from the sample before */
    const float *ends;       /* [2, 3] m, start and goal */
    const float *vortex;     /* [vortices, 5]: north, east, -log2(e) / (2 radius^2), scale, vertical scale */
    const float *obstacle;   /* [obstacles, 10]: position, velocity, growth, growth_max, observed_at,
                                boundary */
    const float *chart;      /* [north, east, 2]: signed distance m, passability */
} Problem;

typedef float Row[LANES] __attribute__((aligned(64)));
typedef Row Plane[ROWS + 1];
typedef float Four __attribute__((vector_size(16)));

#define EACH(r, from, count) for (int r = (from); r <= (count); r++) for (int l = 0; l < LANES; l++)

static inline float largest(float a, float b) { return a > b ? a : b; }
static inline float least(float a, float b) { return a < b ? a : b; }
static inline float square(float a) { return a * a; }

/* Odd polynomial for the arctangent on [0, 1], as in auvplan.path.kinematics. */
static const float ARCTANGENT[8] = {
    0.9999999011f, -0.3333199117f, 0.1996972852f, -0.1401950283f,
    0.0991434463f, -0.0594870867f, 0.0242528623f, -0.0046933976f,
};

/* 2^x for x <= 0. */
static inline float power_of_two(float x) {
    x = largest(x, -126.0f);
    int32_t whole = (int32_t)(x - 0.5f);
    float f = x - (float)whole;
    float p = 1.326697039e-3f;
    p = p * f + 9.675459746e-3f;
    p = p * f + 5.550742616e-2f;
    p = p * f + 2.402212175e-1f;
    p = p * f + 6.931469492e-1f;
    p = p * f + 1.0f;
    int32_t bits = (whole + 127) << 23;
    float scale;
    memcpy(&scale, &bits, sizeof scale);
    return p * scale;
}

typedef struct {
    Plane x, y, z, t, dx, dy, dz, gap, level, u, v, w, duration, coast, risk, clear;
    Row excess[LIMITS], price;
} Block;

static void positions(const Problem *q, Block *b, const Row *control, int sample, int from, int count) {
    int points = q->controls + 2;
    for (int r = from; r <= count; r++) {
        const float *weight = q->basis + (sample + r) * q->order;
        const Row *near = control + q->first[sample + r];
        Row x = {0}, y = {0}, z = {0};
        for (int k = 0; k < q->order; k++)
            for (int l = 0; l < LANES; l++) {
                x[l] += weight[k] * near[k][l];
                y[l] += weight[k] * near[points + k][l];
                z[l] += weight[k] * near[2 * points + k][l];
            }
        memcpy(b->x[r], x, sizeof x);
        memcpy(b->y[r], y, sizeof y);
        memcpy(b->z[r], z, sizeof z);
    }
}

/* Ways from sample to sample, as products of the polygon's sides: differences of positions would lose digits. */
static void ways(const Problem *q, Block *b, const Row *control, int sample, int count) {
    int points = q->controls + 2;
    for (int r = 1; r <= count; r++) {
        const float *weight = q->step + (sample + r) * q->order;
        const Row *near = control + q->first_step[sample + r];
        Row x = {0}, y = {0}, z = {0};
        for (int k = 0; k < q->order; k++)
            for (int l = 0; l < LANES; l++) {
                x[l] += weight[k] * (near[k + 1][l] - near[k][l]);
                y[l] += weight[k] * (near[points + k + 1][l] - near[points + k][l]);
                z[l] += weight[k] * (near[2 * points + k + 1][l] - near[2 * points + k][l]);
            }
        memcpy(b->dx[r], x, sizeof x);
        memcpy(b->dy[r], y, sizeof y);
        memcpy(b->dz[r], z, sizeof z);
    }
}

/* Current in the middle of each segment. */
static void current(const Problem *q, Block *b, int count) {
    Plane x, y;
    EACH(r, 1, count) {
        x[r][l] = 0.5f * (b->x[r][l] + b->x[r - 1][l]);
        y[r][l] = 0.5f * (b->y[r][l] + b->y[r - 1][l]);
        b->u[r][l] = q->uniform[0];
        b->v[r][l] = q->uniform[1];
        b->w[r][l] = q->uniform[2];
    }
    for (int k = 0; k < q->vortices; k++) {
        const float *one = q->vortex + 5 * k;
        const float north = one[0], east = one[1], rate = one[2], scale = one[3], vertical = one[4];
        const float to_q = -2.0f / 1.44269504f * rate;
        EACH(r, 1, count) {
            float dx = x[r][l] - north, dy = y[r][l] - east;
            float r2 = dx * dx + dy * dy, s = r2 * to_q;
            float half = power_of_two(r2 * rate);
            float series = 1.0f - s * (1.0f / 2 - s * (1.0f / 6 - s * (1.0f / 24 - s * (1.0f / 120))));
            float far = (1.0f - half * half) / s;
            float turn = scale * (s < 0.02f ? series : far);
            b->u[r][l] -= turn * dy;
            b->v[r][l] += turn * dx;
            b->w[r][l] += vertical * half;
        }
    }
}

/* Ways, speeds over ground and arrival times. */
static void kinematics(const Problem *q, Block *b, int count) {
    const float speed = q->speed, floor = SPEED_FLOOR * speed;
    const float per_surge = 1.0f / q->surge_max, per_sway = 1.0f / q->sway_max, per_speed = 1.0f / speed;
    const float per_pitch = 1.0f / q->pitch_speed;
    EACH(r, 1, count) {
        float dx = b->dx[r][l], dy = b->dy[r][l], dz = b->dz[r][l];
        float u = b->u[r][l], v = b->v[r][l], w = b->w[r][l];
        float level = dx * dx + dy * dy, gap = sqrtf(level + dz * dz + TINY);
        float along = (u * dx + v * dy + w * dz) / gap;
        float across = sqrtf(largest(u * u + v * v + w * w - along * along, 0.0f) + TINY);
        float beaten = largest(across - (1.0f - SPEED_FLOOR * SPEED_FLOOR) * speed, 0.0f);
        float progress = along + sqrtf(largest((speed - across) * (speed + across), floor * floor));
        float ground = largest(progress, floor), duration = gap / ground;
        b->gap[r][l] = gap;
        b->level[r][l] = level;
        b->duration[r][l] = duration;
        b->t[r][l] = b->t[r - 1][l] + duration;
        b->excess[0][l] += largest(ground * per_surge - 1.0f, 0.0f);
        b->excess[1][l] += largest(across * per_sway - 1.0f, 0.0f);
        b->excess[5][l] += (largest(floor - progress, 0.0f) + beaten) * per_speed;
        b->excess[6][l] += largest(fabsf(dz / duration - w) * per_pitch - 1.0f, 0.0f);
    }
}

static void turns(const Problem *q, Block *b, int from, int count) {
    const float per_rate = 1.0f / q->turn_rate_max;
    EACH(r, from, count) {
        float dx = b->dx[r][l], dy = b->dy[r][l], px = b->dx[r - 1][l], py = b->dy[r - 1][l];
        float aside = fabsf(px * dy - py * dx), dot = px * dx + py * dy, ahead = fabsf(dot);
        float share = least(aside, ahead) / largest(largest(aside, ahead), TINY), s = share * share;
        float angle = ARCTANGENT[7];
        for (int k = 6; k >= 0; k--) angle = angle * s + ARCTANGENT[k];
        angle *= share;
        angle = aside > ahead ? 0.5f * PI - angle : angle;
        angle = dot < 0.0f ? PI - angle : angle;
        angle *= 1.0f - TINY / (aside * aside + dot * dot + TINY);
        /* over the mean of both durations */
        float rate = 2.0f * angle / (b->duration[r - 1][l] + b->duration[r][l]);
        b->excess[2][l] += largest(rate * per_rate - 1.0f, 0.0f);
    }
}

/* Distance to the coast and risk at every sample. Distance and passability of two neighbours lie side by
 * side: two loads of four numbers fetch all that a sample needs. */
static void chart(const Problem *q, Block *b, int from, int count) {
    const float per_pixel = 1.0f / q->pixel_size, last_i = q->north - 1.0f, last_j = q->east - 1.0f;
    const float high_x = q->origin_north + q->pixel_size * q->north;
    const float high_y = q->origin_east + q->pixel_size * q->east;
    const int32_t most_i = q->north - 2, most_j = q->east - 2, down = 2 * q->east;
    for (int r = from; r <= count; r++) {
        int32_t corner[LANES];
        Row part_i, part_j;
        Four mixed[LANES];
        for (int l = 0; l < LANES; l++) {
            float x = b->x[r][l], y = b->y[r][l];
            float i = least(largest((x - q->origin_north) * per_pixel - 0.5f, 0.0f), last_i);
            float j = least(largest((y - q->origin_east) * per_pixel - 0.5f, 0.0f), last_j);
            int32_t i0 = (int32_t)i, j0 = (int32_t)j;
            i0 = i0 < most_i ? i0 : most_i;
            j0 = j0 < most_j ? j0 : most_j;
            corner[l] = i0 * down + 2 * j0;
            part_i[l] = i - (float)i0;
            part_j[l] = j - (float)j0;
        }
        for (int l = 0; l < LANES; l++) {
            Four low, high;
            memcpy(&low, q->chart + corner[l], sizeof low);
            memcpy(&high, q->chart + corner[l] + down, sizeof high);
            mixed[l] = low + part_i[l] * (high - low);
        }
        for (int l = 0; l < LANES; l++) {
            float out_x = b->x[r][l] - least(largest(b->x[r][l], q->origin_north), high_x);
            float out_y = b->y[r][l] - least(largest(b->y[r][l], q->origin_east), high_y);
            float distance = mixed[l][0] + part_j[l] * (mixed[l][2] - mixed[l][0]);
            float passable = mixed[l][1] + part_j[l] * (mixed[l][3] - mixed[l][1]);
            b->coast[r][l] = distance - sqrtf(out_x * out_x + out_y * out_y) - q->chart_error;
            b->risk[r][l] = 1.0f - passable;
        }
    }
}

/* Between two samples no land lies within the circles around them. */
static void coast(const Problem *q, Block *b, int count) {
    EACH(r, 1, count) {
        float first = b->coast[r - 1][l], last = b->coast[r][l], gap = sqrtf(b->level[r][l] + TINY);
        float apart = 0.5f * (first + last - gap), ends = least(first, last);
        float aside = (first * first - last * last + gap * gap) / (2.0f * gap);
        float half_chord = sqrtf(largest(first * first - aside * aside, 0.0f) + TINY);
        float crossed = (aside > 0.0f) & (aside < gap) ? least(half_chord, ends) : ends;
        float clear = apart > 0.0f ? crossed : apart;
        b->excess[3][l] += largest(q->coast_margin - clear, 0.0f);
        b->price[l] += 0.5f * (b->risk[r][l] + b->risk[r - 1][l]) * b->duration[r][l];
    }
}

/* Clearance at the time of arrival: seen from a sphere every segment is a straight line. */
static void obstacles(const Problem *q, Block *b, int count) {
    Plane x, y, z;
    EACH(r, 1, count) b->clear[r][l] = FAR;
    for (int m = 0; m < q->obstacles; m++) {
        const float *o = q->obstacle + 10 * m;
        const float px = o[0], py = o[1], pz = o[2], vx = o[3], vy = o[4], vz = o[5];
        const float growth = o[6], growth_max = o[7], seen = o[8], boundary = o[9];
        EACH(r, 0, count) {
            float since = b->t[r][l] - seen;
            x[r][l] = b->x[r][l] - px - vx * since;
            y[r][l] = b->y[r][l] - py - vy * since;
            z[r][l] = b->z[r][l] - pz - vz * since;
        }
        EACH(r, 1, count) {
            float fx = x[r - 1][l], fy = y[r - 1][l], fz = z[r - 1][l];
            float dx = x[r][l] - fx, dy = y[r][l] - fy, dz = z[r][l] - fz;
            float share = -(fx * dx + fy * dy + fz * dz) / (dx * dx + dy * dy + dz * dz + TINY);
            share = least(largest(share, 0.0f), 1.0f);
            float r2 = square(fx + share * dx) + square(fy + share * dy) + square(fz + share * dz);
            float grown = least(growth * largest(b->t[r][l] - seen, 0.0f), growth_max);
            b->clear[r][l] = least(b->clear[r][l], sqrtf(r2 + TINY) - grown - boundary);
        }
    }
    EACH(r, 1, count) b->excess[4][l] += largest(q->obstacle_margin - b->clear[r][l], 0.0f);
}

static void carry(Block *b, int count) {
    Plane *planes[] = {&b->x,  &b->y,     &b->z,        &b->t,     &b->dx,
                       &b->dy, &b->level, &b->duration, &b->coast, &b->risk};
    for (size_t k = 0; k < sizeof planes / sizeof *planes; k++)
        memcpy((*planes[k])[0], (*planes[k])[count], sizeof(Row));
}

/* Cost s and violation [lanes] of up to LANES paths of [paths, 3 * controls] m. */
static void score_block(const Problem *q, const float *habitats, int lanes, Row *control, float *cost,
                        float *violation) {
    Block b;
    int points = q->controls + 2, width = 3 * q->controls, segments = q->samples - 1;
    for (int axis = 0; axis < 3; axis++)
        for (int l = 0; l < LANES; l++) {
            const float *one = habitats + (l < lanes ? l : 0) * width + axis * q->controls;
            control[axis * points][l] = q->ends[axis];
            for (int k = 0; k < q->controls; k++) control[axis * points + 1 + k][l] = one[k];
            control[axis * points + points - 1][l] = q->ends[3 + axis];
        }
    memset(b.excess, 0, sizeof b.excess);
    memset(b.price, 0, sizeof b.price);
    for (int l = 0; l < LANES; l++) b.t[0][l] = q->depart;
    for (int done = 0; done < segments; done += ROWS) {
        int count = segments - done < ROWS ? segments - done : ROWS;
        int from = done == 0 ? 0 : 1;
        positions(q, &b, control, done, from, count);
        ways(q, &b, control, done, count);
        current(q, &b, count);
        kinematics(q, &b, count);
        turns(q, &b, done == 0 ? 2 : 1, count);
        chart(q, &b, from, count);
        coast(q, &b, count);
        obstacles(q, &b, count);
        carry(&b, count);
    }
    for (int l = 0; l < lanes; l++) {
        float total = 0.0f, weighted = 0.0f;
        for (int k = 0; k < LIMITS; k++) {
            float unit = (k == 3 || k == 4 ? 1.0f / CLEARANCE_SCALE : 1.0f) / segments;
            total += unit * b.excess[k][l];
            weighted += q->weights[k] * unit * b.excess[k][l];
        }
        cost[l] = b.t[0][l] - q->depart + q->uncertain_price * b.price[l] + q->straight * weighted;
        violation[l] = total;
    }
}

/* Cost s and violation of habitats [paths, 3 * controls] m; 0, or 1 where memory runs out. */
int score(const Problem *q, const float *habitats, int paths, float *cost, float *violation) {
    Row *control = aligned_alloc(sizeof(Row), 3 * (q->controls + 2) * sizeof(Row));
    if (control)
        for (int p = 0; p < paths; p += LANES) {
            int lanes = paths - p < LANES ? paths - p : LANES;
            score_block(q, habitats + p * 3 * q->controls, lanes, control, cost + p, violation + p);
        }
    free(control);
    return !control;
}
