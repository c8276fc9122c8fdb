// What the lattice is compared with on a GPU: Etheredge 2011, algorithm 3, with the arrays of its section 4.5. One thread for each mass.

#include <cstdint>

namespace baseline_kernel {

constexpr uint32_t NO_MASS = ~0u;

// Flags of a mass; its material is in the bits from MATERIAL_SHIFT on.
constexpr uint32_t ACTIVE = 1;
// Pulls at its neighbours as an active one, but stays.
constexpr uint32_t HELD = 2;
constexpr uint32_t MATERIAL_SHIFT = 8;

// Spring data: N_i(k) and its rest length.
struct alignas(8) Spring {
    uint32_t other;
    float rest;
};

// A sphere, centre and radius, at the start of a graph; how far it moves in a step; and the sum of the spring forces that it feels.
struct Tool {
    float4 sphere;
    float move[4];
    float felt[4];
};

struct Setting {
    uint32_t masses;
    float dt;
    float damping;
    float gravity[3];
};

}  // namespace baseline_kernel
using namespace baseline_kernel;

// Step number `step` of a graph. `before` holds x(t - dt) and is given x(t + dt): nobody but its own thread reads it. Springs lie `springs[k * masses + i]`, so that
// neighbouring threads read neighbouring words.
extern "C" __global__ void __launch_bounds__(256)
    algorithm3(Setting setting, uint32_t step, const float4* __restrict__ now, float4* __restrict__ before, const Spring* __restrict__ springs,
               const uint32_t* __restrict__ properties, const float* __restrict__ stiffness, Tool* tool) {
    const uint32_t i = blockIdx.x * blockDim.x + threadIdx.x;
    if (i >= setting.masses) return;
    const float4 x = now[i];
    const uint32_t p = properties[i];
    if (!(p & ACTIVE) || (p & HELD)) {
        before[i] = x;
        return;
    }

    const float k_of_material = stiffness[p >> MATERIAL_SHIFT];
    float force[3] = {0.0f, 0.0f, 0.0f};
    for (uint32_t k = 0; k < 26; ++k) {
        const Spring spring = springs[k * size_t(setting.masses) + i];
        if (spring.other == NO_MASS) continue;
        if (!(properties[spring.other] & ACTIVE)) continue;
        const float4 y = now[spring.other];
        const float l[3] = {y.x - x.x, y.y - x.y, y.z - x.z};
        const float length = sqrtf(l[0] * l[0] + l[1] * l[1] + l[2] * l[2]);
        const float scale = k_of_material * (length - spring.rest) / length * 0.5f;
        for (int a = 0; a < 3; ++a) force[a] += scale * l[a];
    }

    const float4 old = before[i];
    const float at[3] = {x.x, x.y, x.z}, was[3] = {old.x, old.y, old.z};
    float next[3];
    for (int a = 0; a < 3; ++a) {
        const float f = force[a] - setting.damping * (at[a] - was[a]) / setting.dt + setting.gravity[a];
        next[a] = 2.0f * at[a] - was[a] + 0.5f * f * setting.dt * setting.dt;
    }

    // Collision handling: a mass inside the tool is moved to its surface, and the tool feels the springs of that mass.
    const float4 sphere = tool->sphere;
    const float centre[3] = {sphere.x + step * tool->move[0], sphere.y + step * tool->move[1], sphere.z + step * tool->move[2]};
    const float d[3] = {next[0] - centre[0], next[1] - centre[1], next[2] - centre[2]};
    const float distance2 = d[0] * d[0] + d[1] * d[1] + d[2] * d[2];
    if (distance2 < sphere.w * sphere.w && distance2 > 0.0f) {
        const float out = sphere.w * rsqrtf(distance2);
        for (int a = 0; a < 3; ++a) {
            next[a] = centre[a] + out * d[a];
            atomicAdd(&tool->felt[a], force[a]);
        }
    }
    before[i] = make_float4(next[0], next[1], next[2], 0.0f);
}
