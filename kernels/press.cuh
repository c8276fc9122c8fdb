// Contact inside the implicit step: what one block does beside those that work on bricks. See src/cpu/efg/press.rs for what it means.
//
// It finds the points that tools may meet while the others build the system, and then has its own part of A: what contact adds to A times a vector it gathers
// on the nodes that carry points, for the others to add.
#pragma once
#include "block.cuh"
#include "contact.cuh"
#include "efg.cuh"
#include "field.cuh"
#include "grid.cuh"
#include "layout.cuh"
#include "points.cuh"
#include "tool.cuh"

namespace efg_kernel {

// How much stiffer a contact is than what carries it.
constexpr double CONTACT_STIFFNESS = 50.0;
// Change of an impulse, as a share of the largest, that asks for another solution.
constexpr double SETTLED = 5e-3;
// Threads that care for a site or a carrier.
constexpr int LANES = 8;
// Most threads of a block.
constexpr int MOST_THREADS = 1024;

// What the block's threads share.
struct PressShared {
    Active sites;
    ToolStep tools[MAX_TOOLS];
    View now[MAX_TOOLS], before[MAX_TOOLS];
    uint32_t moved;
};

template <class R>
__device__ __forceinline__ R group_sum(R x) {
    for (int step = 1; step < LANES; step *= 2) x += __shfl_xor_sync(~0u, x, step);
    return x;
}

// Adds to a node's block on A's diagonal, which is known by its inverse.
template <class R>
__device__ __forceinline__ void stiffen(const Efg& e, uint32_t slot, const Block<double>& by) {
    const Block<R> m = block_of<R>(e.inverse, slot);
    const Block<double> was = inverted(Block<double>{m.xx, m.xy, m.xz, m.yy, m.yz, m.zz});
    const Block<double> now = inverted(Block<double>{was.xx + by.xx, was.xy + by.xy, was.xz + by.xz, was.yy + by.yy, was.yz + by.yz, was.zz + by.zz});
    set_block<R>(e.inverse, slot, {R(now.xx), R(now.xy), R(now.xz), R(now.yy), R(now.yz), R(now.zz)});
}

template <class R>
struct Press {
    const Efg& e;
    const Contact& c;
    PressShared& s;
    const EfgStep& step;
    const uint32_t threads = blockDim.x;
    // Active sites, and points.
    uint32_t active = 0, count = 0;

    __device__ Press(const Efg& e, const Contact& c, PressShared& s) : e(e), c(c), s(s), step(*e.step) {}

    __device__ R& field(int f, uint32_t k) const { return static_cast<R*>(e.press)[size_t(f) * MAX_POINTS + k]; }
    __device__ float4& point(int f, uint32_t k) const { return c.points[f * MAX_POINTS + k]; }
    __device__ V3<R> normal(uint32_t k) const { return {R(point(NORMAL, k).x), R(point(NORMAL, k).y), R(point(NORMAL, k).z)}; }
    __device__ V3<R> vector(int f, uint32_t a) const { return {field(f, a), field(f + 1, a), field(f + 2, a)}; }
    __device__ void set(int f, uint32_t a, const V3<R>& v) const { field(f, a) = v.x, field(f + 1, a) = v.y, field(f + 2, a) = v.z; }
    // The active site of a point, and whether it can be moved; see PointField.
    __device__ uint32_t site_of(uint32_t k) const { return __float_as_uint(point(NAMES, k).z); }
    __device__ bool is_movable(uint32_t k) const { return point(NAMES, k).w != 0.0f; }
    __device__ const ToolStep& tool_of(uint32_t k) const { return s.tools[__float_as_uint(point(NAMES, k).x)]; }
    __device__ V3<R> tool_velocity(uint32_t k) const {
        const Vec v = velocity_of(tool_of(k), vec(point(AT, k)), step.step.duration);
        return {R(v.x), R(v.y), R(v.z)};
    }
    __device__ uint32_t row() const { return c.divides ? MAX_ROW : LANES; }

    // A point that meets a tool at the end of the step, or may come to.
    struct Met {
        Nearest nearest;
        Vec at;
        float travel;
        bool was_inside;
    };

