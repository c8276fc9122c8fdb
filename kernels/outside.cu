// What acts on the tissue besides contact, after every substep: loads, rigid regions that are driven, and tools that hold nodes. And kinetic damping, by
// which it settles.
#include "layout.cuh"
#include "outside.cuh"
#include "tool.cuh"

namespace outside_kernel {

// Threads of a block, and of the one block that judges.
constexpr int THREADS = 128, JUDGE_THREADS = 1024;
// Of the one block that takes along what tools hold, and numbers of a tool's sums.
constexpr int HOLD_THREADS = 256, HOLD_WARPS = HOLD_THREADS / 32, SUMS = sizeof(ToolSum) / sizeof(double);

// Whether this substep went wrong, or one before it: then its state is as good as gone.
__device__ bool is_lost(const Pass& pass) { return *pass.diverged_at <= pass.substep; }

// Takes a node to a displacement, with the velocity that brings it there.
__device__ Vec move_to(const Pass& pass, uint32_t slot, const Vec& moved) {
    const float4 u = pass.u[slot];
    const Vec v = (moved - Vec{u.x, u.y, u.z}) * (1.0f / pass.step->dt);
    const size_t at = velocity_at(slot);
    pass.v_next[at] = v.x;
    pass.v_next[at + BRICK_NODES] = v.y;
    pass.v_next[at + 2 * BRICK_NODES] = v.z;
    pass.acted_on[slot / BRICK_NODES] = 1;
    pass.u_next[slot] = make_float4(moved.x, moved.y, moved.z, u.w);
    return v;
}

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
    move_to(pass, node.slot, moved);
}

// Tools that hold nodes: takes these to where their tool is after this substep, and begins the tools' sums with what that takes.
extern "C" __global__ void __launch_bounds__(HOLD_THREADS) hold(const __grid_constant__ Pass pass, const __grid_constant__ Hold held) {
    __shared__ double parts[SUMS][HOLD_WARPS];
    const Step& step = *pass.step;
    const uint32_t me = threadIdx.x, lane = me & 31, warp = me / 32;
    if (pass.substep == 1 && me < step.tool_count) held.sums[me] = ToolSum{};
    if (is_lost(pass)) return;
#pragma unroll 1
    for (uint32_t t = 0; t < step.tool_count; ++t) {
        const uint32_t start = held.starts[t], end = held.starts[t + 1];
        if (start == end) continue;
        const View view = view_of(step.tools[t], float(pass.substep) / float(held.substeps));
        double sums[SUMS]{};
        for (uint32_t i = start + me; i < end; i += HOLD_THREADS) {
            const Held node = held.nodes[i];
            const Vec arm = rotate(view.turn, vec(node.place));
            const Vec moved{float(view.at[0] - node.rest[0] + arm.x), float(view.at[1] - node.rest[1] + arm.y), float(view.at[2] - node.rest[2] + arm.z)};
            const size_t at = velocity_at(node.slot);
            const Vec free{pass.v_next[at], pass.v_next[at + BRICK_NODES], pass.v_next[at + 2 * BRICK_NODES]};
            const Vec v = move_to(pass, node.slot, moved), impulse = (v - free) * node.mass, moment = cross(arm, impulse);
            const double given[SUMS] = {-impulse.x, -impulse.y, -impulse.z, -moment.x, -moment.y, -moment.z, dot(impulse, v)};
            for (int n = 0; n < SUMS; ++n) sums[n] += given[n];
        }
        for (int n = 0; n < SUMS; ++n) {
            for (int half = 16; half > 0; half /= 2) sums[n] += __shfl_down_sync(~0u, sums[n], half);
            if (lane == 0) parts[n][warp] = sums[n];
        }
        __syncthreads();
        if (me < SUMS) {
            double sum = 0.0;
            for (int w = 0; w < HOLD_WARPS; ++w) sum += parts[me][w];
            reinterpret_cast<double*>(&held.sums[t])[me] += sum;
        }
        __syncthreads();
    }
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
