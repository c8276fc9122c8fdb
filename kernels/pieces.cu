// Pieces of cells that cuts have divided: springs and volume terms as of a whole cell, times the piece's share of its volume; see src/cpu/lattice/pieces.rs.
//
// Every piece is evaluated once before nodes move, by eight threads side by side, one for each corner; nodes then gather what it gives them. A spring is evaluated at
// both of its ends, with operands that differ only in sign.
#include "block.cuh"
#include "clock.cuh"
#include "law.cuh"
#include "layout.cuh"

namespace pieces_kernel {

constexpr int THREADS = 128;

__device__ __forceinline__ Vec across(const Vec& v, int corners) {
    return {__shfl_xor_sync(~0u, v.x, corners), __shfl_xor_sync(~0u, v.y, corners), __shfl_xor_sync(~0u, v.z, corners)};
}

// The force on a corner by the spring to the one that differs in the bits of `CORNERS`; and where that is an edge, its strain.
template <int CORNERS>
__device__ __forceinline__ void spring(const Vec& u, const Vec& v, uint32_t corner, float k, float kb, float h, Vec& force, float& strain) {
    constexpr int N = (CORNERS & 1) + (CORNERS >> 1 & 1) + (CORNERS >> 2);
    constexpr float ROOT = N == 1 ? 1.0f : N == 2 ? 1.41421356237f : 1.73205080757f, SHARE = N == 3 ? 0.75f : 1.0f;
    const Vec n = across(u, CORNERS), nv = across(v, CORNERS);
    const auto ahead = [&](int bit) { return CORNERS & bit ? (corner & bit ? -h : h) : 0.0f; };
    const Vec way{n.x - u.x + ahead(1), n.y - u.y + ahead(2), n.z - u.z + ahead(4)};
    const float longer = elongation(way.x * way.x + (way.y * way.y + way.z * way.z), ROOT * h);
    const float rate = way.x * (nv.x - v.x) + (way.y * (nv.y - v.y) + way.z * (nv.z - v.z));
    const float size = SHARE * (k * longer + kb * rate * (1.0f / (N * h * h)));
    force = force + way * size;
    // Rigid cells have none.
    if (N == 1 && k > 0.0f) strain = fmaxf(strain, fabsf(longer));
}

// Σ ± x over the corners, + where they lie ahead along the axis of `bit`; the same bits in all eight threads.
__device__ __forceinline__ float difference(float x, uint32_t corner, uint32_t bit) {
    const float other = __shfl_xor_sync(~0u, x, bit);
    float sum = corner & bit ? x - other : other - x;
    for (uint32_t across = 1; across < 8; across *= 2) {
        if (across != bit) sum += __shfl_xor_sync(~0u, sum, across);
    }
    return sum;
}

}  // namespace pieces_kernel
using namespace pieces_kernel;

extern "C" __global__ void __launch_bounds__(THREADS) pieces(const __grid_constant__ Pass pass) {
    wait_for_previous();
    let_next_start();
    note_start(pass);
    // Once a substep has gone wrong, those behind it leave its state as it is.
    if (*pass.diverged_at < pass.substep) return;
    const Pieces& known = *pass.pieces;
    const uint32_t thread = blockIdx.x * THREADS + threadIdx.x, corner = thread % 8;
    // Threads without a piece of their own do as others, for all of a warp exchange what they read.
    const bool is_there = thread / 8 < known.count;
    const Piece& piece = known.all[is_there ? thread / 8 : 0];
    const Law law = pass.laws[piece.material];
    const uint32_t slot = piece.nodes[corner];
    const float4 own = pass.u[slot];
    const float* const at = pass.v + velocity_at(slot);
    const Vec u{own.x, own.y, own.z}, v{at[0], at[BRICK_NODES], at[2 * BRICK_NODES]};
    const float h = pass.cell, k = law.spring * piece.volume, kb = law.damper * piece.volume, volume = law.volume * piece.volume;

    Vec force{0, 0, 0};
    float seen[3] = {};
    spring<1>(u, v, corner, k, kb, h, force, seen[0]);
    spring<2>(u, v, corner, k, kb, h, force, seen[0]);
    spring<3>(u, v, corner, k, kb, h, force, seen[0]);
    spring<4>(u, v, corner, k, kb, h, force, seen[0]);
    spring<5>(u, v, corner, k, kb, h, force, seen[0]);
    spring<6>(u, v, corner, k, kb, h, force, seen[0]);
    spring<7>(u, v, corner, k, kb, h, force, seen[0]);

    const float damping = sliver_damping(law.spring, law.corner, piece.volume);
    Vec mean = v;
    for (int corners = 1; corners < 8; corners *= 2) mean = mean + across(mean, corners);
    force = force - (v - mean * 0.125f) * damping;

    const float quarter = 0.25f / h;
    float g[9], cof[9];
    for (int axis = 0; axis < 3; ++axis) {
        g[axis] = quarter * difference(u.x, corner, 1u << axis);
        g[3 + axis] = quarter * difference(u.y, corner, 1u << axis);
        g[6 + axis] = quarter * difference(u.z, corner, 1u << axis);
    }
    if (volume != 0.0f) {
        const float dj = volume_change(g, cof), p = -volume * dj;
        const auto along = [&](int row) {
            const float x = cof[3 * row], y = cof[3 * row + 1], z = cof[3 * row + 2];
            return p * ((corner & 1 ? x : -x) + ((corner & 2 ? y : -y) + (corner & 4 ? z : -z)));
        };
        force = force + Vec{along(0), along(1), along(2)};
        seen[1] = fmaxf(dj, 0.0f), seen[2] = fmaxf(-dj, 0.0f);
    }
    for (int across = 1; across < 8; across *= 2) seen[0] = fmaxf(seen[0], __shfl_xor_sync(~0u, seen[0], across));
    if (is_there) known.given[thread] = make_float4(force.x, force.y, force.z, corner == 0 ? seen[0] : corner == 1 ? seen[1] : corner == 2 ? seen[2] : 0.0f);
}