    __device__ __forceinline__ Met probe(const Vec& rest, const Vec& moved, float edge, int division, uint32_t t) const {
        constexpr Nearest NOTHING{INFINITY, {0, 0, 1}, 0};
        const ToolStep& tool = s.tools[t];
        const View &now = s.now[t], &before = s.before[t];
        Met m{NOTHING, from_tool(rest, now) + moved, 0.0f, false};
        const Vec end = rotate(conjugate(now.turn), m.at), start = rotate(conjugate(before.turn), from_tool(rest, before) + moved);
        m.travel = norm(end - start);
        const float strides = m.travel / tool.stride, far = tool.radius + step.reach;
        if (strides <= 1.0f && dot(m.at, m.at) >= far * far) return m;
        const Part* const parts = c.parts + tool.part;
        if (strides <= 1.0f) {
            m.nearest = tool_distance(parts, tool.part_count, end);
            if (m.nearest.distance >= step.reach) m.nearest = NOTHING;
        } else {
            m.nearest = meet(parts, tool.part_count, start, end, strides);
        }
        if (m.nearest.distance == INFINITY) return m;
        if (part_division(parts[m.nearest.part], edge) != division) m.nearest = NOTHING;
        m.was_inside = tool_distance(parts, tool.part_count, start).distance < 0.0f;
        return m;
    }

    // Finds all points in the order of sites and tools, nodes being where they are at the start of the step.
    __device__ void find() {
        const uint32_t thread = threadIdx.x, tools = step.step.tool_count, sites = tools ? c.counts[SITES] : 0;
        for (uint32_t i = thread; i < tools * (sizeof(ToolStep) / 4); i += threads) {
            reinterpret_cast<uint32_t*>(s.tools)[i] = reinterpret_cast<const uint32_t*>(step.step.tools)[i];
        }
        __syncthreads();
        for (uint32_t i = thread; i < 2 * tools; i += threads) {
            (i % 2 ? s.before : s.now)[i / 2] = view_of(s.tools[i / 2], i % 2 ? step.from : step.to);
        }
        __syncthreads();
#pragma unroll 1
        for (uint32_t first = 0; first < sites; first += threads) {
            const uint32_t site = min(first + thread, sites - 1);
            const bool is_there = first + thread < sites;
            const float4 rest = c.site_rest[site], own = c.site_own[site];
            const uint2 names = c.site_names[site];
            const float edge = c.site_edges[site];
            Vec moved{0, 0, 0};
#pragma unroll 8
            for (uint32_t i = 0; i < row(); ++i) {
                moved = moved + vec(e.shown[c.site_slots[i * MAX_SITES + site]]) * c.site_weights[i * MAX_SITES + site];
            }
            uint64_t met = 0;
#pragma unroll 1
            for (uint32_t t = 0; t < tools && is_there; ++t) {
                met |= uint64_t(probe(vec(rest), moved, edge, int(names.y), t).nearest.distance < INFINITY) << t;
            }
            const uint32_t mine = min(__popcll(met), MOST_OF_SITE);
            uint32_t total;
            const uint32_t sum = scan<MOST_THREADS / 32>(mine | (mine ? 1u << 16 : 0), total, threads / 32), a = active + (sum >> 16);
            uint32_t k = count + (sum & 0xffff);
            // Sites whose points find no room are the last.
            const bool is_active = mine && k + mine <= MAX_POINTS;
            if (mine && !is_active) atomicAdd(&c.counts[DROPPED], mine);
            if (is_there) s.sites.of[site] = is_active ? a : NOT_ACTIVE;
            if (is_active) {
                s.sites.site[a] = site;
                s.sites.first[a] = k;
            }
            const uint32_t kept = __syncthreads_count(is_active);
            // Of those that are kept, the last says how many points there are.
            if (is_active && a + 1 == active + kept) s.sites.first[a + 1] = k + mine;
            __syncthreads();
            active += kept;
            count = active ? s.sites.first[active] : 0;
#pragma unroll 1
            for (uint32_t t = 0; t < tools && is_active && k < s.sites.first[a] + mine; ++t) {
                if (met >> t & 1) note(k++, a, t, probe(vec(rest), moved, edge, int(names.y), t), own, rest.w, names.x);
            }
            __syncthreads();
        }
        if (thread == 0) {
            s.moved = 0;
            c.counts[POINTS] = count;
            c.counts[ROUND] += 1;
            c.counts[PUSHED] = 0;
        }
        __syncthreads();
    }

