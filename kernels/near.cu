// Which sites of the surface tools may meet, and what they have to do with each other. Made once for many steps: what follows from it stays good
// while tools and tissue stay within the margin, for rows and masses do not change.
#include "block.cuh"
#include "clock.cuh"
#include "contact.cuh"
#include "layout.cuh"
#include "tool.cuh"

namespace near_kernel {

// Threads of the one block that lists, and of those that work side by side.
constexpr int LIST_THREADS = 1024, THREADS = 256, WARPS = THREADS / 32;
constexpr uint32_t NONE = ~0u;

// The nodes that carry a vertex.
struct NodeRow {
    uint32_t node[8];
    float weight[8];
};

__device__ NodeRow row_of(const Contact& c, uint32_t vertex) {
    const uint4 a = c.row_nodes[2 * vertex], b = c.row_nodes[2 * vertex + 1];
    const float4 p = c.row_weights[2 * vertex], q = c.row_weights[2 * vertex + 1];
    return {{a.x, a.y, a.z, a.w, b.x, b.y, b.z, b.w}, {p.x, p.y, p.z, p.w, q.x, q.y, q.z, q.w}};
}

__device__ Vec rest_of(const Contact& c, uint32_t vertex) { return {c.rest[3 * vertex], c.rest[3 * vertex + 1], c.rest[3 * vertex + 2]}; }

// A point of the surface: where it is at rest, and how far from there.
struct Spot {
    Vec rest, moved;
};

__device__ Spot spot_of(const Contact& c, const Pass& pass, uint32_t vertex) {
    const NodeRow row = row_of(c, vertex);
    Vec moved{0, 0, 0};
    for (int i = 0; i < 8; ++i) moved = moved + vec(pass.u[row.node[i]]) * row.weight[i];
    return {rest_of(c, vertex), moved};
}

// For all parts of tools that may come within `reach` of a spot before sites are listed anew, how they divide a triangle with this longest edge.
// `views` has the tools at the end of the step.
__device__ uint32_t divisions_at(const Contact& c, const Step& step, const View* views, const Spot& spot, float reach, float edge) {
    uint32_t all = 0;
    for (uint32_t t = 0; t < step.tool_count; ++t) {
        const ToolStep& tool = step.tools[t];
        const float most = reach + tool.reach + step.margin;
        const Vec at = from_tool(spot.rest, views[t]) + spot.moved;
        if (dot(at, at) >= (tool.radius + most) * (tool.radius + most)) continue;
        all |= tool_divisions(c.parts + tool.part, tool.part_count, rotate(conjugate(views[t].turn), at), most, edge);
    }
    return all;
}

// Whether tools may meet a vertex.
__device__ bool is_near(const Contact& c, const Step& step, const View* views, const Spot& spot, uint32_t vertex) {
    return divisions_at(c, step, views, spot, 0.0f, c.vertex_edges[vertex]) & 1;
}

// Marks a triangle's corners where tools may meet them. Says whether they may meet it divided, and how.
__device__ bool is_near_and_divided(const Contact& c, const Pass& pass, const View* views, uint32_t triangle) {
    Spot middle{{0, 0, 0}, {0, 0, 0}}, spots[3];
    for (int i = 0; i < 3; ++i) {
        spots[i] = spot_of(c, pass, c.corners[3 * triangle + i]);
        middle = {middle.rest + spots[i].rest * (1.0f / 3.0f), middle.moved + spots[i].moved * (1.0f / 3.0f)};
    }
    float reach = 0.0f;
    for (int i = 0; i < 3; ++i) reach = fmaxf(reach, norm((spots[i].rest - middle.rest) + (spots[i].moved - middle.moved)));
    const uint32_t divisions = divisions_at(c, *pass.step, views, middle, reach, c.triangle_edges[triangle]);
    for (int i = 0; i < 3 && divisions & 1; ++i) {
        const uint32_t vertex = c.corners[3 * triangle + i];
        if (is_near(c, *pass.step, views, spots[i], vertex)) atomicOr(&c.near_bits[vertex / 32], 1u << vertex % 32);
    }
    c.divisions[triangle] = divisions & ~1u;
    return divisions & ~1u;
}

// How many sites lie on an element.
__device__ uint32_t sites_on(const Contact& c, uint32_t element) {
    if (element < c.first_triangle) return 1;
    uint32_t sites = 0;
    for (uint32_t all = c.divisions[element - c.first_triangle]; all; all &= all - 1) sites += __ffs(all) * __ffs(all);
    return sites;
}

// Shares of a triangle's corners in the centre of a small triangle, of `division` squared. They lie in rows from the first corner on, of which
// row r holds 2 r + 1, by turns upright and upside down.
__device__ Vec centre(uint32_t small, uint32_t division) {
    uint32_t r = uint32_t(sqrtf(float(small)));
    while (r * r > small) --r;
    while ((r + 1) * (r + 1) <= small) ++r;
    const uint32_t k = small - r * r, j = k / 2;
    const float third = k % 2 ? 2.0f / 3.0f : 1.0f / 3.0f, scale = 1.0f / float(division);
    return {(float(division - 1 - r) + third) * scale, (float(r - j - k % 2) + third) * scale, (float(j) + third) * scale};
}

// Along the axes, and as if nothing were held: 1 / mass.
__device__ float4 mobility_of(const Pass& pass, uint32_t slot) {
    const uint32_t word = __float_as_uint(pass.u[slot].w), flags = pass.flags[slot];
    float mass = kg_of_pieces(pass, slot);
    for (int corner = 0; corner < 8; ++corner) mass += pass.laws[word >> (4 * corner) & 15].corner;
    const float inverse = mass > 0.0f ? 1.0f / mass : 0.0f;
    const auto along = [&](uint32_t axis) { return flags & (axis | GRASPED) ? 0.0f : inverse; };
    return make_float4(along(FIX_X), along(FIX_Y), along(FIX_Z), inverse);
}

// How many nodes carry a site at most.
__device__ uint32_t row_length(const Contact& c) { return c.divides ? MAX_ROW : 8; }

// Whether two sites may share a node.
__device__ bool is_close(const Contact& c, const float4& a, const float4& b) {
    const Vec apart{b.x - a.x, b.y - a.y, b.z - a.z};
    return dot(apart, apart) <= c.reach * c.reach;
}

// Sites that a warp has found close to a place and has not yet looked at: fewer than a warp's, and those of one round.
constexpr uint32_t ROUND = 4 * 32, FOUND = ROUND + 31;

// Has a warp look at all sites close to a place, in their order, one a lane: look(site, whether there is one). Few of all sites are close: they are
// sorted out first, by loads that do not wait for each other.
template <class Look>
__device__ void look_at_close(const Contact& c, const float4& place, uint32_t sites, uint16_t* found, Look look) {
    const uint32_t lane = threadIdx.x & 31, below = (1u << lane) - 1;
    uint32_t count = 0;
#pragma unroll 1
    for (uint32_t first = 0; first < sites; first += ROUND) {
        float4 rests[ROUND / 32];
#pragma unroll
        for (uint32_t k = 0; k < ROUND / 32; ++k) rests[k] = c.site_rest[min(first + 32 * k + lane, MAX_SITES - 1)];
#pragma unroll
        for (uint32_t k = 0; k < ROUND / 32; ++k) {
            const uint32_t site = first + 32 * k + lane;
            const bool is_found = site < sites && is_close(c, place, rests[k]);
            const uint32_t all = __ballot_sync(~0u, is_found);
            if (is_found) found[count + __popc(all & below)] = site;
            count += __popc(all);
        }
        __syncwarp();
        uint32_t done = 0;
#pragma unroll 1
        for (; count - done >= 32; done += 32) look(found[done + lane], true);
        count -= done;
        const uint16_t left = lane < count ? found[done + lane] : 0;
        __syncwarp();
        if (lane < count) found[lane] = left;
        __syncwarp();
    }
    if (count) look(lane < count ? found[lane] : 0, lane < count);
    __syncwarp();
}

}  // namespace near_kernel
using namespace near_kernel;

