// What the threads of a block do together.
#pragma once
#include <stdint.h>

// Kernels of one stream that follow each other may overlap on newer devices: the next one's blocks start when all of this one's have let them, and
// wait, before they read what it writes, until it has ended. Where that is not so these do nothing. A kernel that lets the next one start has waited
// itself, so that what came before both has ended; those of the last two shares of a substep alone know better, see lattice.cu.
__device__ __forceinline__ void wait_for_previous() {
#if __CUDA_ARCH__ >= 900
    asm volatile("griddepcontrol.wait;" ::: "memory");
#endif
}
__device__ __forceinline__ void let_next_start() {
#if __CUDA_ARCH__ >= 900
    asm volatile("griddepcontrol.launch_dependents;");
#endif
}

// Exclusive sum over a block of `warps` warps, `WARPS` at most; `total` is that of all. Every thread calls it.
template <int WARPS>
__device__ uint32_t scan(uint32_t mine, uint32_t& total, int warps = WARPS) {
    __shared__ uint32_t of_warp[WARPS];
    const uint32_t lane = threadIdx.x & 31, warp = threadIdx.x / 32;
    uint32_t sum = mine;
    for (int step = 1; step < 32; step *= 2) {
        const uint32_t below = __shfl_up_sync(~0u, sum, step);
        if (lane >= step) sum += below;
    }
    __syncthreads();
    if (lane == 31) of_warp[warp] = sum;
    __syncthreads();
    uint32_t before = 0;
    total = 0;
#pragma unroll 4
    for (int w = 0; w < warps; ++w) {
        if (w < warp) before += of_warp[w];
        total += of_warp[w];
    }
    return before + sum - mine;
}
