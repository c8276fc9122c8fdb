// What the threads of a block do together.
#pragma once
#include <stdint.h>

// Exclusive sum over a block of `WARPS` warps; `total` is that of all. Every thread calls it.
template <int WARPS>
__device__ uint32_t scan(uint32_t mine, uint32_t& total) {
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
    for (int w = 0; w < WARPS; ++w) {
        if (w < warp) before += of_warp[w];
        total += of_warp[w];
    }
    return before + sum - mine;
}