// Marks the elements that tools may meet, and forgets the last list's carriers.
extern "C" __global__ void __launch_bounds__(THREADS) contact_near(const __grid_constant__ Contact c, const __grid_constant__ Pass pass) {
    __shared__ View views[MAX_TOOLS];
    note_start(pass);
    const Step& step = *pass.step;
    const uint32_t i = blockIdx.x * THREADS + threadIdx.x;
    for (uint32_t k = i; k < c.counts[CARRIERS]; k += gridDim.x * THREADS) {
        const uint32_t slot = c.carriers[k].slot;
        c.carrier_at[slot] = NONE;
        pass.near_tools[slot / BRICK_NODES] = 0;
    }
    if (threadIdx.x < step.tool_count) views[threadIdx.x] = view_of(step.tools[threadIdx.x], 1.0f);
    __syncthreads();
    bool near = false;
    if (c.divides) {
        near = i < c.triangles && is_near_and_divided(c, pass, views, i);
    } else {
        near = i < c.vertices && is_near(c, step, views, spot_of(c, pass, i), i);
    }
    const uint32_t bits = __ballot_sync(~0u, near), first = c.divides ? c.first_triangle : 0;
    if (bits && (threadIdx.x & 31) == 0) c.near_bits[(first + i) / 32] = bits;
}

