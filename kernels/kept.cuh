// How teams that have one brick each descend: what they need to know of it, and of the nodes around it, stays in shared memory, and blocks meet once in each iteration.
//
// A team needs z around its brick. It does not wait for others to find it there: with m = M⁻¹ A z, q = m + β q and z −= α q, so that it follows z on its halo as those do
// whose nodes these are, by the same operations on the same numbers, and m alone has to be told. What contact adds to m is told by the block that has contact's part, which
// follows z on the nodes that carry points.
#pragma once
#include "worker.cuh"

namespace efg_kernel {

template <class R>
struct alignas(16) Kept {
    R q[3][TILE];
    R r[3][BRICK_NODES], p[3][BRICK_NODES], s[3][BRICK_NODES], x[3][BRICK_NODES];
    R inverse[6][BRICK_NODES];
    R frames[9][CELLS];
    uint8_t materials[CELLS];
};

// What an iteration sums up.
struct Sums {
    // r·r, r·z and z·A z.
    double numbers[3];
};

template <class R>
struct Keeper {
    const Worker<R>& w;
    Kept<R>& k;
    const uint32_t brick;
    uint32_t flags;
    R heavy;
    // The nodes of the tile that this thread follows, its own one first: their places there, where their numbers begin in a field, and which carriers they are.
    int at[1 + HALO_ROUNDS];
    uint32_t first[1 + HALO_ROUNDS], carrier[1 + HALO_ROUNDS];
    // A z at the own one.
    V3<R> az;

    __device__ __forceinline__ Keeper(const Worker<R>& w, Kept<R>& k) : w(w), k(k), brick(w.first_brick()) {}

    // Keeps x, its residual, and what the answers to that hang on.
    __device__ __forceinline__ void begin(const Contact& c, bool has_contact) {
        const Efg& e = w.e;
        flags = e.flags[w.slot(brick)];
        heavy = *w.template of<1>(e.heavy, brick);
        const uint32_t near = w.around(brick);
        w.stage(e.z, brick, near);
        keep(k.r, w.get(e.r, brick));
        keep(k.x, w.get(e.x, brick));
        const R* const inverse = w.template of<BLOCK>(e.inverse, brick);
        for (int n = 0; n < 6; ++n) k.inverse[n][w.node] = inverse[n * BRICK_NODES];
        for (int round = 0; round < CELL_ROUNDS; ++round) {
            const auto cell = w.cell_of(round);
            const uint32_t from = __shfl_sync(~0u, near, cell.brick);
            if (!cell.is_there()) continue;
            const Matrix<R> a = w.frame(from, cell.there);
            for (int n = 0; n < 9; ++n) k.frames[n][cell.number] = a.m[n / 3][n % 3];
            k.materials[cell.number] = e.cells[from * BRICK_NODES + cell.there];
        }
        at[0] = w.own_at();
        note(0, w.slot(brick), c, has_contact);
        for (int round = 0; round < HALO_ROUNDS; ++round) {
            const int i = w.node + round * BRICK_NODES;
            const uint32_t entry = HALO_TABLE.entry[i < HALO ? i : HALO - 1];
            const uint32_t from = __shfl_sync(~0u, near, entry >> 9 & 31);
            at[1 + round] = i < HALO ? int(entry & 511) : -1;
            note(1 + round, from * BRICK_NODES + (entry >> 14), c, has_contact);
        }
    }

    __device__ __forceinline__ void note(int n, uint32_t slot, const Contact& c, bool has_contact) {
        first[n] = slot / BRICK_NODES * (VECTOR * BRICK_NODES) + slot % BRICK_NODES;
        carrier[n] = w.carrier_of(c, has_contact, slot);
    }

    __device__ __forceinline__ V3<R> kept(const R (&of)[3][BRICK_NODES]) const { return {of[0][w.node], of[1][w.node], of[2][w.node]}; }
    __device__ __forceinline__ void keep(R (&of)[3][BRICK_NODES], const V3<R>& v) const { of[0][w.node] = v.x, of[1][w.node] = v.y, of[2][w.node] = v.z; }
    __device__ __forceinline__ V3<R> z(int at) const {
        const Row<R> z = w.t.tile[at];
        return {z.x, z.y, z.z};
    }

    // A z, and m for others. Gives z·A z.
    __device__ __forceinline__ double multiply(void* m) {
        meet_team(w.team);
#pragma unroll 1
        for (int round = 0; round < CELL_ROUNDS; ++round) {
            const auto cell = w.cell_of(round);
            uint32_t material = 0;
            Matrix<R> a;
            if (cell.is_there()) {
                material = k.materials[cell.number];
                for (int n = 0; n < 9; ++n) a.m[n / 3][n % 3] = k.frames[n][cell.number];
            }
            w.answer(cell, material, a, w.s.changes, typename Worker<R>::Changes{});
        }
        meet_team(w.team);
        const V3<R> own = z(at[0]), sum = w.received();
        az = {heavy * own.x - sum.x, heavy * own.y - sum.y, heavy * own.z - sum.z};
        const R(&n)[6][BRICK_NODES] = k.inverse;
        const uint32_t i = w.node;
        w.put(m, brick, free_part(product(Block<R>{n[0][i], n[1][i], n[2][i], n[3][i], n[4][i], n[5][i]}, free_part(az, flags)), flags));
        return double(dot(own, az));
    }

    // What follows from that once all know it.
    __device__ __forceinline__ void relax(const void* m, uint32_t turn, R alpha, R beta, bool is_first, Sums& sums) {
        V3<R> told[1 + HALO_ROUNDS];
#pragma unroll
        for (int n = 0; n <= HALO_ROUNDS; ++n) {
            if (at[n] < 0) continue;
            const R* const from = static_cast<const R*>(m) + first[n];
            told[n] = {from[0], from[BRICK_NODES], from[2 * BRICK_NODES]};
            if (carrier[n] == ~0u) continue;
            const R* const touched = w.touched_on(carrier[n], turn);
            told[n] = plus(told[n], {touched[3], touched[4], touched[5]}, R(1));
            if (n == 0) az = plus(az, {touched[0], touched[1], touched[2]}, R(1));
        }
        V3<R> p = z(at[0]), s = az;
        if (!is_first) p = plus(p, kept(k.p), beta), s = plus(s, kept(k.s), beta);
        keep(k.p, p);
        keep(k.s, s);
        keep(k.x, plus(kept(k.x), p, alpha));
        const V3<R> r = free_part(plus(kept(k.r), s, -alpha), flags);
        keep(k.r, r);
#pragma unroll
        for (int n = 0; n <= HALO_ROUNDS; ++n) {
            if (at[n] < 0) continue;
            const int i = at[n];
            const V3<R> q = is_first ? told[n] : plus(told[n], {k.q[0][i], k.q[1][i], k.q[2][i]}, beta), to = plus(z(i), q, -alpha);
            k.q[0][i] = q.x, k.q[1][i] = q.y, k.q[2][i] = q.z;
            w.t.tile[i] = {to.x, to.y, to.z, R(0)};
        }
        sums.numbers[0] += double(dot(r, r));
        sums.numbers[1] += double(dot(r, z(at[0])));
    }

    // Leaves x where all find it.
    __device__ __forceinline__ void leave() const { w.put(w.e.x, brick, kept(k.x)); }
};

}  // namespace efg_kernel