    // Writes down a point of an active site: `own` is what an impulse on it changes of its velocity, `share` how much of that its fastest node has at most.
    __device__ void note(uint32_t k, uint32_t a, uint32_t t, const Met& m, const float4& own, float share, uint32_t element) const {
        const Vec n = rotate(s.now[t].turn, m.nearest.normal);
        const float free = own.x * n.x * n.x + (own.y * n.y * n.y + own.z * n.z * n.z), depth = -m.nearest.distance;
        const bool is_movable = free > MOVABLE * own.w;
        const float mass = 1.0f / (is_movable ? free : own.w), lever = 1.0f / fmaxf(1.0f, share * mass);
        const float target = fminf(depth, (step.step.push_limit + m.travel) * lever);
        const bool is_touched = is_movable && (target > 0.0f || m.was_inside);
        point(NORMAL, k) = with(n, target);
        point(AT, k) = with(m.at, fmaxf(depth, 0.0f));
        point(NAMES, k) = make_float4(__uint_as_float(t), __uint_as_float(element), __uint_as_float(a), is_movable ? 1.0f : 0.0f);
        point(IMPULSE, k) = make_float4(0, 0, 0, is_movable ? 0.0f : float(step.wall * point(AT, k).w * step.dt));
        field(WANTED, k) = R(target / step.dt);
        field(IS_PUSHED, k) = field(NEXT_IS_PUSHED, k) = is_touched ? R(1) : R(0);
    }

    // How many points of an active site are pushed.
    __device__ uint32_t pushed_on(uint32_t a) const {
        uint32_t pushed = 0;
        for (uint32_t k = s.sites.first[a]; k < s.sites.first[a + 1]; ++k) pushed += field(IS_PUSHED, k) != R(0);
        return pushed;
    }

    // Lists the nodes that carry points with what they carry.
    __device__ void list() {
        const uint32_t thread = threadIdx.x, lane = thread % LANES, group = thread / LANES, shift = thread & 24, mask = 0xffu << shift;
        const uint32_t round = c.counts[ROUND];
        R* const shares = static_cast<R*>(e.shares);
        R* const touched = static_cast<R*>(e.touched);
        for (uint32_t i = thread; i < 3 * c.counts[CARRIERS]; i += threads) touched[i] = R(0);
        // Each carrier once: who comes first claims it, and nothing hangs on who that is.
#pragma unroll 1
        for (uint32_t job = thread; job < active * row(); job += threads) {
            const uint32_t on = c.site_carriers[job % row() * MAX_SITES + s.sites.site[job / row()]].name;
            if (on == ~0u || atomicExch(&c.claimed[on], round) == round) continue;
            c.moved[atomicAdd(&s.moved, 1)] = {on, 0};
        }
        __syncthreads();
        // A group for each gathers its loads on active sites, and how much all points together put on it.
#pragma unroll 1
        for (uint32_t n = group; n < s.moved; n += threads / LANES) {
            const uint32_t on = c.moved[n].x;
            const Carrier carrier = c.carriers[on];
            uint32_t loads = 0;
            R share = R(0);
            for (uint32_t first = 0; first < carrier.count; first += LANES) {
                const uint32_t i = first + lane;
                const Load load = i < carrier.count ? c.loads[carrier.start + i] : Load{s.sites.site[0], 0.0f};
                const uint32_t a = s.sites.of[load.site];
                const bool is_active = i < carrier.count && a != NOT_ACTIVE;
                const uint32_t actives = __ballot_sync(mask, is_active) >> shift & 0xff;
                if (is_active) {
                    c.active_loads[carrier.start + loads + __popc(actives & ((1u << lane) - 1))] = {a, load.weight};
                    share += R(fabsf(load.weight)) * R(pushed_on(a));
                }
                loads += __popc(actives);
            }
            for (int half = 1; half < LANES; half *= 2) share += __shfl_xor_sync(mask, share, half);
            if (lane > 0) continue;
            c.moved[n].y = loads;
            shares[on] = share;
        }
        __syncthreads();
    }