// Lists the marked elements in their order, and counts their sites.
extern "C" __global__ void __launch_bounds__(LIST_THREADS) contact_list(const __grid_constant__ Contact c, const __grid_constant__ Pass pass) {
    const uint32_t words = (c.divides ? c.first_triangle + c.triangles + 31 : c.vertices + 31) / 32;
    uint32_t count = 0, sites = 0, total;
    for (uint32_t first = 0; first < words; first += LIST_THREADS) {
        const uint32_t word = first + threadIdx.x;
        uint32_t bits = word < words ? c.near_bits[word] : 0;
        if (bits) c.near_bits[word] = 0;
        uint32_t at = count + scan<LIST_THREADS / 32>(__popc(bits), total);
        for (; bits; bits &= bits - 1, ++at) {
            if (at < MAX_SITES) c.near[at] = word * 32 + __ffs(bits) - 1;
        }
        count += total;
    }
    const uint32_t near = min(count, MAX_SITES);
    if (c.divides) {
        for (uint32_t first = 0; first < near; first += LIST_THREADS) {
            // All that was listed can be read after the first scan's barriers.
            __syncthreads();
            const uint32_t at = first + threadIdx.x, start = sites + scan<LIST_THREADS / 32>(at < near ? sites_on(c, c.near[at]) : 0, total);
            if (at < near) c.near_starts[at] = start;
            sites += total;
        }
    } else {
        sites = near;
    }
    if (threadIdx.x == 0) {
        c.counts[DROPPED] += count - near + sites - min(sites, MAX_SITES);
        c.counts[NEAR] = near;
        c.counts[SITES] = min(sites, MAX_SITES);
        c.counts[CARRIERS] = c.counts[LOADS] = 0;
        pass.near_counts[AWAKE] = 0;
    }
}

