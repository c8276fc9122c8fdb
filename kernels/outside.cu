// What acts on the tissue besides tools, after every substep: loads, and rigid regions that are driven. And kinetic damping, by which it settles.
#include "layout.cuh"
#include "outside.cuh"

namespace outside_kernel {

// Threads of a block, and of the one block that judges.
constexpr int THREADS = 128, JUDGE_THREADS = 1024;

// Whether this substep went wrong, or one before it: then its state is as good as gone.
__device__ bool is_lost(const Pass& pass) { return *pass.diverged_at <= pass.substep; }

}  // namespace outside_kernel
using namespace outside_kernel;

// Loads: one thread gathers all that push one node.
extern "C" __global__ void __launch_bounds__(THREADS) push(const __grid_constant__ Pass pass, const __grid_constant__ Push loads) {
    const uint32_t i = blockIdx.x * THREADS + threadIdx.x;
    if (i >= loads.count || is_lost(pass)) return;
    const Pushed node = loads.nodes[i];
    // Before this substep, so that faces do not see what loads do in it.
    const Triple force = force_on(loads, node, [&](uint32_t slot) -> Triple {
        const float4 u = pass.u[slot];
        return {u.x, u.y, u.z};
    });
    const Step& step = *pass.step;
    const double kick = step.dt * step.keep;
    const Vec dv{float(force.x * node.mobility[0] * kick), float(force.y * node.mobility[1] * kick), float(force.z * node.mobility[2] * kick)};
    const size_t at = velocity_at(node.slot);
    pass.v_next[at] += dv.x;
    pass.v_next[at + BRICK_NODES] += dv.y;
    pass.v_next[at + 2 * BRICK_NODES] += dv.z;
    const float4 u = pass.u_next[node.slot];
    pass.acted_on[node.slot / BRICK_NODES] = 1;
    pass.u_next[node.slot] = make_float4(u.x + dv.x * step.dt, u.y + dv.y * step.dt, u.z + dv.z * step.dt, u.w);
}

// Regions: one thread takes one node to where its region is after this substep.
extern "C" __global__ void __launch_bounds__(THREADS) drive(const __grid_constant__ Pass pass, const __grid_constant__ Drive regions) {
    const uint32_t i = blockIdx.x * THREADS + threadIdx.x;
    if (i >= regions.count || is_lost(pass)) return;
    const Driven node = regions.nodes[i];
    const Motion motion = regions.motions[(pass.substep - 1) * regions.regions + node.region];
    const Triple there = place_of(node, motion);
    const Vec moved{float(there.x), float(there.y), float(there.z)};
    const float4 u = pass.u[node.slot];
    const Vec v = (moved - Vec{u.x, u.y, u.z}) * (1.0f / pass.step->dt);
    const size_t at = velocity_at(node.slot);
    pass.v_next[at] = v.x;
    pass.v_next[at + BRICK_NODES] = v.y;
    pass.v_next[at + 2 * BRICK_NODES] = v.z;
    pass.acted_on[node.slot / BRICK_NODES] = 1;
    pass.u_next[node.slot] = make_float4(moved.x, moved.y, moved.z, u.w);
}

// Kinetic damping: one block sums up m v², and where that falls says so by a 0. From rest the next kick is half a one, for velocities lag by half
// a substep. There is no drag while the tissue settles.
extern "C" __global__ void __launch_bounds__(JUDGE_THREADS) judge(const __grid_constant__ Pass pass, uint32_t bricks, Step* step) {
    __shared__ double sums[JUDGE_THREADS];
    if (is_lost(pass)) return;
    double sum = 0.0;
    for (uint32_t i = threadIdx.x; i < bricks; i += JUDGE_THREADS) sum += pass.marks[i].vis_viva;
    sums[threadIdx.x] = sum;
    for (int half = JUDGE_THREADS / 2; half > 0; half /= 2) {
        __syncthreads();
        if (threadIdx.x < half) sums[threadIdx.x] += sums[threadIdx.x + half];
    }
    if (threadIdx.x == 0) {
        const float now = float(sums[0]), left = now < step->vis_viva ? 0.0f : now;
        step->vis_viva = left;
        step->keep = left == 0.0f ? 0.5f : 1.0f;
    }
}

// Then all velocities are cleared, a block for each brick, and with them what is reported of m v².
extern "C" __global__ void __launch_bounds__(BRICK_NODES) halt(const __grid_constant__ Pass pass) {
    if (is_lost(pass) || pass.step->vis_viva != 0.0f) return;
    for (int axis = 0; axis < 3; ++axis) pass.v_next[(blockIdx.x * 3 + axis) * size_t(BRICK_NODES) + threadIdx.x] = 0.0f;
    if (threadIdx.x == 0) pass.marks[blockIdx.x].vis_viva = 0.0f;
}
