// What a cut changes of the nodes: those that it makes start as those that they were, nodes have other cells around them, and pieces are turned as what they were
// part of. Once for each cut, a thread for each change.
#include "layout.cuh"

namespace cut_kernel {

constexpr int THREADS = 128;

// A slot's vector in a field of three numbers for each node takes the value of another's.
template <class R>
__device__ void copy_vector(void* field, const Birth& birth) {
    const auto at = [&](uint32_t slot) { return static_cast<R*>(field) + velocity_at(slot); };
    R *const to = at(birth.slot), *const from = at(birth.from);
    for (int axis = 0; axis < 3; ++axis) to[axis * BRICK_NODES] = from[axis * BRICK_NODES];
}

template <class R>
__device__ void take(const Cut& cut, uint32_t i) {
    if (i < cut.births) {
        // No whole cell hangs on a copy, so that it has no word; and none starts as one that is as new as itself.
        const Birth birth = cut.born[i];
        for (float4* u : cut.u) {
            if (u) u[birth.slot] = make_float4(u[birth.from].x, u[birth.from].y, u[birth.from].z, 0.0f);
        }
        for (void* field : cut.vectors) {
            if (field) copy_vector<R>(field, birth);
        }
        return;
    }
    i -= cut.births;
    if (i < cut.words) {
        const Reworded node = cut.reworded[i];
        for (float4* u : cut.u) {
            if (u) u[node.slot].w = __uint_as_float(node.word);
        }
        return;
    }
    i -= cut.words;
    if (i >= cut.turns) return;
    // What a row is turned as keeps its own turn.
    const Turned turned = cut.turned[i];
    R* const rows = static_cast<R*>(cut.row_rotations);
    const R* from = rows + 4 * turned.from;
    size_t apart = 1;
    if (!turned.is_row) {
        from = static_cast<const R*>(cut.rotations) + size_t(turned.from / BRICK_NODES) * (ROTATION * BRICK_NODES) + turned.from % BRICK_NODES;
        apart = BRICK_NODES;
    }
    for (int n = 0; n < 4; ++n) rows[4 * turned.row + n] = from[n * apart];
}

}  // namespace cut_kernel
using namespace cut_kernel;

extern "C" __global__ void __launch_bounds__(THREADS) cut_single(const __grid_constant__ Cut cut) { take<float>(cut, blockIdx.x * THREADS + threadIdx.x); }
extern "C" __global__ void __launch_bounds__(THREADS) cut_double(const __grid_constant__ Cut cut) { take<double>(cut, blockIdx.x * THREADS + threadIdx.x); }
