// What all blocks of a grid do together that are at work at the same time: how they meet, and sums over all of them, always in the same order.
#pragma once
#include "layout.cuh"

// What a block knows of its grid, the same in all its threads.
struct Grid {
    // How often blocks have arrived, all together since the kernel's first launch, and at how many meetings this one has been, in all launches: neither is ever set back.
    uint32_t* arrived;
    uint32_t meeting;
    // Two sets of numbers of all blocks, in turn: a block that is ahead writes one while others still read the other.
    double* partials;  // [2][GRID_NUMBERS][blocks]
    // Shared by the block's threads.
    double* scratch;  // [GRID_NUMBERS][33]
};

// What any block wrote before, every block may read afterwards.
__device__ inline void meet(Grid& grid) {
    ++grid.meeting;
    __syncthreads();
    if (threadIdx.x == 0) {
        __threadfence();
        atomicAdd(grid.arrived, 1);
        // Numbers may run over.
        const uint32_t all = grid.meeting * gridDim.x;
        while (int32_t(*(volatile uint32_t*)grid.arrived - all) < 0) {
        }
        __threadfence();
    }
    __syncthreads();
}

struct Sum {
    static __device__ double of(double a, double b) { return a + b; }
};
// Of numbers that are not negative.
struct Largest {
    static __device__ double of(double a, double b) { return fmax(a, b); }
};

template <class How>
__device__ __forceinline__ double warp_all(double x) {
    for (int step = 16; step > 0; step /= 2) x = How::of(x, __shfl_xor_sync(~0u, x, step));
    return x;
}

// N numbers over a block: the n-th in all lanes of the n-th warp. Every thread calls it.
template <class How, int N>
__device__ __forceinline__ double block_all(const double (&mine)[N], double* scratch) {
    const uint32_t lane = threadIdx.x & 31, warp = threadIdx.x / 32, warps = blockDim.x / 32;
#pragma unroll
    for (int n = 0; n < N; ++n) {
        const double all = warp_all<How>(mine[n]);
        if (lane == 0) scratch[n * 33 + warp] = all;
    }
    __syncthreads();
    if (warp >= N) return 0.0;
    return warp_all<How>(lane < warps ? scratch[warp * 33 + lane] : 0.0);
}

// N numbers over the grid, in every thread, which all call it; blocks meet.
template <class How, int N>
__device__ __forceinline__ void meet_with(Grid& grid, double (&numbers)[N]) {
    static_assert(N <= GRID_NUMBERS);
    const uint32_t lane = threadIdx.x & 31, warp = threadIdx.x / 32;
    double* const partials = grid.partials + ((grid.meeting & 1) * GRID_NUMBERS + warp) * gridDim.x;
    const double mine = block_all<How>(numbers, grid.scratch);
    if (warp < N && lane == 0) partials[blockIdx.x] = mine;
    meet(grid);
    if (warp < N) {
        double all = 0.0;
#pragma unroll 8
        for (uint32_t block = lane; block < gridDim.x; block += 32) all = How::of(all, partials[block]);
        all = warp_all<How>(all);
        if (lane == 0) grid.scratch[warp * 33 + 32] = all;
    }
    __syncthreads();
    // Once would do. But where teams of threads have had barriers of their own, racecheck (CUDA 13.0) overlooks the first barrier of the whole block behind a
    // write, and would name a hazard here; so it does in a kernel of thirty lines that does nothing else.
    __syncthreads();
#pragma unroll
    for (int n = 0; n < N; ++n) numbers[n] = grid.scratch[n * 33 + 32];
}
