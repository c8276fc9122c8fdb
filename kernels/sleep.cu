// Quiet bricks fall asleep and stay as anchors for their neighbours; see src/cpu/sleep.rs for what it means. Now and then in a step, and at its end, one
// kernel decides who sleeps and who wakes, and one lists who is awake.
#include "layout.cuh"

namespace sleep_kernel {

constexpr int THREADS = 128;
// Substeps of quiet before a brick sleeps.
constexpr uint32_t QUIET_SUBSTEPS = 32;

// Leaves a brick where it is. The other copy of the displacements must say the same, for nobody writes it now.
__device__ void stop(const Pass& pass, uint32_t brick, uint32_t lane) {
    for (uint32_t node = lane; node < BRICK_NODES; node += 32) {
        const uint32_t slot = brick * BRICK_NODES + node;
        const_cast<float4*>(pass.u)[slot] = pass.u_next[slot];
        for (int axis = 0; axis < 3; ++axis) {
            const size_t at = velocity_at(slot) + axis * BRICK_NODES;
            const_cast<float*>(pass.v)[at] = pass.v_next[at] = 0.0f;
        }
    }
    // How it is strained goes on to count.
    Mark& mark = pass.marks[brick];
    if (lane == 0) mark.speed2 = mark.acceleration2 = mark.vis_viva = 0.0f;
}

}  // namespace sleep_kernel
using namespace sleep_kernel;

// `substeps` have passed since the last time; where none has, bricks only wake. A warp for each brick.
extern "C" __global__ void __launch_bounds__(THREADS) doze(const __grid_constant__ Pass pass, const __grid_constant__ Sleep sleep, uint32_t substeps) {
    const uint32_t thread = blockIdx.x * THREADS + threadIdx.x, brick = thread / 32, lane = thread % 32;
    // Counted anew by the kernel that follows.
    if (thread < SLEEP_COUNTS) sleep.counts[thread] = 0;
    if (brick >= sleep.bricks || *pass.diverged_at <= pass.substep) return;
    const uint32_t beside = pass.neighbours[brick * 27 + min(lane, 26)];
    // Pieces reach over to bricks that are no neighbours: where there are any, tissue stays awake.
    const bool has_pieces = pass.piece_bricks && pass.piece_bricks[beside] != NO_PLACE;
    const bool is_kept = __any_sync(~0u, pass.near_tools[beside] || pass.acted_on[beside] || has_pieces);
    const Mark mark = pass.marks[brick];
    const bool is_asleep = sleep.asleep[brick];
    uint32_t quiet = sleep.quiet[brick];
    __syncwarp();
    const bool is_quiet = mark.speed2 < sleep.speed2 && mark.acceleration2 < sleep.acceleration2;
    if (is_asleep) {
        if (lane == 0 && (is_kept || mark.acceleration2 > sleep.wake2)) sleep.asleep[brick] = 0;
        return;
    }
    if (substeps == 0 && !is_kept) return;
    quiet = is_quiet && !is_kept ? min(quiet + substeps, 255) : 0;
    const bool falls_asleep = quiet >= QUIET_SUBSTEPS;
    if (falls_asleep) stop(pass, brick, lane);
    if (lane > 0) return;
    sleep.quiet[brick] = falls_asleep ? 0 : quiet;
    sleep.asleep[brick] = falls_asleep;
}

// Lists in no order who is awake and who is watched: no brick hangs on another's place. What acts from outside keeps a brick awake as long as it acts.
extern "C" __global__ void __launch_bounds__(THREADS) muster(const __grid_constant__ Pass pass, const __grid_constant__ Sleep sleep) {
    const uint32_t brick = blockIdx.x * THREADS + threadIdx.x, lane = threadIdx.x & 31;
    const bool is_there = brick < sleep.bricks, is_awake = is_there && !sleep.asleep[brick];
    bool is_watched = false;
    for (int i = 0; i < 27 && is_there && !is_awake; ++i) is_watched = is_watched || !sleep.asleep[pass.neighbours[brick * 27 + i]];
    if (is_there) pass.acted_on[brick] = 0;
    const auto list = [&](bool is_listed, SleepCount count, uint32_t* all) {
        const uint32_t listed = __ballot_sync(~0u, is_listed);
        uint32_t first = 0;
        if (lane == 0 && listed) first = atomicAdd(&sleep.counts[count], __popc(listed));
        first = __shfl_sync(~0u, first, 0);
        if (is_listed) all[first + __popc(listed & ((1u << lane) - 1))] = brick;
    };
    list(is_awake, AWAKE, sleep.awake);
    list(is_watched, WATCHED, sleep.watched);
    if (is_awake) atomicAdd(&sleep.counts[AWAKE_NODES], sleep.nodes_in[brick]);
}
