// What contact is made of: shapes, poses and the points that touch. Twins of src/solver/tool.rs; plain C++ as well as CUDA.
#pragma once
#include "law.cuh"
#include <math.h>

struct Vec {
    float x, y, z;
};

PLP_LAW Vec operator+(Vec a, Vec b) { return {a.x + b.x, a.y + b.y, a.z + b.z}; }
PLP_LAW Vec operator-(Vec a, Vec b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
PLP_LAW Vec operator*(Vec a, float s) { return {a.x * s, a.y * s, a.z * s}; }
PLP_LAW float dot(Vec a, Vec b) { return a.x * b.x + (a.y * b.y + a.z * b.z); }
PLP_LAW Vec cross(Vec a, Vec b) { return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x}; }
PLP_LAW float norm(Vec a) { return sqrtf(dot(a, a)); }
PLP_LAW float clamp(float x, float low, float high) { return fminf(fmaxf(x, low), high); }

// A unit quaternion x y z w.
struct Quat {
    float x, y, z, w;
};

PLP_LAW Vec rotate(Quat q, Vec v) {
    const Vec axis{q.x, q.y, q.z};
    const Vec t = cross(axis, v) * 2.0f;
    return v + t * q.w + cross(axis, t);
}
PLP_LAW Quat conjugate(Quat q) { return {-q.x, -q.y, -q.z, q.w}; }
PLP_LAW Quat operator*(Quat a, Quat b) {
    return {a.w * b.x + a.x * b.w + a.y * b.z - a.z * b.y, a.w * b.y - a.x * b.z + a.y * b.w + a.z * b.x,
            a.w * b.z + a.x * b.y - a.y * b.x + a.z * b.w, a.w * b.w - a.x * b.x - a.y * b.y - a.z * b.z};
}
// The turn by a rotation vector: a power series for a turn of up to a radian; a larger one is halved first and put together again.
PLP_LAW Quat turn_by(Vec v) {
    int halvings = 0;
    for (; dot(v, v) > 1.0f; ++halvings) v = v * 0.5f;
    const float x = dot(v, v);
    const float s = 0.5f - x * (1.0f / 48.0f - x * (1.0f / 3840.0f - x * (1.0f / 645120.0f)));
    const float c = 1.0f - x * (1.0f / 8.0f - x * (1.0f / 384.0f - x * (1.0f / 46080.0f - x * (1.0f / 10321920.0f))));
    Quat q{v.x * s, v.y * s, v.z * s, c};
    for (; halvings > 0; --halvings) q = q * q;
    return q;
}

enum Shape { SPHERE = 0, CAPSULE = 1, BOX = 2 };

// One shape of a tool, in the tool's frame.
struct Part {
    Quat turn;
    Vec at;
    int shape;
    // Radius; radius and half length; half extents and rounding.
    float size[4];
};

// A signed distance (negative inside) and the outward unit normal.
struct Distance {
    float distance;
    Vec normal;
};

// To a ball of radius `r` around the nearest core point, `d` away from it. At the very centre every direction leads out.
PLP_LAW Distance from_core(Vec d, float r) {
    const float length = norm(d);
    return {length - r, length > 0.0f ? d * (1.0f / length) : Vec{0, 0, 1}};
}

// From a point of the part's own frame.
PLP_LAW Distance shape_distance(const Part& part, Vec p) {
    if (part.shape == SPHERE) return from_core(p, part.size[0]);
    if (part.shape == CAPSULE) return from_core({p.x, p.y, p.z - clamp(p.z, -part.size[1], part.size[1])}, part.size[0]);
    const float round = part.size[3];
    const Vec half{part.size[0], part.size[1], part.size[2]};
    const Vec core{half.x - round, half.y - round, half.z - round};
    const Vec outside{p.x - clamp(p.x, -core.x, core.x), p.y - clamp(p.y, -core.y, core.y), p.z - clamp(p.z, -core.z, core.z)};
    if (dot(outside, outside) > 0.0f) return from_core(outside, round);
    // Inside the core: out through the nearest face.
    const float dx = half.x - fabsf(p.x), dy = half.y - fabsf(p.y), dz = half.z - fabsf(p.z);
    if (dx <= dy && dx <= dz) return {-dx, {p.x < 0.0f ? -1.0f : 1.0f, 0, 0}};
    if (dy <= dz) return {-dy, {0, p.y < 0.0f ? -1.0f : 1.0f, 0}};
    return {-dz, {0, 0, p.z < 0.0f ? -1.0f : 1.0f}};
}

// And which part of a tool that is.
struct Nearest {
    float distance;
    Vec normal;
    int part;
};

// From a point of the tool's frame to the union of its parts.
PLP_LAW Nearest tool_distance(const Part* parts, int count, Vec p) {
    Nearest nearest{INFINITY, {0, 0, 1}, 0};
    for (int i = 0; i < count; ++i) {
        const Part& part = parts[i];
        Distance d = shape_distance(part, rotate(conjugate(part.turn), p - part.at));
        if (d.distance < nearest.distance) nearest = {d.distance, rotate(part.turn, d.normal), i};
    }
    return nearest;
}

// Into how many parts the edges of a triangle with this longest edge at rest are divided so that contact points resolve a part: none is longer than a
// third of its size.
PLP_LAW int part_division(const Part& part, float edge) {
    const float size = part.shape == BOX ? fminf(part.size[0], fminf(part.size[1], part.size[2])) : part.size[0];
#ifdef __CUDA_ARCH__
    // As precise as the host divides: it must find the same.
    const float thirds = __fdiv_rn(3.0f * edge, size);
#else
    const float thirds = 3.0f * edge / size;
#endif
    return int(clamp(ceilf(thirds), 1.0f, 32.0f));
}

// All such divisions for the parts within `reach` of a point, tool frame: bit n - 1 stands for n.
PLP_LAW unsigned tool_divisions(const Part* parts, int count, Vec p, float reach, float edge) {
    unsigned all = 0;
    for (int i = 0; i < count; ++i) {
        const Part& part = parts[i];
        const bool is_there = shape_distance(part, rotate(conjugate(part.turn), p - part.at)).distance < reach;
        if (is_there) all |= 1u << (part_division(part, edge) - 1);
    }
    return all;
}

// How a point that comes from `start` and would end at `end`, tool frame, meets the tool: how far its end lies beyond the plane of the part that
// it meets first (negative), and that plane's normal. At the end alone, a point that went past the middle of a thin tool would be
// pushed out on the wrong side, and one that went through would be missed; one that came no further than a stride can do neither.
PLP_LAW Nearest meet(const Part* parts, int count, Vec start, Vec end, float strides) {
    const float steps = clamp(ceilf(strides), 1.0f, 64.0f);
    for (float step = strides > 1.0f ? 0.0f : steps; step <= steps; step += 1.0f) {
        const Vec at = step < steps ? start + (end - start) * (step / steps) : end;
        const Nearest met = tool_distance(parts, count, at);
        if (met.distance < 0.0f) return {met.distance + dot(met.normal, end - at), met.normal, met.part};
    }
    return {INFINITY, {0, 0, 1}, 0};
}
