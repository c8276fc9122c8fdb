// Where tools are within a step.
#pragma once
#include "layout.cuh"

__device__ inline Vec vec(const float* v) { return {v[0], v[1], v[2]}; }
__device__ inline Vec vec(const float4& v) { return {v.x, v.y, v.z}; }

// A tool at an instant of the step.
struct View {
    double at[3];
    Quat turn;
};

__device__ inline View view_of(const ToolStep& tool, float t) {
    View view;
    for (int a = 0; a < 3; ++a) view.at[a] = t >= 1.0f ? tool.to[a] : tool.from[a] + (tool.to[a] - tool.from[a]) * double(t);
    view.turn = turn_by(vec(tool.turn) * t) * Quat{tool.turn_from[0], tool.turn_from[1], tool.turn_from[2], tool.turn_from[3]};
    return view;
}

// A rest position seen from a tool's origin: large numbers subtract in double precision.
__device__ inline Vec from_tool(const Vec& rest, const View& view) {
    return {float(double(rest.x) - view.at[0]), float(double(rest.y) - view.at[1]), float(double(rest.z) - view.at[2])};
}