// Makes the sites, each with the nodes that carry it.
extern "C" __global__ void __launch_bounds__(THREADS) contact_sites(const __grid_constant__ Contact c, const __grid_constant__ Pass pass) {
    const uint32_t site = blockIdx.x * THREADS + threadIdx.x;
    if (site >= c.counts[SITES]) return;
    // The last element that begins no later.
    uint32_t at = site;
    if (c.divides) {
        at = 0;
        for (uint32_t end = c.counts[NEAR]; end - at > 1;) {
            const uint32_t middle = (at + end) / 2;
            (c.near_starts[middle] <= site ? at : end) = middle;
        }
    }
    const uint32_t element = c.near[at];
    uint32_t division = 1;
    float most = 0.0f;
    // Eight nodes of a row, from a place on. Who is first to put weight on a node makes a carrier of it.
    const auto put = [&](uint32_t place, const uint32_t slots[8], const float weights[8]) {
        float4 mobilities[8];
        bool is_first[8];
#pragma unroll
        for (int i = 0; i < 8; ++i) {
            c.site_slots[(place + i) * MAX_SITES + site] = slots[i];
            c.site_weights[(place + i) * MAX_SITES + site] = weights[i];
            mobilities[i] = mobility_of(pass, slots[i]);
        }
#pragma unroll
        for (int i = 0; i < 8; ++i) is_first[i] = weights[i] != 0.0f && atomicCAS(&c.carrier_at[slots[i]], NONE, 0) == NONE;
#pragma unroll
        for (int i = 0; i < 8; ++i) {
            const float4& mobility = mobilities[i];
            most = fmaxf(most, fabsf(weights[i]) * fmaxf(mobility.x, fmaxf(mobility.y, mobility.z)));
            if (!is_first[i]) continue;
            const uint32_t carrier = atomicAdd(&c.counts[CARRIERS], 1);
            c.carrier_at[slots[i]] = carrier;
            c.carriers[carrier] = {slots[i], 0, 0, site};
            c.mobility[carrier] = mobility;
        }
    };
    constexpr uint32_t NO_SLOTS[8] = {};
    constexpr float NO_WEIGHTS[8] = {};
    Vec rest;
    if (element < c.first_triangle) {
        rest = rest_of(c, element);
        c.site_edges[site] = c.vertex_edges[element];
        const NodeRow row = row_of(c, element);
        put(0, row.node, row.weight);
#pragma unroll 1
        for (uint32_t i = 8; i < row_length(c); i += 8) put(i, NO_SLOTS, NO_WEIGHTS);
    } else {
        const uint32_t triangle = element - c.first_triangle, *corners = c.corners + 3 * triangle;
        c.site_edges[site] = c.triangle_edges[triangle];
        uint32_t small = site - c.near_starts[at];
        for (uint32_t all = c.divisions[triangle];; all &= all - 1, small -= division * division) {
            division = __ffs(all);
            if (small < division * division) break;
        }
        const Vec share = centre(small, division);
        const float shares[3] = {share.x, share.y, share.z};
        rest = rest_of(c, corners[0]) * share.x + rest_of(c, corners[1]) * share.y + rest_of(c, corners[2]) * share.z;
        // Nodes that corners have in common come once.
        uint32_t slots[MAX_ROW] = {}, count = 0;
        float weights[MAX_ROW] = {};
#pragma unroll 1
        for (int corner = 0; corner < 3; ++corner) {
            const NodeRow row = row_of(c, corners[corner]);
#pragma unroll
            for (int i = 0; i < 8; ++i) {
                uint32_t at = 0;
                while (at < count && slots[at] != row.node[i]) ++at;
                if (at == count) slots[count++] = row.node[i];
                weights[at] += shares[corner] * row.weight[i];
            }
        }
#pragma unroll 1
        for (uint32_t i = 0; i < MAX_ROW; i += 8) put(i, slots + i, weights + i);
    }
    c.site_rest[site] = make_float4(rest.x, rest.y, rest.z, most);
    c.site_names[site] = make_uint2(element, division);
}

// Which sites each node carries, in their order: a warp for each node. Its brick is listed.
extern "C" __global__ void __launch_bounds__(THREADS) contact_carry(const __grid_constant__ Contact c, const __grid_constant__ Pass pass) {
    __shared__ uint16_t found[WARPS][FOUND];
    const uint32_t lane = threadIdx.x & 31, warp = threadIdx.x / 32, sites = c.counts[SITES], carriers = c.counts[CARRIERS], row = row_length(c);
    for (uint32_t carrier = blockIdx.x * WARPS + warp; carrier < carriers; carrier += gridDim.x * WARPS) {
        const Carrier known = c.carriers[carrier];
        const float4 rest = c.site_rest[known.name];
        // Counted first, written then.
        uint32_t start = 0, count = 0;
#pragma unroll 1
        for (int round = 0; round < 2; ++round) {
            count = 0;
            look_at_close(c, rest, sites, found[warp], [&](uint32_t site, bool is_there) {
                float weight = 0.0f;
                // Eight at a time, so that their loads do not wait for each other.
#pragma unroll 8
                for (uint32_t i = 0; i < row; ++i) {
                    const float w = c.site_weights[i * MAX_SITES + site];
                    if (is_there && c.site_slots[i * MAX_SITES + site] == known.slot && w != 0.0f) weight = w;
                }
                const uint32_t carried = __ballot_sync(~0u, weight != 0.0f);
                if (round == 1 && weight != 0.0f) c.loads[start + count + __popc(carried & ((1u << lane) - 1))] = {site, weight};
                count += __popc(carried);
            });
            if (round == 0) {
                if (lane == 0) start = atomicAdd(&c.counts[LOADS], count);
                start = __shfl_sync(~0u, start, 0);
            }
        }
        if (lane > 0) continue;
        c.carriers[carrier] = {known.slot, start, count, carrier};
        const uint32_t brick = known.slot / BRICK_NODES;
        if (atomicExch(&pass.near_tools[brick], 1) == 0) pass.near_bricks[atomicAdd(&pass.near_counts[AWAKE], 1)] = brick;
    }
}