    // Says how stiff points are, and adds them to the blocks on A's diagonal.
    __device__ void begin() const {
        const uint32_t lane = threadIdx.x % LANES, group = threadIdx.x / LANES;
        const R* const shares = static_cast<const R*>(e.shares);
        // As many points as share a node share the stiffness that it takes.
#pragma unroll 1
        for (uint32_t first = 0; first < count; first += threads / LANES) {
            const uint32_t k = min(first + group, count - 1), site = s.sites.site[site_of(k)];
            const V3<R> n = normal(k);
            R yielding = R(0);
            for (uint32_t i = lane; i < row(); i += LANES) {
                const R weight = fabsf(c.site_weights[i * MAX_SITES + site]);
                if (weight == R(0)) continue;
                const Carrier carrier = c.site_carriers[i * MAX_SITES + site];
                yielding += weight * larger(shares[carrier.name], weight) * dot(n, product(block_of<R>(e.inverse, carrier.slot), n));
            }
            yielding = group_sum(yielding);
            if (lane > 0 || first + group >= count) continue;
            field(STIFFNESS, k) = R(CONTACT_STIFFNESS) / yielding;
            // At first everything in contact sticks.
            field(GRIP, k) = field(NEXT_GRIP, k) = tool_of(k).friction > 0.0f ? field(STIFFNESS, k) : R(0);
        }
        __syncthreads();
        stiffen();
        __syncthreads();
    }

    // Adds what points on a carrier resist by to its block on A's diagonal.
    __device__ void stiffen() const {
        const uint32_t lane = threadIdx.x % LANES, group = threadIdx.x / LANES;
#pragma unroll 1
        for (uint32_t first = 0; first < s.moved; first += threads / LANES) {
            const uint2 known = c.moved[min(first + group, s.moved - 1)];
            const Carrier carrier = c.carriers[known.x];
            Block<double> sum{};
            for (uint32_t i = carrier.start + lane; i < carrier.start + known.y; i += LANES) {
                const Load load = c.active_loads[i];
                const double share = double(load.weight) * double(load.weight);
                for (uint32_t k = s.sites.first[load.site]; k < s.sites.first[load.site + 1]; ++k) {
                    if (field(IS_PUSHED, k) == R(0)) continue;
                    const V3<R> n = normal(k);
                    const double grip = field(GRIP, k) * share, more = (field(STIFFNESS, k) - field(GRIP, k)) * share;
                    sum.xx += grip + more * n.x * n.x, sum.xy += more * n.x * n.y, sum.xz += more * n.x * n.z;
                    sum.yy += grip + more * n.y * n.y, sum.yz += more * n.y * n.z, sum.zz += grip + more * n.z * n.z;
                }
            }
            sum = {group_sum(sum.xx), group_sum(sum.xy), group_sum(sum.xz), group_sum(sum.yy), group_sum(sum.yz), group_sum(sum.zz)};
            if (lane > 0 || first + group >= s.moved) continue;
            efg_kernel::stiffen<R>(e, carrier.slot, sum);
        }
    }

    // Gathers on carriers what contact adds to A times a field, less what it adds to b where that is wanted. Gives the thread's part of its product with the field.
    __device__ double touch(const void* of, bool less_wanted) const {
        const uint32_t lane = threadIdx.x % LANES, group = threadIdx.x / LANES;
        double work = 0.0;
        // Groups of a warp stay together.
#pragma unroll 1
        for (uint32_t first = 0; first < active; first += threads / LANES) {
            const uint32_t a = min(first + group, active - 1), site = s.sites.site[a];
            V3<R> moving{0, 0, 0};
            for (uint32_t i = lane; i < row(); i += LANES) {
                const uint32_t at = i * MAX_SITES + site;
                moving = plus(moving, vector_of<R>(of, c.site_slots[at]), R(c.site_weights[at]));
            }
            moving = {group_sum(moving.x), group_sum(moving.y), group_sum(moving.z)};
            if (lane > 0 || first + group >= active) continue;
            V3<R> answer{0, 0, 0};
            for (uint32_t k = s.sites.first[a]; k < s.sites.first[a + 1]; ++k) {
                if (field(IS_PUSHED, k) == R(0)) continue;
                const V3<R> n = normal(k);
                R push = dot(moving, n);
                V3<R> slip = across(moving, n);
                if (less_wanted) {
                    push -= field(WANTED, k);
                    slip = plus(slip, across(tool_velocity(k), n), R(-1));
                }
                answer = plus(plus(answer, n, field(STIFFNESS, k) * push), slip, field(GRIP, k));
            }
            work += double(dot(moving, answer));
            set(MOVING, a, moving);
            set(ANSWER, a, answer);
        }
        __syncthreads();
        R* const touched = static_cast<R*>(e.touched);
#pragma unroll 1
        for (uint32_t first = 0; first < s.moved; first += threads / LANES) {
            const uint2 known = c.moved[min(first + group, s.moved - 1)];
            const uint32_t start = c.carriers[known.x].start;
            V3<R> sum{0, 0, 0};
            for (uint32_t i = start + lane; i < start + known.y; i += LANES) {
                const Load load = c.active_loads[i];
                sum = plus(sum, vector(ANSWER, load.site), R(load.weight));
            }
            sum = {group_sum(sum.x), group_sum(sum.y), group_sum(sum.z)};
            if (lane > 0 || first + group >= s.moved) continue;
            R* const on = touched + 3 * known.x;
            on[0] = sum.x, on[1] = sum.y, on[2] = sum.z;
        }
        return work;
    }

