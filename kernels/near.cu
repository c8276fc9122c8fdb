// Which sites of the surface tools may meet, and what they have to do with each other. Made once for many steps: what follows from it stays good
// while tools and tissue stay within the margin, for rows and masses do not change.
#include "block.cuh"
#include "clock.cuh"
#include "contact.cuh"
#include "layout.cuh"

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

// Whether a vertex is so close to the way of a tool that a site on it, or on a triangle around it, may be met.
__device__ bool is_near(const Contact& c, const Pass& pass, uint32_t vertex) {
    const Step& step = *pass.step;
    const NodeRow row = row_of(c, vertex);
    Vec moved{0, 0, 0};
    for (int i = 0; i < 8; ++i) {
        const float4 d = pass.u[row.node[i]];
        moved = moved + Vec{d.x, d.y, d.z} * row.weight[i];
    }
    const Vec rest = rest_of(c, vertex);
    bool near = false;
    for (uint32_t t = 0; t < step.tool_count; ++t) {
        const ToolStep& tool = step.tools[t];
        // From the nearest point of the way; large numbers subtract in double precision.
        const Vec way{float(tool.to[0] - tool.from[0]), float(tool.to[1] - tool.from[1]), float(tool.to[2] - tool.from[2])};
        const Vec at = Vec{float(double(rest.x) - tool.from[0]), float(double(rest.y) - tool.from[1]), float(double(rest.z) - tool.from[2])} + moved;
        const float along = dot(way, way) > 0.0f ? clamp(dot(at, way) / dot(way, way), 0.0f, 1.0f) : 0.0f;
        near = near || norm(at - way * along) < tool.radius + step.margin + c.edge;
    }
    return near;
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
    float mass = 0.0f;
    for (int corner = 0; corner < 8; ++corner) mass += pass.laws[word >> (4 * corner) & 15].corner;
    const float inverse = mass > 0.0f ? 1.0f / mass : 0.0f;
    return make_float4(flags & 1 ? 0.0f : inverse, flags & 2 ? 0.0f : inverse, flags & 4 ? 0.0f : inverse, inverse);
}

// How many nodes carry a site at most.
__device__ uint32_t row_length(const Contact& c) { return c.division > 1 ? MAX_ROW : 8; }

// Whether two sites may share a node.
__device__ bool is_close(const Contact& c, const float4& a, const float4& b) {
    const Vec apart{b.x - a.x, b.y - a.y, b.z - a.z};
    return dot(apart, apart) <= c.reach * c.reach;
}

}  // namespace near_kernel
using namespace near_kernel;

// Marks the elements that a tool may meet, and forgets the last list's carriers.
extern "C" __global__ void __launch_bounds__(THREADS) contact_near(const __grid_constant__ Contact c, const __grid_constant__ Pass pass) {
    note_start(pass);
    const uint32_t elements = c.division > 1 ? c.triangles : c.vertices;
    const uint32_t element = blockIdx.x * THREADS + threadIdx.x;
    for (uint32_t i = element; i < c.counts[CARRIERS]; i += gridDim.x * THREADS) c.carrier_at[c.carriers[i].slot] = NONE;
    bool near = false;
    if (element < elements) {
        if (c.division > 1) {
            for (int i = 0; i < 3; ++i) near = near || is_near(c, pass, c.corners[3 * element + i]);
        } else {
            near = is_near(c, pass, element);
        }
    }
    const uint32_t bits = __ballot_sync(~0u, near);
    if ((threadIdx.x & 31) == 0 && element < elements) c.near_bits[element / 32] = bits;
}

// Lists the marked elements in their order.
extern "C" __global__ void __launch_bounds__(LIST_THREADS) contact_list(const __grid_constant__ Contact c) {
    const uint32_t elements = c.division > 1 ? c.triangles : c.vertices, words = (elements + 31) / 32;
    uint32_t count = 0;
    for (uint32_t first = 0; first < words; first += LIST_THREADS) {
        const uint32_t word = first + threadIdx.x;
        uint32_t bits = word < words ? c.near_bits[word] : 0, total;
        uint32_t at = count + scan<LIST_THREADS / 32>(__popc(bits), total);
        for (; bits; bits &= bits - 1, ++at) {
            if (at < MAX_SITES) c.near[at] = word * 32 + __ffs(bits) - 1;
        }
        count += total;
    }
    if (threadIdx.x == 0) {
        const uint32_t of_each = c.division * c.division, most = MAX_SITES / of_each;
        if (count > most) c.counts[DROPPED] += (count - most) * of_each;
        c.counts[NEAR] = min(count, most);
        c.counts[SITES] = min(count, most) * of_each;
        c.counts[CARRIERS] = c.counts[LOADS] = 0;
    }
}

