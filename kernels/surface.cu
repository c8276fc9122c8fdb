// Moves a surface's vertices with the nodes and computes its normals; see src/cpu/surface.rs.
#include "contact.cuh"
#include "layout.cuh"

namespace surface_kernel {

__device__ Vec turned(const Frame& frame, Vec v) {
    const float* r = frame.turn;
    return {r[0] * v.x + (r[1] * v.y + r[2] * v.z), r[3] * v.x + (r[4] * v.y + r[5] * v.z), r[6] * v.x + (r[7] * v.y + r[8] * v.z)};
}

// The eigenvalue of largest magnitude of a symmetric matrix (xx, yy, zz, xy, xz, yz), as a magnitude: the trigonometric solution of the
// characteristic cubic.
__device__ float largest_eigenvalue(const float m[6]) {
    const float mean = (m[0] + m[1] + m[2]) / 3.0f;
    const float a = m[0] - mean, b = m[1] - mean, c = m[2] - mean;
    const float off = m[3] * m[3] + m[4] * m[4] + m[5] * m[5];
    const float p = sqrtf((a * a + b * b + c * c + 2.0f * off) / 6.0f);
    if (p <= 1e-20f) return fabsf(mean);
    const float det = a * (b * c - m[5] * m[5]) - m[3] * (m[3] * c - m[5] * m[4]) + m[4] * (m[3] * m[5] - b * m[4]);
    const float angle = acosf(clamp(det / (2.0f * p * p * p), -1.0f, 1.0f)) / 3.0f;
    const float largest = mean + 2.0f * p * cosf(angle), smallest = mean + 2.0f * p * cosf(angle + 2.0943951023931953f);
    return fmaxf(fabsf(largest), fabsf(smallest));
}

// Largest principal magnitude of the mean Green strain of a cell, or of a piece of one.
__device__ float strain_of(const Surface& s, const uint32_t corners[8]) {
    float g[3][3] = {};
    for (int corner = 0; corner < 8; ++corner) {
        const float4 u = s.u[corners[corner]];
        const float sign[3] = {corner & 1 ? 1.0f : -1.0f, corner & 2 ? 1.0f : -1.0f, corner & 4 ? 1.0f : -1.0f};
        for (int axis = 0; axis < 3; ++axis) {
            g[0][axis] += sign[axis] * u.x;
            g[1][axis] += sign[axis] * u.y;
            g[2][axis] += sign[axis] * u.z;
        }
    }
    const float scale = 0.25f / s.frame.cell;
    for (auto& row : g) {
        for (float& x : row) x *= scale;
    }
    const auto green = [&](int i, int j) {
        return 0.5f * (g[i][j] + g[j][i] + g[0][i] * g[0][j] + g[1][i] * g[1][j] + g[2][i] * g[2][j]);
    };
    const float m[6] = {green(0, 0), green(1, 1), green(2, 2), green(0, 1), green(0, 2), green(1, 2)};
    return largest_eigenvalue(m);
}

}  // namespace surface_kernel
using namespace surface_kernel;

extern "C" __global__ void surface_positions(const __grid_constant__ Surface s) {
    const uint32_t vertex = blockIdx.x * blockDim.x + threadIdx.x;
    if (vertex >= s.vertices) return;
    Vec moved{0, 0, 0};
    for (int i = 0; i < 8; ++i) {
        const float4 u = s.u[s.row_nodes[8 * vertex + i]];
        moved = moved + Vec{u.x, u.y, u.z} * s.row_weights[8 * vertex + i];
    }
    const Vec world = turned(s.frame, moved);
    s.positions[vertex] = make_float4(s.rest[3 * vertex] + world.x, s.rest[3 * vertex + 1] + world.y, s.rest[3 * vertex + 2] + world.z, 1.0f);
    s.scalars[vertex] = s.strain ? strain_of(s, s.row_nodes + 8 * vertex) : norm(moved);
}

extern "C" __global__ void surface_normals(const __grid_constant__ Surface s) {
    const uint32_t vertex = blockIdx.x * blockDim.x + threadIdx.x;
    if (vertex >= s.vertices) return;
    const auto at = [&](uint32_t v) {
        const float4 p = s.positions[v];
        return Vec{p.x, p.y, p.z};
    };
    Vec sum{0, 0, 0};
    const uint2 fan = s.fans[vertex];
    for (uint32_t i = fan.x; i < fan.y; ++i) {
        const uint32_t* t = s.triangles + 3 * s.triangle_of[i];
        const Vec a = at(t[0]);
        sum = sum + cross(at(t[1]) - a, at(t[2]) - a);
    }
    const float length = norm(sum);
    const Vec n = length > 0.0f && length < INFINITY ? sum * (1.0f / length) : Vec{0, 0, 1};
    s.normals[vertex] = make_float4(n.x, n.y, n.z, 0.0f);
}
