// Points of the surface in contact, and the sites that they lie on.
#pragma once
#include "layout.cuh"
#include "tool.cuh"

// Of a point's mobility, how much must belong to free nodes for the point to count as movable.
constexpr float MOVABLE = 1e-3f;
// Most points of one site: more tools than that do not meet in one place.
constexpr uint32_t MOST_OF_SITE = 7;
constexpr uint16_t NOT_ACTIVE = 0xffff;

__device__ inline float4 with(const Vec& v, float w) { return make_float4(v.x, v.y, v.z, w); }

// How fast a tool moves at `at`, seen from its origin.
__device__ inline Vec velocity_of(const ToolStep& tool, const Vec& at, float duration) {
    const Vec linear{float(tool.to[0] - tool.from[0]), float(tool.to[1] - tool.from[1]), float(tool.to[2] - tool.from[2])};
    return (linear + cross(vec(tool.turn), at)) * (1.0f / duration);
}

// Which sites are active, in their order: the site, its first point, and what a site is among them.
struct Active {
    uint16_t site[MAX_POINTS], first[MAX_POINTS + 1], of[MAX_SITES];
};
