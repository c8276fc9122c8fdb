// Vectors in the precision of the meshless state, and where those of nodes lie.
#pragma once
#include "efg.cuh"
#include "layout.cuh"

namespace efg_kernel {

template <class R>
struct V3 {
    R x, y, z;
};
template <class R>
__device__ __forceinline__ R dot(const V3<R>& a, const V3<R>& b) {
    return a.x * b.x + (a.y * b.y + a.z * b.z);
}
// a + b s.
template <class R>
__device__ __forceinline__ V3<R> plus(const V3<R>& a, const V3<R>& b, R s) {
    return {a.x + b.x * s, a.y + b.y * s, a.z + b.z * s};
}
template <class R>
__device__ __forceinline__ V3<R> across(const V3<R>& v, const V3<R>& n) {
    return plus(v, n, -dot(v, n));
}
template <class R>
__device__ __forceinline__ R norm(const V3<R>& v) {
    return root(dot(v, v));
}
template <class R>
__device__ __forceinline__ V3<R> product(const Block<R>& m, const V3<R>& v) {
    return {m.xx * v.x + (m.xy * v.y + m.xz * v.z), m.xy * v.x + (m.yy * v.y + m.yz * v.z), m.xz * v.x + (m.yz * v.y + m.zz * v.z)};
}
// Nothing along axes that are held.
template <class R>
__device__ __forceinline__ V3<R> free_part(const V3<R>& v, uint32_t flags) {
    const uint32_t held = flags & GRASPED ? FIX_X | FIX_Y | FIX_Z : flags;
    return {held & FIX_X ? R(0) : v.x, held & FIX_Y ? R(0) : v.y, held & FIX_Z ? R(0) : v.z};
}

// Numbers of a node in a field that has `NUMBERS` of them for each.
template <int NUMBERS, class R>
__device__ __forceinline__ R* numbers_of(const void* field, uint32_t slot) {
    return static_cast<R*>(const_cast<void*>(field)) + size_t(slot / BRICK_NODES) * (NUMBERS * BRICK_NODES) + slot % BRICK_NODES;
}
template <class R>
__device__ __forceinline__ V3<R> vector_of(const void* field, uint32_t slot) {
    const R* const at = numbers_of<VECTOR, R>(field, slot);
    return {at[0], at[BRICK_NODES], at[2 * BRICK_NODES]};
}
template <class R>
__device__ __forceinline__ void set_vector(void* field, uint32_t slot, const V3<R>& v) {
    R* const at = numbers_of<VECTOR, R>(field, slot);
    at[0] = v.x, at[BRICK_NODES] = v.y, at[2 * BRICK_NODES] = v.z;
}
template <class R>
__device__ __forceinline__ Block<R> block_of(const void* field, uint32_t slot) {
    const R* const m = numbers_of<BLOCK, R>(field, slot);
    return {m[0], m[BRICK_NODES], m[2 * BRICK_NODES], m[3 * BRICK_NODES], m[4 * BRICK_NODES], m[5 * BRICK_NODES]};
}
template <class R>
__device__ __forceinline__ void set_block(void* field, uint32_t slot, const Block<R>& b) {
    R* const m = numbers_of<BLOCK, R>(field, slot);
    m[0] = b.xx, m[BRICK_NODES] = b.xy, m[2 * BRICK_NODES] = b.xz, m[3 * BRICK_NODES] = b.yy, m[4 * BRICK_NODES] = b.yz, m[5 * BRICK_NODES] = b.zz;
}

}  // namespace efg_kernel
