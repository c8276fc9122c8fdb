// Contact of tools with the tissue's surface, by projection; see src/cpu/contact/mod.rs for what it means.
//
// After every substep one block finds the sites inside tools and the impulses that put them back: a projected gradient with momentum. It starts from
// nothing in every substep, so that impulses hang on where the tissue is and on nothing else: where it started from those of the last substep, tissue
// that is held by a tool never came to rest. Every sum has a fixed order.
//
// The block is all latency: of loads that wait for each other, and of code, which has to be fetched while it runs for the first time. So loads come
// early and together, loops stay loops, and nothing is written twice. Where points are few, which is usual, a group of eight threads cares for a site, and
// what impulses do to each other's sites, worked out when sites were listed (near.cu), stays in registers.
#include "block.cuh"
#include "contact.cuh"
#include "layout.cuh"
#include "tool.cuh"

namespace contact_kernel {

constexpr int THREADS = 512, WARPS = THREADS / 32;
// Threads that care for a site, and sites that are cared for at once.
constexpr int LANES = 8, GROUPS = THREADS / LANES;
// Couplings that a thread keeps in registers.
constexpr int HELD = MAX_COUPLED / LANES;
// Most iterations for the impulses. One is the last when it changes none by more than this share of the largest that the first one found.
constexpr int ITERATIONS = 256;
constexpr float CONVERGED = 3e-4f;
// Of a point's mobility, how much must belong to free nodes for the point to count as movable.
constexpr float MOVABLE = 1e-3f;
// Most points of one site: more tools than that do not meet in one place.
constexpr uint32_t MOST_OF_SITE = 7;
constexpr uint16_t NOT_ACTIVE = 0xffff;
// Tools and their parts that are fetched before it is known how many there are: a word for each thread.
constexpr int EARLY_TOOLS = THREADS * 4 / sizeof(ToolStep), EARLY_PARTS = THREADS * 4 / sizeof(Part);
// Loads of a carrier that a thread keeps in registers.
constexpr int HELD_LOADS = 8;

__device__ float4 with(const Vec& v, float w) { return make_float4(v.x, v.y, v.z, w); }

// Sums over the eight threads of a group.
__device__ float group_sum(float x) {
    for (int step = 1; step < LANES; step *= 2) x += __shfl_xor_sync(~0u, x, step);
    return x;
}
__device__ Vec group_sum(const Vec& v) { return {group_sum(v.x), group_sum(v.y), group_sum(v.z)}; }

// How fast a tool moves at `at`, seen from its origin.
__device__ Vec velocity_of(const ToolStep& tool, const Vec& at, float duration) {
    const Vec linear{float(tool.to[0] - tool.from[0]), float(tool.to[1] - tool.from[1]), float(tool.to[2] - tool.from[2])};
    return (linear + cross(vec(tool.turn), at)) * (1.0f / duration);
}

// A site: where it is at rest, how far from there it is and was before the substep, and what decides which parts of a tool it meets.
struct Site {
    Vec rest, moved, came;
    float edge;
    int division;
};

// A site and a tool.
struct Probe {
    Vec at;
    // How far the site came in this move, seen from the tool.
    float travel;
    Nearest met;
};

__device__ __forceinline__ Probe probe(const Part* all, const ToolStep& tool, const View& now, const View& before, const Site& site) {
    constexpr Nearest NOTHING{1.0f, {0, 0, 1}, 0};
    Probe p{from_tool(site.rest, now) + site.moved, 0.0f, NOTHING};
    const Vec local = rotate(conjugate(now.turn), p.at);
    const Vec start = rotate(conjugate(before.turn), from_tool(site.rest, before) + site.came);
    p.travel = norm(local - start);
    const float strides = p.travel / tool.stride;
    if (strides <= 1.0f && dot(p.at, p.at) >= tool.radius * tool.radius) return p;
    const Part* const parts = all + tool.part;
    p.met = meet(parts, tool.part_count, start, local, strides);
    if (p.met.distance < 0.0f && part_division(parts[p.met.part], site.edge) != site.division) p.met = NOTHING;
    return p;
}

// Points: in global memory, or as far as iterations need them in shared memory.
struct Points {
    float4* field;
    uint32_t stride;
    __device__ float4& at(int f, uint32_t k) const { return field[f * stride + k]; }
};

// An impulse on the tissue: along the normal, and across it.
struct Impulse {
    float push;
    Vec drag;
};

// What iterations know of a point.
struct Known {
    Vec normal;
    // See PointField.
    float target;
    Vec before;
    float mass, friction;
    __device__ bool is_movable() const { return target > 0.0f; }
};

// How far a point's iterations have come: its impulse, carried on by momentum; what was found last; and for how many iterations on end it has gone which
// way.
struct Search {
    Impulse now, last, way;
    float age;
};

// One iteration of a point on a site whose velocity all impulses change by `change`. Gives how much was changed of what was found. Momentum grows with the
// age of a way and ends with it, point by point: without it many points on few nodes take far more iterations, and with one that only grows, few points do.
__device__ __forceinline__ float improve(const Known& k, const Vec& change, bool is_last, Search& s) {
    // Along the normal: the rest of the depth, by pushing alone.
    const float push = fmaxf(s.now.push + k.mass * (k.target - dot(change, k.normal)), 0.0f);
    // Across it: with the tool, inside Coulomb's cone.
    Vec slip = k.before + change;
    slip = slip - k.normal * dot(slip, k.normal);
    Vec drag = s.now.drag - slip * k.mass;
    const float cone = k.friction * push, size2 = dot(drag, drag);
    if (size2 > cone * cone) drag = drag * (cone * rsqrtf(size2));
    const Impulse way{push - s.last.push, drag - s.last.drag};
    const bool turns = way.push * s.way.push + dot(way.drag, s.way.drag) < 0.0f;
    const float momentum = turns || is_last ? 0.0f : __fdividef(s.age, s.age + 3.0f);
    s = {{push + way.push * momentum, drag + way.drag * momentum}, {push, drag}, way, turns ? 0.0f : s.age + 1.0f};
    return fmaxf(fabsf(way.push), fmaxf(fabsf(way.drag.x), fmaxf(fabsf(way.drag.y), fabsf(way.drag.z))));
}

// Which sites are active, in their order: the site, its first point, and what a site is among them.
struct Active {
    uint16_t site[MAX_POINTS], first[MAX_POINTS + 1], of[MAX_SITES];
};

// What a block works on.
struct Work {
    const Contact& c;
    const Pass& pass;
    const Step& step;
    const ToolStep* tools;
    const Active& sites;
    const Points points;
    uint32_t round, active;
    // The largest impulse of a first iteration, as bits.
    uint32_t* largest;
};

__device__ Vec velocity_of(const Work& w, uint32_t slot) {
    const size_t at = velocity_at(slot);
    return {w.pass.v_next[at], w.pass.v_next[at + BRICK_NODES], w.pass.v_next[at + 2 * BRICK_NODES]};
}

// What iterations start from: what cannot move has its impulse already.
__device__ Search start_of(const Known& known) {
    const Impulse start{fmaxf(-known.target, 0.0f), {0, 0, 0}};
    return {start, start, {0.0f, {0, 0, 0}}, 0.0f};
}

// What is known of a point on a site that moves with `velocity` and that all points together move by 1 / `mass` at most.
__device__ Known known_of(const Work& w, uint32_t k, const Vec& velocity, float mass) {
    const float4 normal = w.points.at(NORMAL, k);
    const ToolStep& tool = w.tools[__float_as_uint(w.points.at(NAMES, k).x)];
    return {vec(normal), normal.w, velocity - velocity_of(tool, vec(w.points.at(AT, k)), w.step.duration), mass, tool.friction};
}

__device__ void save(const Work& w, uint32_t k, const Search& search) {
    w.points.at(IMPULSE, k) = with(search.now.drag, search.now.push);
    w.points.at(LAST, k) = with(search.last.drag, search.last.push);
    w.points.at(WAY, k) = with(search.way.drag, search.way.push);
    w.points.at(NAMES, k).w = search.age;
}

// The impulse on a site of one point.
__device__ Vec impulse_of(const Known& known, const Impulse& j) { return known.is_movable() ? known.normal * j.push + j.drag : Vec{0, 0, 0}; }

// The sum of all impulses on a carrier, by its loads from `start` to `end`.
__device__ __forceinline__ Vec load_of(const Work& w, uint32_t start, uint32_t end, const float4* impulses) {
    Vec sum{0, 0, 0};
#pragma unroll 4
    for (uint32_t e = start; e < end; ++e) {
        const Load load = w.c.loads[e];
        const uint32_t other = w.sites.of[load.site];
        if (other != NOT_ACTIVE) sum = sum + vec(impulses[other]) * load.weight;
    }
    return sum;
}

__device__ Vec scaled(const float4& m, const Vec& v) { return {v.x * m.x, v.y * m.y, v.z * m.z}; }

// Writes a carrier's velocity and displacement, `change` after what they were.
__device__ void kick(const Work& w, uint32_t slot, const Vec& v, const float4& u, const Vec& change) {
    const size_t at = velocity_at(slot);
    const float dt = w.step.dt;
    w.pass.v_next[at] = v.x + change.x;
    w.pass.v_next[at + BRICK_NODES] = v.y + change.y;
    w.pass.v_next[at + 2 * BRICK_NODES] = v.z + change.z;
    w.pass.u_next[slot] = make_float4(u.x + change.x * dt, u.y + change.y * dt, u.z + change.z * dt, u.w);
}

// Where all active sites are vertices, no more of them than there are groups, each with one point: a group keeps its site in registers, and each of its threads a node.
__device__ __forceinline__ void resolve_few(const Work& w, const Points& all) {
    __shared__ float4 impulses[2][GROUPS];
    const uint32_t lane = threadIdx.x % LANES, group = threadIdx.x / LANES;
    // Groups of a warp stay together; those without a site repeat another's work and keep it to themselves.
    const bool is_busy = (group & ~3u) < w.active, is_mine = group < w.active;
    const uint32_t a = min(group, w.active - 1), site = w.sites.site[a], at = lane * MAX_SITES + site;
    uint32_t others[HELD], widest = 0;
    Vec by[HELD];
    Known known;
    Search search;
    Carrier carrier;
    Load loads[HELD_LOADS];
    Vec v;
    float4 u, mobility;
    bool is_carried = false;
    if (is_busy) {
        // All loads first.
        carrier = w.c.site_carriers[at];
        const float weight = w.c.site_weights[at];
        float4 couplings[HELD];
#pragma unroll
        for (int i = 0; i < HELD; ++i) couplings[i] = w.c.couplings[site * MAX_COUPLED + i * LANES + lane];
        is_carried = carrier.name != ~0u;
        v = velocity_of(w, carrier.slot);
        u = w.pass.u_next[carrier.slot];
        mobility = w.c.mobility[is_carried ? carrier.name : 0];
#pragma unroll
        for (int i = 0; i < HELD_LOADS; ++i) loads[i] = i < carrier.count ? w.c.loads[carrier.start + i] : Load{site, 0.0f};

        float reach = 0.0f;
#pragma unroll
        for (int i = 0; i < HELD; ++i) {
            const uint32_t other = w.sites.of[__float_as_uint(couplings[i].w)];
            const bool is_there = other != NOT_ACTIVE && couplings[i].x + couplings[i].y + couplings[i].z != 0.0f;
            others[i] = is_there ? other : 0;
            by[i] = is_there ? vec(couplings[i]) : Vec{0, 0, 0};
            reach += fmaxf(fabsf(by[i].x), fmaxf(fabsf(by[i].y), fabsf(by[i].z)));
            if (__any_sync(~0u, is_there)) widest = i + 1;
        }
        known = known_of(w, a, group_sum(v * weight), 1.0f / group_sum(reach));
        search = start_of(known);
        if (lane == 0 && is_mine) {
            impulses[0][a] = make_float4(0, 0, 0, 0);
            atomicMax(w.largest, __float_as_uint(fmaxf(known.mass * known.target, 0.0f)));
        }
        // Who writes which node, and by which active sites' impulses.
        uint32_t first = NOT_ACTIVE;
#pragma unroll
        for (int i = 0; i < HELD_LOADS; ++i) {
            const uint32_t other = w.sites.of[loads[i].site];
            first = min(first, i < carrier.count ? other : NOT_ACTIVE);
            if (other == NOT_ACTIVE) loads[i].weight = 0.0f;
            loads[i].site = other == NOT_ACTIVE ? 0 : other;
        }
        for (uint32_t e = carrier.start + HELD_LOADS; e < carrier.start + carrier.count; ++e) first = min(first, uint32_t(w.sites.of[w.c.loads[e].site]));
        is_carried = is_carried && is_mine && first == a;
    }
    __syncthreads();
    const float small = CONVERGED * __uint_as_float(*w.largest);
    int iteration = 0;
    bool is_done = false;
#pragma unroll 1
    for (; !is_done; ++iteration) {
        float changed = 0.0f;
        if (is_busy) {
            const float4* const from = impulses[iteration & 1];
            Vec change{0, 0, 0};
#pragma unroll
            for (int i = 0; i < HELD; ++i) {
                if (i >= widest) break;
                const float4 j = from[others[i]];
                change = change + Vec{by[i].x * j.x, by[i].y * j.y, by[i].z * j.z};
            }
            change = group_sum(change);
            if (known.is_movable()) changed = improve(known, change, false, search);
            if (lane == 0 && is_mine) impulses[~iteration & 1][a] = with(impulse_of(known, search.now), 0.0f);
        }
        is_done = !__syncthreads_or(changed > small) || iteration + 1 == ITERATIONS;
    }
    // What was found, without momentum.
    const float4* const found = impulses[iteration & 1];
    if (lane == 0 && is_mine) {
        impulses[iteration & 1][a] = with(impulse_of(known, search.last), 0.0f);
        w.points.at(IMPULSE, a) = all.at(IMPULSE, a) = with(search.last.drag, search.last.push);
    }
    __syncthreads();
    if (!is_carried) return;
    Vec sum{0, 0, 0};
#pragma unroll
    for (int i = 0; i < HELD_LOADS; ++i) sum = sum + vec(found[loads[i].site]) * loads[i].weight;
    sum = sum + load_of(w, carrier.start + HELD_LOADS, carrier.start + carrier.count, found);
    kick(w, carrier.slot, v, u, scaled(mobility, sum));
}

// Any number of points: impulses go to the nodes, and from the nodes to the sites.
__device__ __forceinline__ void resolve_many(const Work& w) {
    __shared__ uint32_t moved;
    const uint32_t row = w.c.divides ? MAX_ROW : LANES;
    if (threadIdx.x == 0) moved = 0;
    __syncthreads();
    // The carriers, each once: who comes first claims it, and nothing hangs on who that is.
#pragma unroll 1
    for (uint32_t job = threadIdx.x; job < w.active * row; job += THREADS) {
        const uint32_t on = w.c.site_carriers[job % row * MAX_SITES + w.sites.site[job / row]].name;
        if (on == ~0u || atomicExch(&w.c.claimed[on], w.round) == w.round) continue;
        w.c.moved[atomicAdd(&moved, 1)] = {on, 0};
    }
    __syncthreads();
    // A group for each gathers its loads on active sites, and how much unit impulses on all of them move it at most.
    const uint32_t lane = threadIdx.x % LANES, group = threadIdx.x / LANES, shift = threadIdx.x & 24, mask = 0xffu << shift;
#pragma unroll 1
    for (uint32_t n = group; n < moved; n += GROUPS) {
        const uint32_t on = w.c.moved[n].x;
        const Carrier carrier = w.c.carriers[on];
        uint32_t count = 0;
        float reach = 0.0f;
#pragma unroll 4
        for (uint32_t first = 0; first < carrier.count; first += LANES) {
            const uint32_t e = first + lane;
            const Load load = e < carrier.count ? w.c.loads[carrier.start + e] : Load{w.sites.site[0], 0.0f};
            const uint32_t other = w.sites.of[load.site];
            const bool is_active = other != NOT_ACTIVE && e < carrier.count;
            const uint32_t actives = __ballot_sync(mask, is_active) >> shift;
            if (is_active) w.c.active_loads[carrier.start + count + __popc(actives & ((1u << lane) - 1))] = {other, load.weight};
            count += __popc(actives);
            reach += is_active ? fabsf(load.weight) : 0.0f;
        }
        for (int step = 1; step < LANES; step *= 2) reach += __shfl_xor_sync(mask, reach, step);
        if (lane > 0) continue;
        const float4 m = w.c.mobility[on];
        w.c.moved[n].y = count;
        w.c.changes[on] = make_float4(0, 0, 0, reach * fmaxf(m.x, fmaxf(m.y, m.z)));
    }
    __syncthreads();
#pragma unroll 1
    for (uint32_t a = threadIdx.x; a < w.active; a += THREADS) {
        const uint32_t site = w.sites.site[a];
        Vec velocity{0, 0, 0};
        float reach = 0.0f;
#pragma unroll 4
        for (uint32_t i = 0; i < row; ++i) {
            const float weight = w.c.site_weights[i * MAX_SITES + site];
            if (weight == 0.0f) continue;
            velocity = velocity + velocity_of(w, w.c.site_slots[i * MAX_SITES + site]) * weight;
            reach += fabsf(weight) * w.c.changes[w.c.site_carriers[i * MAX_SITES + site].name].w;
        }
        for (uint32_t k = w.sites.first[a]; k < w.sites.first[a + 1]; ++k) {
            const Known known = known_of(w, k, velocity, 1.0f / reach);
            w.points.at(BEFORE, k) = with(known.before, known.mass);
            save(w, k, start_of(known));
            atomicMax(w.largest, __float_as_uint(fmaxf(known.mass * known.target, 0.0f)));
        }
        w.c.impulses[a] = make_float4(0, 0, 0, 0);
    }
    __syncthreads();
    const float small = CONVERGED * __uint_as_float(*w.largest);
    bool is_last = false, is_done = false;
#pragma unroll 1
    for (int iteration = 0;; ++iteration) {
#pragma unroll 1
        for (uint32_t n = threadIdx.x; n < moved; n += THREADS) {
            const uint2 known = w.c.moved[n];
            const uint32_t on = known.x;
            const Carrier carrier = w.c.carriers[on];
            Vec sum{0, 0, 0};
#pragma unroll 4
            for (uint32_t e = 0; e < known.y; ++e) {
                const Load load = w.c.active_loads[carrier.start + e];
                sum = sum + vec(w.c.impulses[load.site]) * load.weight;
            }
            const Vec change = scaled(w.c.mobility[on], sum);
            w.c.changes[on] = with(change, 0.0f);
            if (is_done) kick(w, carrier.slot, velocity_of(w, carrier.slot), w.pass.u_next[carrier.slot], change);
        }
        if (is_done) return;
        __syncthreads();
        float changed = 0.0f;
#pragma unroll 1
        for (uint32_t a = threadIdx.x; a < w.active; a += THREADS) {
            const uint32_t site = w.sites.site[a];
            Vec change{0, 0, 0}, sum{0, 0, 0};
#pragma unroll 4
            for (uint32_t i = 0; i < row; ++i) {
                const uint32_t on = w.c.site_carriers[i * MAX_SITES + site].name;
                if (on != ~0u) change = change + vec(w.c.changes[on]) * w.c.site_weights[i * MAX_SITES + site];
            }
            for (uint32_t k = w.sites.first[a]; k < w.sites.first[a + 1]; ++k) {
                const float4 normal = w.points.at(NORMAL, k), seen = w.points.at(BEFORE, k), j = w.points.at(IMPULSE, k), l = w.points.at(LAST, k), way = w.points.at(WAY, k);
                const Known known{vec(normal), normal.w, vec(seen), seen.w, w.tools[__float_as_uint(w.points.at(NAMES, k).x)].friction};
                if (!known.is_movable()) continue;
                Search search{{j.w, vec(j)}, {l.w, vec(l)}, {way.w, vec(way)}, w.points.at(NAMES, k).w};
                // The last one's impulses are what was found, without momentum.
                changed = fmaxf(changed, improve(known, change, is_last, search));
                save(w, k, search);
                sum = sum + impulse_of(known, search.now);
            }
            w.c.impulses[a] = with(sum, 0.0f);
        }
        const bool is_found = !__syncthreads_or(changed > small);
        is_done = is_last;
        is_last = is_found || iteration + 2 == ITERATIONS;
    }
}

// What the tools receive: every point's share, summed by a warp for each number.
__device__ __forceinline__ void tell_tools(const Work& w, double* given, uint32_t stride, uint32_t count) {
    __syncthreads();
#pragma unroll 1
    for (uint32_t k = threadIdx.x; k < count; k += THREADS) {
        const float4 impulse = w.points.at(IMPULSE, k);
        const ToolStep& tool = w.tools[__float_as_uint(w.points.at(NAMES, k).x)];
        const bool is_pushed = impulse.w > 0.0f;
        const Vec at = vec(w.points.at(AT, k)), j = is_pushed ? vec(w.points.at(NORMAL, k)) * impulse.w + vec(impulse) : Vec{0, 0, 0}, m = cross(at, j);
        given[k] = -j.x, given[stride + k] = -j.y, given[2 * stride + k] = -j.z;
        given[3 * stride + k] = -m.x, given[4 * stride + k] = -m.y, given[5 * stride + k] = -m.z;
        given[6 * stride + k] = dot(j, velocity_of(tool, at, w.step.duration));
        if (is_pushed) atomicAdd(&w.c.counts[PUSHED], 1);
    }
    __syncthreads();
    const uint32_t number = threadIdx.x / 32, lane = threadIdx.x % 32;
    if (number >= 7) return;
#pragma unroll 1
    for (uint32_t t = 0; t < w.step.tool_count; ++t) {
        double sum = 0.0;
#pragma unroll 1
        for (uint32_t k = lane; k < count; k += 32) {
            if (__float_as_uint(w.points.at(NAMES, k).x) == t) sum += given[number * stride + k];
        }
#pragma unroll 1
        for (int half = 16; half > 0; half /= 2) sum += __shfl_down_sync(~0u, sum, half);
        if (lane == 0) reinterpret_cast<double*>(&w.c.sums[t])[number] += sum;
    }
}

}  // namespace contact_kernel
using namespace contact_kernel;

