// Where nodes are, for the host to look at: what displaces those of each brick at least and at most, and then the displacements of the bricks that it asks for, now and at the look before. Both
// go to the host's memory.
#include "layout.cuh"

namespace look_kernel {

constexpr int WARPS = BRICK_NODES / 32;

// Of each brick: least along x, y and z, then most. A block for each.
template <class R>
__device__ void look(const Look& look) {
    __shared__ R least[3][WARPS], most[3][WARPS];
    const uint32_t brick = blockIdx.x, node = threadIdx.x, lane = node % 32, warp = node / 32;
    const bool is_there = look.nodes[size_t(brick) * WARPS + warp] >> lane & 1;
    const R* const u = static_cast<const R*>(look.u) + size_t(brick) * look.places.brick + node * look.places.node;
    R* const seen = static_cast<R*>(look.seen) + velocity_at(brick * BRICK_NODES + node);
    for (int axis = 0; axis < 3; ++axis) {
        const R x = u[axis * look.places.axis];
        seen[axis * BRICK_NODES] = x;
        R low = is_there ? x : R(INFINITY), high = is_there ? x : R(-INFINITY);
        for (int step = 16; step > 0; step /= 2) {
            low = fmin(low, __shfl_xor_sync(~0u, low, step));
            high = fmax(high, __shfl_xor_sync(~0u, high, step));
        }
        if (lane == 0) least[axis][warp] = low, most[axis][warp] = high;
    }
    __syncthreads();
    if (node >= 6) return;
    const bool is_most = node >= 3;
    const R* const of_warps = is_most ? most[node - 3] : least[node];
    R all = of_warps[0];
    for (int w = 1; w < WARPS; ++w) all = is_most ? fmax(all, of_warps[w]) : fmin(all, of_warps[w]);
    static_cast<R*>(look.bounds)[brick * 6 + node] = all;
}

// Of each brick of the list: x, y and z of its nodes at the look before, then at the last one. A block for each.
template <class R>
__device__ void show(const Shown& shown) {
    const size_t from = velocity_at(shown.bricks[blockIdx.x] * BRICK_NODES + threadIdx.x);
    for (int look = 0; look < 2; ++look) {
        const R* const seen = static_cast<const R*>(shown.seen[look]) + from;
        R* const nodes = static_cast<R*>(shown.nodes) + size_t(2 * blockIdx.x + look) * (3 * BRICK_NODES) + threadIdx.x;
        for (int axis = 0; axis < 3; ++axis) nodes[axis * BRICK_NODES] = seen[axis * BRICK_NODES];
    }
}

}  // namespace look_kernel
using namespace look_kernel;

extern "C" __global__ void __launch_bounds__(BRICK_NODES) look_single(const __grid_constant__ Look record) { look<float>(record); }
extern "C" __global__ void __launch_bounds__(BRICK_NODES) look_double(const __grid_constant__ Look record) { look<double>(record); }
extern "C" __global__ void __launch_bounds__(BRICK_NODES) show_single(const __grid_constant__ Shown record) { show<float>(record); }
extern "C" __global__ void __launch_bounds__(BRICK_NODES) show_double(const __grid_constant__ Shown record) { show<double>(record); }