// Makes the sites, each with the nodes that carry it and with the last list's points on it.
extern "C" __global__ void __launch_bounds__(THREADS) contact_sites(const __grid_constant__ Contact c, const __grid_constant__ Pass pass) {
    const uint32_t site = blockIdx.x * THREADS + threadIdx.x;
    if (site >= c.counts[SITES]) return;
    const uint32_t of_each = c.division * c.division, element = c.near[site / of_each], small = site % of_each, name = element * of_each + small;
    float most = 0.0f;
    // Who is first to put weight on a node makes a carrier of it.
    const auto put = [&](uint32_t place, uint32_t slot, float weight) {
        c.site_slots[place * MAX_SITES + site] = slot;
        c.site_weights[place * MAX_SITES + site] = weight;
        if (weight == 0.0f) return;
        const float4 mobility = mobility_of(pass, slot);
        most = fmaxf(most, fabsf(weight) * fmaxf(mobility.x, fmaxf(mobility.y, mobility.z)));
        if (atomicCAS(&c.carrier_at[slot], NONE, 0) != NONE) return;
        const uint32_t carrier = atomicAdd(&c.counts[CARRIERS], 1);
        c.carrier_at[slot] = carrier;
        c.carriers[carrier] = {slot, 0, 0, site};
        c.mobility[carrier] = mobility;
    };
    uint32_t vertex = element;
    Vec rest;
    if (c.division == 1) {
        rest = rest_of(c, vertex);
        const NodeRow row = row_of(c, vertex);
#pragma unroll
        for (int i = 0; i < 8; ++i) put(i, row.node[i], row.weight[i]);
    } else {
        const uint32_t* corners = c.corners + 3 * element;
        const Vec share = centre(small, c.division);
        const float shares[3] = {share.x, share.y, share.z};
        vertex = corners[0];
        rest = rest_of(c, corners[0]) * share.x + rest_of(c, corners[1]) * share.y + rest_of(c, corners[2]) * share.z;
        // Nodes that corners have in common come once.
        uint32_t slots[MAX_ROW], count = 0;
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
        for (uint32_t i = 0; i < MAX_ROW; ++i) put(i, i < count ? slots[i] : 0, i < count ? weights[i] : 0.0f);
    }
    c.site_rest[site] = make_float4(rest.x, rest.y, rest.z, most);
    c.site_names[site] = make_uint2(vertex, name);
    // Points of the last time keep their names; they lie in the order of their sites.
    const uint32_t tag = c.counts[TAG], count_of_points = c.counts[POINTS];
    const float4* const names = c.points + ((tag & 1) * POINT_FIELDS + NAMES) * MAX_POINTS;
    uint32_t first = 0, points = 0;
#pragma unroll 8
    for (uint32_t k = 0; k < count_of_points; ++k) {
        if (__float_as_uint(names[k].z) != name) continue;
        if (points++ == 0) first = k;
    }
    c.touches[(tag & 1) * MAX_SITES + site] = make_uint2(points ? tag : tag - 2, first | points << 16);
}

// Which sites each node carries, in their order: a warp for each node.
extern "C" __global__ void __launch_bounds__(THREADS) contact_carry(const __grid_constant__ Contact c) {
    const uint32_t lane = threadIdx.x & 31, sites = c.counts[SITES], carriers = c.counts[CARRIERS], row = row_length(c);
    for (uint32_t carrier = blockIdx.x * WARPS + threadIdx.x / 32; carrier < carriers; carrier += gridDim.x * WARPS) {
        const Carrier known = c.carriers[carrier];
        const float4 rest = c.site_rest[known.name];
        // Counted first, written then.
        uint32_t start = 0, count = 0;
#pragma unroll 1
        for (int round = 0; round < 2; ++round) {
            count = 0;
#pragma unroll 1
            for (uint32_t first = 0; first < sites; first += 32) {
                const uint32_t site = first + lane;
                float weight = 0.0f;
                if (site < sites && is_close(c, rest, c.site_rest[site])) {
                    // Eight at a time, so that their loads do not wait for each other.
#pragma unroll 8
                    for (uint32_t i = 0; i < row; ++i) {
                        const float w = c.site_weights[i * MAX_SITES + site];
                        if (c.site_slots[i * MAX_SITES + site] == known.slot && w != 0.0f) weight = w;
                    }
                }
                const uint32_t carried = __ballot_sync(~0u, weight != 0.0f);
                if (round == 1 && weight != 0.0f) c.loads[start + count + __popc(carried & ((1u << lane) - 1))] = {site, weight};
                count += __popc(carried);
            }
            if (round == 0) {
                if (lane == 0) start = atomicAdd(&c.counts[LOADS], count);
                start = __shfl_sync(~0u, start, 0);
            }
        }
        if (lane == 0) c.carriers[carrier] = {known.slot, start, count, carrier};
    }
}

// What impulses on the sites do to each other, in the order of the sites: a warp for each site.
extern "C" __global__ void __launch_bounds__(THREADS) contact_couple(const __grid_constant__ Contact c) {
    __shared__ uint32_t slots[WARPS][MAX_ROW];
    __shared__ float weights[WARPS][MAX_ROW];
    __shared__ float4 mobilities[WARPS][MAX_ROW];
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
#pragma unroll 1
        for (uint32_t first = 0; first < sites; first += 32) {
            const uint32_t other = first + lane;
            float4 by = make_float4(0, 0, 0, 0);
            if (other < sites && is_close(c, rest, c.site_rest[other])) {
#pragma unroll 8
                for (uint32_t i = 0; i < row; ++i) {
                    const float w = c.site_weights[i * MAX_SITES + other];
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
            }
            const bool is_coupled = by.x != 0.0f || by.y != 0.0f || by.z != 0.0f;
            const uint32_t coupled = __ballot_sync(~0u, is_coupled);
            const uint32_t at = count + __popc(coupled & ((1u << lane) - 1));
            if (is_coupled && at < MAX_COUPLED) c.couplings[start + at] = make_float4(by.x, by.y, by.z, __uint_as_float(other));
            if (other == site) c.site_own[site] = by;
            count += __popc(coupled);
        }
        for (uint32_t at = count + lane; at < MAX_COUPLED; at += 32) c.couplings[start + at] = make_float4(0, 0, 0, 0);
        if (lane == 0) c.site_coupled[site] = count;
        __syncwarp();
    }
}