extern "C" __global__ void __launch_bounds__(THREADS)
    contact(const __grid_constant__ Contact c, const __grid_constant__ Pass pass, const __grid_constant__ Moment moment) {
    __shared__ Active actives;
    __shared__ ToolStep tools[MAX_TOOLS];
    __shared__ Part early_parts[EARLY_PARTS];
    __shared__ View now[MAX_TOOLS], before[MAX_TOOLS];
    __shared__ float4 mirror[(IMPULSE + 1) * GROUPS];
    __shared__ double given[7 * GROUPS];
    __shared__ uint32_t largest, last_active;
    const uint32_t thread = threadIdx.x;
    const Step& step = *pass.step;
    // Bricks that are not near tools have nothing to wait for.
    if (pass.share == FIRST) let_next_start();
    // Tools and parts, before it is known how many there are.
    constexpr uint32_t TOOL_WORDS = sizeof(ToolStep) / 4, PART_WORDS = sizeof(Part) / 4;
    const uint32_t* const tool_words = reinterpret_cast<const uint32_t*>(step.tools);
    const uint32_t tool_word = tool_words[thread], part_word = reinterpret_cast<const uint32_t*>(c.parts)[thread];
    const uint32_t count_of_tools = step.tool_count, sites = c.counts[SITES];
    const bool follow = moment.tissue_moves && step.may_jump;
    const float dt = step.dt, push_limit = step.push_limit;
    if (thread < EARLY_TOOLS * TOOL_WORDS) reinterpret_cast<uint32_t*>(tools)[thread] = tool_word;
    if (thread < EARLY_PARTS * PART_WORDS) reinterpret_cast<uint32_t*>(early_parts)[thread] = part_word;
    for (uint32_t i = EARLY_TOOLS * TOOL_WORDS + thread; i < count_of_tools * TOOL_WORDS; i += THREADS) reinterpret_cast<uint32_t*>(tools)[i] = tool_words[i];
    if (thread == 0) largest = 0;
    const Points few{mirror, GROUPS};
    const Points all{c.points, MAX_POINTS};
    uint32_t round;

    // Find the points inside tools, in the order of sites and tools. What lies behind the last site is read as well: that is
    // quicker than to wait for their number.
    uint32_t count = 0, active = 0;
    bool is_held = true;
#pragma unroll 1
    for (uint32_t first = 0; first == 0 || first < sites; first += THREADS) {
        const uint32_t site = first + thread, coupled = c.site_coupled[site];
        const float4 rest = c.site_rest[site], own = c.site_own[site];
        const uint2 names = c.site_names[site];
        const float edge = c.site_edges[site];
        // A vertex hangs on eight nodes.
        const uint32_t row = names.x < c.first_triangle ? LANES : MAX_ROW;
        uint32_t slots[LANES];
        float weights[LANES];
#pragma unroll
        for (int i = 0; i < LANES; ++i) {
            slots[i] = c.site_slots[i * MAX_SITES + site];
            weights[i] = c.site_weights[i * MAX_SITES + site];
        }
        // Up to here nothing was read that substeps change.
        if (first == 0) {
            wait_for_previous();
            let_next_start();
            round = c.counts[ROUND] + 1;
        }
        const uint32_t diverged_at = *pass.diverged_at;
        Vec moved{0, 0, 0}, came{0, 0, 0};
#pragma unroll
        for (int i = 0; i < LANES; ++i) moved = moved + vec(pass.u_next[slots[i]]) * weights[i];
#pragma unroll 8
        for (uint32_t i = LANES; i < row; ++i) {
            moved = moved + vec(pass.u_next[c.site_slots[i * MAX_SITES + site]]) * c.site_weights[i * MAX_SITES + site];
        }
        if (first == 0 && moment.is_first && thread < count_of_tools) c.sums[thread] = ToolSum{};
        if (follow) {
#pragma unroll 1
            for (uint32_t i = 0; i < row; ++i) came = came + vec(pass.u[c.site_slots[i * MAX_SITES + site]]) * c.site_weights[i * MAX_SITES + site];
        } else {
            came = moved;
        }
        // All leave or none: bricks that advance meanwhile may diverge while this is looked at.
        if (__syncthreads_or(diverged_at <= pass.substep)) return;
        if (first == 0) {
            __syncthreads();
            // By the last threads, for the first ones have most to do.
            const uint32_t i = THREADS - 1 - thread, t = i / 2;
            if (t < count_of_tools) (i % 2 ? before : now)[t] = view_of(tools[t], i % 2 ? moment.from : moment.to);
            __syncthreads();
        }
        const ToolStep& last_tool = tools[count_of_tools - 1];
        const Part* const parts = last_tool.part + last_tool.part_count <= EARLY_PARTS ? early_parts : c.parts;
        uint64_t met = 0;
        uint32_t mine = 0, k = 0, end = 0;
        // Which tools the site is inside first, then the points; most are inside one and were looked at last.
        Probe p;
        uint32_t looked_at = ~0u;
#pragma unroll 1
        for (int look = 0; look < 2; ++look) {
#pragma unroll 1
            for (uint32_t t = 0; t < count_of_tools && site < sites; ++t) {
                if (look == 1 && (k == end || !(met >> t & 1))) continue;
                const ToolStep& tool = tools[t];
                if (t != looked_at) p = probe(parts, tool, now[t], before[t], {vec(rest), moved, came, edge, int(names.y)});
                looked_at = t;
                const float depth = -p.met.distance;
                if (look == 0) {
                    met |= uint64_t(depth > 0.0f) << t;
                    continue;
                }
                const Vec n = rotate(now[t].turn, p.met.normal);
                const float free = own.x * n.x * n.x + (own.y * n.y * n.y + own.z * n.z * n.z);
                const bool is_movable = free > MOVABLE * own.w;
                const float mass = 1.0f / (is_movable ? free : own.w), lever = 1.0f / fmaxf(1.0f, rest.w * mass);
                // What cannot move stays inside the tool: of several moves in a substep the last alone counts.
                const float target = is_movable      ? fminf(depth, (push_limit + p.travel) * lever) / dt
                                     : moment.is_last ? -mass * depth / dt
                                                      : 0.0f;
                const float4 normal = with(n, target), at = with(p.at, depth);
                const float4 named = make_float4(__uint_as_float(t), __uint_as_float(names.x), 0.0f, 0.0f);
                all.at(NORMAL, k) = normal;
                all.at(AT, k) = at;
                all.at(NAMES, k) = named;
                if (k < GROUPS) {
                    few.at(NORMAL, k) = normal;
                    few.at(AT, k) = at;
                    few.at(NAMES, k) = named;
                }
                ++k;
            }
            if (look == 1) continue;
            mine = min(__popcll(met), MOST_OF_SITE);
            uint32_t total;
            const uint32_t sum = scan<WARPS>(mine | (mine ? 1u << 16 : 0), total), a = active + (sum >> 16);
            k = count + (sum & 0xffff);
            end = min(k + mine, uint32_t(MAX_POINTS));
            if (mine && k + mine > MAX_POINTS) atomicAdd(&c.counts[DROPPED], k + mine - max(k, end));
            count = min(count + (total & 0xffff), uint32_t(MAX_POINTS));
            active += total >> 16;
            // What comes after the last point that found room is not active.
            const bool is_active = k < end;
            if (site < sites) actives.of[site] = is_active ? a : NOT_ACTIVE;
            if (!is_active) {
                end = k;
                continue;
            }
            if (end == MAX_POINTS) last_active = a + 1;
            actives.site[a] = site;
            actives.first[a] = k;
            is_held = is_held && a < GROUPS && end - k == 1 && coupled <= MAX_COUPLED && row == LANES;
        }
    }
    const bool is_small = __syncthreads_and(is_held);
    if (count == MAX_POINTS) active = last_active;
    if (thread == 0) {
        actives.first[active] = count;
        c.counts[POINTS] = count;
        c.counts[ROUND] = round;
        c.counts[PUSHED] = 0;
    }
    if (count == 0) return;
    __syncthreads();
    const Work work{c, pass, step, tools, actives, is_small ? few : all, round, active, &largest};
    if (is_small) {
        resolve_few(work, all);
    } else {
        resolve_many(work);
    }
    tell_tools(work, is_small ? given : c.given, is_small ? GROUPS : MAX_POINTS, count);
}
