// One substep of the lattice: one block advances one brick, one thread one node.
//
// The brick and the one-node halo around it are staged in shared memory. Every node then gathers its 26 springs and, where a material asks for
// it, the volume terms of its eight cells. A spring is so evaluated at both of its ends, with operands that differ only in sign: equal and opposite
// to the last bit, in an order that is always the same.
//
// Where some bricks sleep, blocks take those that are awake from a list, and now and then the sleeping ones beside them as well, to see whether they would
// move; see sleep.cu.
#include "block.cuh"
#include "clock.cuh"
#include "law.cuh"
#include "layout.cuh"
#include "tile.cuh"

namespace lattice_kernel {

// Everything that the nodes of a block share.
template <bool VOLUME, bool DAMPED>
struct Shared {
    float4 u[TILE];
    Law laws[16];
};
template <bool VOLUME>
struct Shared<VOLUME, true> {
    float4 u[TILE];
    Law laws[16];
    float v[3][TILE];
};

// Adds the force of the spring to the node further by (X, Y, Z), without its stiffness where that is 1.
template <int X, int Y, int Z, bool DAMPED, class S>
__device__ __forceinline__ void spring(const S& s, int at, const float4& own, const Vec& own_v, float k, float kb, float h, Vec& f) {
    constexpr int N = (X != 0) + (Y != 0) + (Z != 0);
    constexpr float ROOT = N == 1 ? 1.0f : N == 2 ? 1.41421356237f : 1.73205080757f;
    const int other = at + tile_at(X, Y, Z);
    const float4 n = s.u[other];
    const float dx = n.x - own.x, dy = n.y - own.y, dz = n.z - own.z;
    const float lx = X == 0 ? dx : dx + X * h;
    const float ly = Y == 0 ? dy : dy + Y * h;
    const float lz = Z == 0 ? dz : dz + Z * h;
    float size = k * elongation(lx * lx + (ly * ly + lz * lz), ROOT * h);
    if constexpr (DAMPED) {
        const float rate = lx * (s.v[0][other] - own_v.x) + (ly * (s.v[1][other] - own_v.y) + lz * (s.v[2][other] - own_v.z));
        size += kb * rate * (1.0f / (N * h * h));
    }
    f.x += size * lx;
    f.y += size * ly;
    f.z += size * lz;
}

// Stiffness of each spring class around a node whose eight cells are `k[corner]`.
struct Cells {
    float k[8];
    // Cells beside a direction: those whose corner bit agrees wherever the direction is not 0.
    template <int X, int Y, int Z>
    __device__ __forceinline__ float beside() const {
        float sum = 0.0f;
#pragma unroll
        for (int c = 0; c < 8; ++c) {
            const bool fits = (X == 0 || (X > 0) == ((c & 1) != 0)) && (Y == 0 || (Y > 0) == ((c & 2) != 0)) && (Z == 0 || (Z > 0) == ((c & 4) != 0));
            if (fits) sum += k[c];
        }
        return (X != 0 && Y != 0 && Z != 0) ? 0.75f * sum : sum;
    }
};

template <int X, int Y, int Z, bool UNIFORM, bool DAMPED, class S>
__device__ __forceinline__ void one(const S& s, int at, const float4& own, const Vec& v, const Cells& k, const Cells& kb, float h, Vec& f) {
    const float stiffness = UNIFORM ? 1.0f : k.beside<X, Y, Z>();
    const float damper = DAMPED ? kb.beside<X, Y, Z>() : 0.0f;
    spring<X, Y, Z, DAMPED>(s, at, own, v, stiffness, damper, h, f);
}

// The springs of one node. Where all eight cells are alike, each class of directions is scaled once.
template <bool UNIFORM, bool DAMPED, class S>
__device__ __forceinline__ Vec springs(const S& s, int at, const float4& own, const Vec& v, const Cells& k, const Cells& kb, float h) {
    Vec edge{0, 0, 0}, face{0, 0, 0}, body{0, 0, 0};
    Vec& f = UNIFORM ? face : edge;
    Vec& b = UNIFORM ? body : edge;
#define PLP_SPRING(X, Y, Z, SUM) one<X, Y, Z, UNIFORM, DAMPED>(s, at, own, v, k, kb, h, SUM)
    PLP_SPRING(-1, -1, -1, b); PLP_SPRING(0, -1, -1, f); PLP_SPRING(1, -1, -1, b);
    PLP_SPRING(-1, 0, -1, f); PLP_SPRING(0, 0, -1, edge); PLP_SPRING(1, 0, -1, f);
    PLP_SPRING(-1, 1, -1, b); PLP_SPRING(0, 1, -1, f); PLP_SPRING(1, 1, -1, b);
    PLP_SPRING(-1, -1, 0, f); PLP_SPRING(0, -1, 0, edge); PLP_SPRING(1, -1, 0, f);
    PLP_SPRING(-1, 0, 0, edge); PLP_SPRING(1, 0, 0, edge);
    PLP_SPRING(-1, 1, 0, f); PLP_SPRING(0, 1, 0, edge); PLP_SPRING(1, 1, 0, f);
    PLP_SPRING(-1, -1, 1, b); PLP_SPRING(0, -1, 1, f); PLP_SPRING(1, -1, 1, b);
    PLP_SPRING(-1, 0, 1, f); PLP_SPRING(0, 0, 1, edge); PLP_SPRING(1, 0, 1, f);
    PLP_SPRING(-1, 1, 1, b); PLP_SPRING(0, 1, 1, f); PLP_SPRING(1, 1, 1, b);
#undef PLP_SPRING
    if (UNIFORM) {
        const float q = k.k[0];
        edge.x = 4.0f * q * edge.x + (2.0f * q * face.x + 0.75f * q * body.x);
        edge.y = 4.0f * q * edge.y + (2.0f * q * face.y + 0.75f * q * body.y);
        edge.z = 4.0f * q * edge.z + (2.0f * q * face.z + 0.75f * q * body.z);
    }
    return edge;
}

// The volume forces of one cell on its corners: corner (+-, +-, +-) receives +-cx +-cy +-cz. Sums and differences along x come first, then
// along y and z. Gives J - 1.
__device__ __forceinline__ float cell_force(const float4* u, int low, float volume, float h, float force[9]) {
    float g[9];
    const float4 a = u[low], a1 = u[low + 1], b = u[low + tile_at(0, 1, 0)], b1 = u[low + tile_at(1, 1, 0)];
    const float4 d = u[low + tile_at(0, 0, 1)], d1 = u[low + tile_at(1, 0, 1)], e = u[low + tile_at(0, 1, 1)], e1 = u[low + tile_at(1, 1, 1)];
    const float quarter = 0.25f / h;
#define PLP_GRADIENT(ROW, C)                                                            \
    {                                                                                   \
        const float sa = a.C + a1.C, sb = b.C + b1.C, sd = d.C + d1.C, se = e.C + e1.C; \
        g[3 * ROW] = quarter * (((a1.C - a.C) + (b1.C - b.C)) + ((d1.C - d.C) + (e1.C - e.C))); \
        g[3 * ROW + 1] = quarter * ((sb - sa) + (se - sd));                             \
        g[3 * ROW + 2] = quarter * ((sd - sa) + (se - sb));                             \
    }
    PLP_GRADIENT(0, x)
    PLP_GRADIENT(1, y)
    PLP_GRADIENT(2, z)
#undef PLP_GRADIENT
    float cof[9];
    const float dj = volume_change(g, cof);
    const float p = -volume * dj;
#pragma unroll
    for (int i = 0; i < 9; ++i) force[i] = cof[i] * p;
    return dj;
}

// Visits what pieces of divided cells give to a node of a brick: the corner by which they hang on it, and that.
template <class Visit>
__device__ __forceinline__ void for_each_piece(const Pass& pass, uint32_t brick, uint32_t node, Visit visit) {
    const uint32_t place = pass.piece_bricks ? pass.piece_bricks[brick] : NO_PLACE;
    if (place == NO_PLACE) return;
    const Pieces& pieces = *pass.pieces;
    const uint32_t* const start = pieces.starts + size_t(place) * BRICK_NODES + node;
#pragma unroll 1
    for (uint32_t i = start[0]; i < start[1]; ++i) {
        const uint32_t hung = pieces.hung[i];
        visit(hung % 8, pieces.given[hung]);
    }
}

// The largest of positive numbers in a warp.
__device__ __forceinline__ float warp_max(float x) {
#pragma unroll
    for (int step = 16; step > 0; step /= 2) x = fmaxf(x, __shfl_xor_sync(~0u, x, step));
    return x;
}

// The sum over a warp, in a fixed order.
__device__ __forceinline__ float warp_sum(float x) {
#pragma unroll
    for (int step = 16; step > 0; step /= 2) x += __shfl_xor_sync(~0u, x, step);
    return x;
}

// The rest need not wait for contact, which follows the bricks that came first: what it reads was there before these.
__device__ __forceinline__ void begin(const Pass& pass) {
    if (pass.share != REST) wait_for_previous();
    let_next_start();
    note_start(pass);
}
// But it has not ended before contact has.
__device__ __forceinline__ void end(const Pass& pass) {
    if (pass.share == REST && blockIdx.x == 0) wait_for_previous();
}

// One brick, which may be the block's first; of one that sleeps it is only seen how it would accelerate.
template <bool VOLUME, bool DAMPED, bool SLEEPS>
__device__ __forceinline__ void advance(const Pass& pass, const uint32_t brick, const bool is_first, const bool is_asleep) {
    __shared__ Shared<VOLUME, DAMPED> s;
    __shared__ float cells[VOLUME ? 9 : 1][VOLUME ? CELLS : 1];
    __shared__ Mark marks[BRICK_NODES / 32];

    // What never changes comes first. Every warp keeps the 27 bricks in its lanes.
    const uint32_t node = threadIdx.x, lane = node & 31;
    const size_t slot = size_t(brick) * BRICK_NODES + node;
    const uint32_t around = pass.neighbours[brick * 27 + (lane < 27 ? lane : 0)], flags = pass.flags[slot];
    if (node < 16) s.laws[node] = pass.laws[node];
    if (is_first) begin(pass);

    if (!SLEEPS && pass.share == REST && pass.near_tools[brick]) return;

    // Once a substep has gone wrong, those behind it leave its state as it is.
    if (*pass.diverged_at < pass.substep) return;
    const float4 own = pass.u[slot];
    const int at = tile_at(1 + node % BRICK_X, 1 + node / BRICK_X % BRICK_Y, 1 + node / (BRICK_X * BRICK_Y));
    s.u[at] = own;
    Vec v{pass.v[brick * (3 * BRICK_NODES) + node], pass.v[brick * (3 * BRICK_NODES) + BRICK_NODES + node],
          pass.v[brick * (3 * BRICK_NODES) + 2 * BRICK_NODES + node]};
    if constexpr (DAMPED) {
        s.v[0][at] = v.x;
        s.v[1][at] = v.y;
        s.v[2][at] = v.z;
    }
#pragma unroll
    for (int round = 0; round < (HALO + BRICK_NODES - 1) / BRICK_NODES; ++round) {
        const int i = node + round * BRICK_NODES;
        const uint32_t entry = HALO_TABLE.entry[i < HALO ? i : HALO - 1];
        const uint32_t from = __shfl_sync(~0u, around, entry >> 9 & 31), there = entry >> 14;
        if (i < HALO) {
            s.u[entry & 511] = pass.u[size_t(from) * BRICK_NODES + there];
            if constexpr (DAMPED) {
                for (int c = 0; c < 3; ++c) s.v[c][entry & 511] = pass.v[(size_t(from) * 3 + c) * BRICK_NODES + there];
            }
        }
    }
    __syncthreads();

    const float h = pass.cell;
    float swelling = 0.0f, shrinking = 0.0f;
    if (VOLUME) {
#pragma unroll
        for (int round = 0; round < (CELLS + BRICK_NODES - 1) / BRICK_NODES; ++round) {
            const int cell = node + round * BRICK_NODES;
            if (cell < CELLS) {
                const int low = tile_at(cell % CELLS_X, cell / CELLS_X % CELLS_Y, cell / (CELLS_X * CELLS_Y));
                const float volume = s.laws[__float_as_uint(s.u[low].w) >> 28].volume;
                float force[9] = {};
                if (volume != 0.0f) {
                    const float dj = cell_force(s.u, low, volume, h, force);
                    swelling = fmaxf(swelling, dj);
                    shrinking = fmaxf(shrinking, -dj);
                }
                for (int i = 0; i < 9; ++i) cells[i][cell] = force[i];
            }
        }
        __syncthreads();
    }

    // What the eight cells around the node contribute.
    const uint32_t word = __float_as_uint(own.w);
    const bool uniform = !DAMPED && __all_sync(~0u, word == (word & 15) * 0x11111111u);
    Cells k, kb;
    float mass;
    Vec f;
    if (uniform) {
        const Law law = s.laws[word & 15];
        k.k[0] = law.spring;
        mass = 8.0f * law.corner;
        f = springs<true, false>(s, at, own, v, k, k, h);
    } else {
        mass = 0.0f;
#pragma unroll
        for (int c = 0; c < 8; ++c) {
            const Law law = s.laws[word >> (4 * c) & 15];
            k.k[c] = law.spring;
            if constexpr (DAMPED) kb.k[c] = law.damper;
            mass += law.corner;
        }
        f = springs<false, DAMPED>(s, at, own, v, k, kb, h);
    }
    if (VOLUME) {
        const int first = (node / (BRICK_X * BRICK_Y) * CELLS_Y + node / BRICK_X % BRICK_Y) * CELLS_X + node % BRICK_X;
#pragma unroll
        for (int c = 0; c < 8; ++c) {
            // Cell c lies before the node along an axis where its bit is 0: the node is its upper corner there.
            const int cell = first + ((c & 4 ? 1 : 0) * CELLS_Y + (c & 2 ? 1 : 0)) * CELLS_X + (c & 1);
            const float sx = c & 1 ? -1.0f : 1.0f, sy = c & 2 ? -1.0f : 1.0f, sz = c & 4 ? -1.0f : 1.0f;
            f.x += sx * cells[0][cell] + (sy * cells[1][cell] + sz * cells[2][cell]);
            f.y += sx * cells[3][cell] + (sy * cells[4][cell] + sz * cells[5][cell]);
            f.z += sx * cells[6][cell] + (sy * cells[7][cell] + sz * cells[8][cell]);
        }
    }

    // What pieces of divided cells give, and weigh.
    for_each_piece(pass, brick, node, [&](uint32_t, const float4& given) { f.x += given.x, f.y += given.y, f.z += given.z; });
    mass += kg_of_pieces(pass, slot);

    // Move.
    const Step& step = *pass.step;
    const float dt = step.dt, inverse = mass > 0.0f ? 1.0f / mass : 0.0f;
    Vec a{f.x * inverse + step.gravity[0], f.y * inverse + step.gravity[1], f.z * inverse + step.gravity[2]};
    v.x = (v.x + a.x * dt) * step.keep;
    v.y = (v.y + a.y * dt) * step.keep;
    v.z = (v.z + a.z * dt) * step.keep;
    if (flags & 1) a.x = v.x = 0.0f;
    if (flags & 2) a.y = v.y = 0.0f;
    if (flags & 4) a.z = v.z = 0.0f;
    const float acceleration2 = a.x * a.x + (a.y * a.y + a.z * a.z);
    if (SLEEPS && is_asleep) {
        // Squares, as numbers or as bits, are in the same order.
        if (mass > 0.0f) atomicMax(reinterpret_cast<uint32_t*>(&pass.marks[brick].acceleration2), __float_as_uint(acceleration2));
        return;
    }
    const float4 next = make_float4(own.x + v.x * dt, own.y + v.y * dt, own.z + v.z * dt, own.w);
    pass.u_next[slot] = next;
    pass.v_next[brick * (3 * BRICK_NODES) + node] = v.x;
    pass.v_next[brick * (3 * BRICK_NODES) + BRICK_NODES + node] = v.y;
    pass.v_next[brick * (3 * BRICK_NODES) + 2 * BRICK_NODES + node] = v.z;

    const float speed2 = v.x * v.x + (v.y * v.y + v.z * v.z);
    // A comparison with NaN is false.
    if (!(speed2 * dt * dt < h * h)) atomicMin(pass.diverged_at, pass.substep);
    if (pass.mark) {
        float strain = 0.0f;
        // The edge ahead along an axis is there if one of the four cells beside it is.
        const uint32_t beside[3] = {word & 0xf0f0f0f0u, word & 0xff00ff00u, word & 0xffff0000u};
        const float4 ahead[3] = {s.u[at + tile_at(1, 0, 0)], s.u[at + tile_at(0, 1, 0)], s.u[at + tile_at(0, 0, 1)]};
        for (int i = 0; i < 3; ++i) {
            const float4 n = ahead[i];
            const float lx = n.x - own.x + (i == 0 ? h : 0.0f), ly = n.y - own.y + (i == 1 ? h : 0.0f), lz = n.z - own.z + (i == 2 ? h : 0.0f);
            if (beside[i]) strain = fmaxf(strain, fabsf(elongation(lx * lx + (ly * ly + lz * lz), h)));
        }
        for_each_piece(pass, brick, node, [&](uint32_t corner, const float4& given) {
            if (corner == 0) strain = fmaxf(strain, given.w);
            if (corner == 1) swelling = fmaxf(swelling, given.w);
            if (corner == 2) shrinking = fmaxf(shrinking, given.w);
        });
        const Mark mine{warp_max(speed2), warp_max(acceleration2), warp_sum(mass * speed2), warp_max(strain), warp_max(swelling), warp_max(shrinking)};
        if (lane == 0) marks[node / 32] = mine;
        __syncthreads();
        if (node == 0) {
            Mark all = marks[0];
            for (int w = 1; w < BRICK_NODES / 32; ++w) {
                all.speed2 = fmaxf(all.speed2, marks[w].speed2);
                all.acceleration2 = fmaxf(all.acceleration2, marks[w].acceleration2);
                all.vis_viva += marks[w].vis_viva;
                all.strain = fmaxf(all.strain, marks[w].strain);
                all.swelling = fmaxf(all.swelling, marks[w].swelling);
                all.shrinking = fmaxf(all.shrinking, marks[w].shrinking);
            }
            pass.marks[brick] = all;
        }
    }
}

// Listed bricks, which are awake, and, in substeps that leave marks, those that are watched.
template <bool VOLUME, bool DAMPED>
__device__ __forceinline__ void advance_awake(const Pass& pass, const Sleep& sleep) {
    // No list changes while substeps overlap.
    const uint32_t awake = sleep.counts[AWAKE], all = awake + (pass.mark ? sleep.counts[WATCHED] : 0);
    bool is_first = true;
#pragma unroll 1
    for (uint32_t i = blockIdx.x; i < all; i += gridDim.x) {
        const uint32_t brick = i < awake ? sleep.awake[i] : sleep.watched[i - awake];
        if (pass.share == REST && pass.near_tools[brick]) continue;
        advance<VOLUME, DAMPED, true>(pass, brick, is_first, i >= awake);
        is_first = false;
        __syncthreads();
    }
    if (is_first) begin(pass);
    end(pass);
}

}  // namespace lattice_kernel
using namespace lattice_kernel;

#define PLP_LATTICE(NAME, VOLUME, DAMPED)                                                                                         \
    extern "C" __global__ void __launch_bounds__(BRICK_NODES) NAME(const __grid_constant__ Pass pass) {                           \
        advance<VOLUME, DAMPED, false>(pass, blockIdx.x, true, false);                                                            \
        end(pass);                                                                                                                \
    }                                                                                                                             \
    extern "C" __global__ void __launch_bounds__(BRICK_NODES)                                                                     \
        NAME##_awake(const __grid_constant__ Pass pass, const __grid_constant__ Sleep sleep) {                                    \
        advance_awake<VOLUME, DAMPED>(pass, sleep);                                                                               \
    }
PLP_LATTICE(lattice_plain, false, false)
PLP_LATTICE(lattice_volume, true, false)
PLP_LATTICE(lattice_damped, false, true)
PLP_LATTICE(lattice_volume_damped, true, true)
