// Cells with rows of their own: what they give to the nodes that they see. Eight threads side by side evaluate a row, each for every eighth of its nodes; nodes gather
// what they receive when all blocks have met. See src/cpu/efg/rows.rs for what it means.
#pragma once
#include "field.cuh"

namespace efg_kernel {

// How the nodes of a row move: the displacement gradient at its cell, and the affine motion that fits theirs best.
template <class R>
struct RowMotion {
    Matrix<R> gradient, fit;
    V3<R> mean;
};

template <class R>
__device__ __forceinline__ const RowCell<R>& row_cell(const Efg& e, uint32_t row) {
    return static_cast<const RowCell<R>*>(e.row_cells)[row];
}
template <class R>
__device__ __forceinline__ const RowEntry<R>& row_entry(const Efg& e, uint32_t row, uint32_t entry) {
    return static_cast<const RowEntry<R>*>(e.row_entries)[size_t(row) * ROW + entry];
}
template <class R>
__device__ __forceinline__ Matrix<R>& row_frame(const Efg& e, uint32_t row) {
    return static_cast<Matrix<R>*>(e.row_frames)[row];
}

// What a row's entry receives of its cell.
template <class R>
__device__ __forceinline__ V3<R>& row_given(const Efg& e, uint32_t row, uint32_t entry) {
    return static_cast<V3<R>*>(e.row_given)[size_t(row) * ROW + entry];
}

// A sum over eight threads, in all of them.
template <class R>
__device__ __forceinline__ R sum_of_eight(R x) {
    for (int across = 1; across < 8; across *= 2) x += __shfl_xor_sync(~0u, x, across);
    return x;
}

// Every thread of a warp calls it; a row that is not there has no nodes.
template <class R>
__device__ __forceinline__ RowMotion<R> row_motion(const Efg& e, uint32_t row, uint32_t length, const void* field) {
    RowMotion<R> motion{};
#pragma unroll 1
    for (uint32_t n = threadIdx.x % 8; n < length; n += 8) {
        const RowEntry<R>& entry = row_entry<R>(e, row, n);
        const V3<R> u = vector_of<R>(field, entry.slot);
        motion.mean = plus(motion.mean, u, entry.share);
        for (int j = 0; j < 3; ++j) {
            const R shared = entry.share * entry.arm[j];
            motion.fit.m[0][j] += u.x * shared;
            motion.fit.m[1][j] += u.y * shared;
            motion.fit.m[2][j] += u.z * shared;
            motion.gradient.m[0][j] += u.x * entry.gradient[j];
            motion.gradient.m[1][j] += u.y * entry.gradient[j];
            motion.gradient.m[2][j] += u.z * entry.gradient[j];
        }
    }
    __syncwarp();
    motion.mean = {sum_of_eight(motion.mean.x), sum_of_eight(motion.mean.y), sum_of_eight(motion.mean.z)};
    for (int i = 0; i < 3; ++i) {
        for (int j = 0; j < 3; ++j) motion.fit.m[i][j] = sum_of_eight(motion.fit.m[i][j]), motion.gradient.m[i][j] = sum_of_eight(motion.gradient.m[i][j]);
    }
    return motion;
}

template <class R>
__device__ __forceinline__ V3<R> product(const Matrix<R>& a, const R v[3]) {
    const auto along = [&](int i) { return a.m[i][0] * v[0] + (a.m[i][1] * v[1] + a.m[i][2] * v[2]); };
    return {along(0), along(1), along(2)};
}

// Where a slot's node stands in rows.
struct RowRange {
    uint32_t begin, end;
};
__device__ __forceinline__ RowRange rows_of(const Efg& e, uint32_t slot) {
    const uint32_t place = e.row_bricks[slot / BRICK_NODES];
    if (place == NO_PLACE) return {0, 0};
    const uint32_t* const starts = e.row_starts + size_t(place) * BRICK_NODES + slot % BRICK_NODES;
    return {starts[0], starts[1]};
}

// The force on a node of a row by stress, and by what affine motion leaves of its own.
template <class R>
__device__ __forceinline__ V3<R> row_force(const Efg& e, const RowCell<R>& cell, const RowEntry<R>& entry, const void* field, const RowMotion<R>& motion,
                                           const Matrix<R>& stress, R hourglass) {
    const V3<R> unseen = plus(plus(vector_of<R>(field, entry.slot), motion.mean, R(-1)), product(motion.fit, entry.arm), R(-1));
    return plus(plus(V3<R>{0, 0, 0}, product(stress, entry.gradient), -cell.volume), unseen, -hourglass * cell.fill * entry.share);
}

// What a slot's node receives from all rows that it stands in, in their order, once they were evaluated.
template <class R>
__device__ __forceinline__ V3<R> given_by_rows(const Efg& e, uint32_t slot) {
    V3<R> sum{0, 0, 0};
    const RowRange rows = rows_of(e, slot);
#pragma unroll 4
    for (uint32_t i = rows.begin; i < rows.end; ++i) {
        const RowPlace place = e.row_places[i];
        sum = plus(sum, row_given<R>(e, place.row, place.entry), R(1));
    }
    return sum;
}

// What those resist to the node's own motion.
template <class R>
__device__ __forceinline__ Block<R> block_of_rows(const Efg& e, uint32_t slot, const Moduli<R>* moduli) {
    Block<R> sum{};
    const RowRange rows = rows_of(e, slot);
#pragma unroll 1
    for (uint32_t i = rows.begin; i < rows.end; ++i) {
        const RowPlace place = e.row_places[i];
        const RowCell<R>& cell = row_cell<R>(e, place.row);
        const RowEntry<R>& entry = row_entry<R>(e, place.row, place.entry);
        const Moduli<R> by = moduli[cell.material];
        const Matrix<R> a = row_frame<R>(e, place.row);
        const R* const b = entry.gradient;
        // As for a corner of a regular cell, with b = ∇φ.
        const V3<R> t = product(a, b);
        const R straight = cell.volume * by.mu * (b[0] * b[0] + (b[1] * b[1] + b[2] * b[2])), along = cell.volume * (by.lambda + by.mu);
        const R arm2 = entry.arm[0] * entry.arm[0] + (entry.arm[1] * entry.arm[1] + entry.arm[2] * entry.arm[2]);
        const R unseen = by.hourglass * cell.fill * entry.share * (R(1) - entry.share - entry.share * arm2);
        const auto gram = [&](int i, int j) { return straight * (a.m[i][0] * a.m[j][0] + (a.m[i][1] * a.m[j][1] + a.m[i][2] * a.m[j][2])); };
        sum.xx += gram(0, 0) + along * t.x * t.x + unseen, sum.xy += gram(0, 1) + along * t.x * t.y, sum.xz += gram(0, 2) + along * t.x * t.z;
        sum.yy += gram(1, 1) + along * t.y * t.y + unseen, sum.yz += gram(1, 2) + along * t.y * t.z;
        sum.zz += gram(2, 2) + along * t.z * t.z + unseen;
    }
    return sum;
}

}  // namespace efg_kernel