    // Reads impulses from how sites move in a solution, and the laws that it asks for. Whether it was found with those; `most` says of what else there is the largest impulse, and by how much
    // one is wrong.
    __device__ bool judge(double (&most)[2], double* scratch) const {
        double &largest = most[0], &wrong = most[1];
#pragma unroll 1
        for (uint32_t k = threadIdx.x; k < count; k += threads) {
            if (!is_movable(k)) continue;
            const V3<R> n = normal(k), moving = vector(MOVING, site_of(k));
            const R stiffness = field(STIFFNESS, k), grip = field(GRIP, k), push = stiffness * (field(WANTED, k) - dot(moving, n));
            const V3<R> slip = across(plus(tool_velocity(k), moving, R(-1)), n);
            const bool gives = field(IS_PUSHED, k) != R(0);
            point(IMPULSE, k) = gives ? make_float4(slip.x * grip, slip.y * grip, slip.z * grip, push) : make_float4(0, 0, 0, 0);
            largest = fmax(largest, double(push));

            const R size = norm(slip), cone = R(tool_of(k).friction) * larger(push, R(0));
            const R next = cone > R(0) ? (cone >= stiffness * size ? stiffness : cone / size) : R(0);
            field(NEXT_IS_PUSHED, k) = push > R(0) ? R(1) : R(0);
            field(NEXT_GRIP, k) = next;
            if (gives != (push > R(0))) wrong = fmax(wrong, fabs(double(push)));
            wrong = fmax(wrong, fabs(double(next - grip)) * double(size));
        }
        const double mine = block_all<Largest>(most, scratch);
        const uint32_t warp = threadIdx.x / 32;
        if (warp < 2 && threadIdx.x % 32 == 0) scratch[warp * 33 + 32] = mine;
        __syncthreads();
        return scratch[33 + 32] <= SETTLED * scratch[32];
    }

    // Takes the laws that the last solution asks for.
    __device__ void mend() const {
        for (uint32_t k = threadIdx.x; k < count; k += threads) {
            field(GRIP, k) = field(NEXT_GRIP, k);
            field(IS_PUSHED, k) = field(NEXT_IS_PUSHED, k);
        }
        __syncthreads();
    }

    // What tools receive: what they had already, where that is not nothing, and every point's share, summed by a warp for each number.
    __device__ void tell(ToolSum* sums, const ToolSum* before) const {
#pragma unroll 1
        for (uint32_t k = threadIdx.x; k < count; k += threads) {
            const float4 impulse = point(IMPULSE, k);
            const Vec at = vec(point(AT, k)), j = vec(point(NORMAL, k)) * impulse.w + vec(impulse), m = cross(at, j);
            const float given[] = {-j.x, -j.y, -j.z, -m.x, -m.y, -m.z, dot(j, velocity_of(tool_of(k), at, step.step.duration))};
            for (int n = 0; n < 7; ++n) c.given[n * MAX_POINTS + k] = given[n];
            if (impulse.w > 0.0f) atomicAdd(&c.counts[PUSHED], 1);
        }
        __syncthreads();
        const uint32_t lane = threadIdx.x % 32;
#pragma unroll 1
        for (uint32_t job = threadIdx.x / 32; job < 7 * step.step.tool_count; job += threads / 32) {
            double sum = before && lane == 0 ? reinterpret_cast<const double*>(&before[job / 7])[job % 7] : 0.0;
            for (uint32_t k = lane; k < count; k += 32) {
                if (__float_as_uint(point(NAMES, k).x) == job / 7) sum += c.given[job % 7 * MAX_POINTS + k];
            }
            sum = warp_all<Sum>(sum);
            if (lane == 0) reinterpret_cast<double*>(&sums[job / 7])[job % 7] = sum;
        }
    }
};

}  // namespace efg_kernel