// What impulses on the sites do to each other, in the order of the sites: a warp for each site.
extern "C" __global__ void __launch_bounds__(THREADS) contact_couple(const __grid_constant__ Contact c) {
    __shared__ uint32_t slots[WARPS][MAX_ROW];
    __shared__ float weights[WARPS][MAX_ROW];
    __shared__ float4 mobilities[WARPS][MAX_ROW];
    __shared__ uint16_t found[WARPS][FOUND];
    const uint32_t lane = threadIdx.x & 31, warp = threadIdx.x / 32, sites = c.counts[SITES], row = row_length(c);
    for (uint32_t site = blockIdx.x * WARPS + warp; site < sites; site += gridDim.x * WARPS) {
        const float4 rest = c.site_rest[site];
        if (lane < row) {
            const uint32_t at = lane * MAX_SITES + site, slot = c.site_slots[at];
            const float weight = c.site_weights[at];
            const Carrier carrier = weight != 0.0f ? c.carriers[c.carrier_at[slot]] : Carrier{0, 0, 0, NONE};
            c.site_carriers[at] = carrier;
            slots[warp][lane] = slot;
            weights[warp][lane] = weight;
            mobilities[warp][lane] = weight != 0.0f ? c.mobility[carrier.name] : make_float4(0, 0, 0, 0);
        }
        __syncwarp();
        const uint32_t start = site * MAX_COUPLED;
        uint32_t count = 0;
        bool is_even = true;
        look_at_close(c, rest, sites, found[warp], [&](uint32_t other, bool is_there) {
            float4 by = make_float4(0, 0, 0, 0);
#pragma unroll 8
            for (uint32_t i = 0; i < row; ++i) {
                const float w = is_there ? c.site_weights[i * MAX_SITES + other] : 0.0f;
                const uint32_t on = c.site_slots[i * MAX_SITES + other];
                // A node comes once in a row; what is not there weighs nothing.
                uint32_t at = row;
#pragma unroll 8
                for (uint32_t j = 0; j < row; ++j) at = slots[warp][j] == on && weights[warp][j] != 0.0f ? j : at;
                if (at == row) continue;
                const float share = w * weights[warp][at];
                const float4 m = mobilities[warp][at];
                by.x += share * m.x, by.y += share * m.y, by.z += share * m.z, by.w += share * m.w;
            }
            const bool is_coupled = by.x != 0.0f || by.y != 0.0f || by.z != 0.0f;
            const uint32_t coupled = __ballot_sync(~0u, is_coupled);
            const uint32_t at = count + __popc(coupled & ((1u << lane) - 1));
            is_even = is_even && by.x == by.y && by.x == by.z;
            if (is_coupled && at < MAX_COUPLED) c.couplings[start + at] = {other, by.x};
            if (is_there && other == site) c.site_own[site] = by;
            count += __popc(coupled);
        });
        for (uint32_t at = count + lane; at < MAX_COUPLED; at += 32) c.couplings[start + at] = {0, 0.0f};
        is_even = __all_sync(~0u, is_even);
        if (lane == 0) c.site_coupled[site] = is_even ? count : UNEVEN;
        __syncwarp();
    }
}
