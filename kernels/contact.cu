// Contact of tools with the tissue's surface, by projection; see src/cpu/contact/mod.rs for what it means.
//
// After every substep one block finds the sites inside tools and the impulses that put them back: a projected gradient with momentum. It starts from
// nothing in every substep, so that impulses hang on where the tissue is and on nothing else: where it started from those of the last substep, tissue
// that is held by a tool never came to rest. Every sum has a fixed order.
//
// The block is all latency: of loads that wait for each other, and of code, which has to be fetched while it runs for the first time. So loads come
// early and together, loops stay loops, and nothing is written twice. Where points are few, which is usual, what impulses do to each other's sites, worked
// out when sites were listed (near.cu), stays in registers: a matrix, zeros and all, of which each thread has a tile. Impulses go through shared memory, which
// takes as long for each that a thread asks for, be it the same as others': so threads with few rows, or with couplings alone, would wait longer.
#include "block.cuh"
#include "contact.cuh"
#include "layout.cuh"
#include "points.cuh"
#include "tool.cuh"

namespace contact_kernel {

constexpr int THREADS = 512, WARPS = THREADS / 32;
// Threads that care for a site, and sites that are cared for at once.
constexpr int LANES = 8, GROUPS = THREADS / LANES;
// Couplings that a thread puts into the matrix.
constexpr int HELD = MAX_COUPLED / LANES;
// Iterations of few points: rows and columns of the matrix are points; a thread has so many rows, and every four columns in so many times four. Rows lie so
// far apart that threads of a warp ask different banks.
constexpr int TILE = 4, TILE_LANES = 8, COLUMNS = GROUPS / TILE_LANES, STRIDE = GROUPS + 4;
constexpr int ITERATING = GROUPS / TILE * TILE_LANES;
// Numbers that a tool receives.
constexpr int NUMBERS = sizeof(ToolSum) / sizeof(double);
// Most iterations for the impulses. One is the last when it changes none by more than this share of the largest that the first one found.
constexpr int ITERATIONS = 256;
constexpr float CONVERGED = 3e-4f;
// How far a point goes in an iteration, by how far it may where all others go along: momentum bears up to 4/3.
constexpr float STRIDES = 1.25f;
// Tools and their parts that are fetched before it is known how many there are: a word for each thread.
constexpr int EARLY_TOOLS = THREADS * 4 / sizeof(ToolStep), EARLY_PARTS = THREADS * 4 / sizeof(Part);

// Sums over the eight threads of a group.
__device__ float group_sum(float x) {
    for (int step = 1; step < LANES; step *= 2) x += __shfl_xor_sync(~0u, x, step);
    return x;
}

// What a thread and one `step` lanes away have together of `low`, for the lower of them, and of `high` for the other.
__device__ __forceinline__ Vec exchange(const Vec& low, const Vec& high, bool is_low, int step) {
    const Vec keep = is_low ? low : high, away = is_low ? high : low;
    return keep + Vec{__shfl_xor_sync(~0u, away.x, step), __shfl_xor_sync(~0u, away.y, step), __shfl_xor_sync(~0u, away.z, step)};
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
    // See PointField; `before` is that across the normal.
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
// What does not hang on `change` is put together first, for it can be had while others are waited for.
__device__ __forceinline__ float improve(const Known& k, const Vec& change, bool is_last, Search& s) {
    const float ahead = __fdividef(s.age, s.age + 3.0f), rest = s.now.push + k.mass * k.target;
    const Vec held = s.now.drag - k.before * k.mass;
    // Along the normal: the rest of the depth, by pushing alone.
    const float along = dot(change, k.normal), push = fmaxf(rest - k.mass * along, 0.0f);
    // Across it: with the tool, inside Coulomb's cone.
    Vec drag = held - (change - k.normal * along) * k.mass;
    drag = drag * fminf(k.friction * push * rsqrtf(dot(drag, drag)), 1.0f);
    const Impulse way{push - s.last.push, drag - s.last.drag};
    const bool turns = way.push * s.way.push + dot(way.drag, s.way.drag) < 0.0f;
    const float momentum = turns || is_last ? 0.0f : ahead;
    s = {{push + way.push * momentum, drag + way.drag * momentum}, {push, drag}, way, turns ? 0.0f : s.age + 1.0f};
    return fmaxf(fabsf(way.push), fmaxf(fabsf(way.drag.x), fmaxf(fabsf(way.drag.y), fabsf(way.drag.z))));
}

// Behind the axes.
constexpr int CHANGED = 3;

// What is shared where points are few.
struct Few {
    // What impulses on active sites do to each other's; and in its place, once that is in registers, what points give to their tools.
    union {
        float matrix[GROUPS * STRIDE];
        double given[NUMBERS * GROUPS];
    };
    float4 points[(BEFORE + 1) * GROUPS];
    // Impulses on sites, axis by axis, and by how much they have changed, in turn those of one iteration and of the next; and what was found.
    float impulses[2][CHANGED + 1][GROUPS];
    float4 found[GROUPS];
};
static_assert(sizeof(Few) == CONTACT_SHARED_BYTES);

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
    Few& few;
};

__device__ Vec velocity_of(const Pass& pass, uint32_t slot) {
    const size_t at = velocity_at(slot);
    return {pass.v_next[at], pass.v_next[at + BRICK_NODES], pass.v_next[at + 2 * BRICK_NODES]};
}

// What iterations start from: what cannot move has its impulse already.
__device__ Search start_of(const Known& known) {
    const Impulse start{fmaxf(-known.target, 0.0f), {0, 0, 0}};
    return {start, start, {0.0f, {0, 0, 0}}, 0.0f};
}

// What is known of a point that goes by `mass` times what is left of its velocity in an iteration.
__device__ Known known_of(const Work& w, uint32_t k, float mass) {
    const float4 normal = w.points.at(NORMAL, k);
    return {vec(normal), normal.w, vec(w.points.at(BEFORE, k)), mass, w.tools[__float_as_uint(w.points.at(NAMES, k).x)].friction};
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
#pragma unroll 8
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

// What a point gives to its tool.
__device__ __forceinline__ void give(const Work& w, double* given, uint32_t stride, uint32_t k, const float4& impulse) {
    const ToolStep& tool = w.tools[__float_as_uint(w.points.at(NAMES, k).x)];
    const bool is_pushed = impulse.w > 0.0f;
    const Vec at = vec(w.points.at(AT, k)), j = is_pushed ? vec(w.points.at(NORMAL, k)) * impulse.w + vec(impulse) : Vec{0, 0, 0}, m = cross(at, j);
    given[k] = -j.x, given[stride + k] = -j.y, given[2 * stride + k] = -j.z;
    given[3 * stride + k] = -m.x, given[4 * stride + k] = -m.y, given[5 * stride + k] = -m.z;
    given[6 * stride + k] = dot(j, velocity_of(tool, at, w.step.duration));
    if (is_pushed) atomicAdd(&w.c.counts[PUSHED], 1);
}

// What the tools receive: the sums of what points give, by a warp for each number.
struct Telling {
    // Which number this is, if any.
    uint32_t number;
    // What tools have received before, each in another thread.
    double before[MAX_TOOLS / 32];

    __device__ __forceinline__ double& received(const Work& w, uint32_t tool) const { return reinterpret_cast<double*>(&w.c.sums[tool])[number]; }

    // Some time ahead.
    __device__ __forceinline__ Telling(const Work& w) : number(threadIdx.x / 32 - ITERATING / 32) {
        if (number >= NUMBERS) return;
#pragma unroll
        for (int i = 0; i < MAX_TOOLS / 32; ++i) {
            const uint32_t tool = i * 32 + threadIdx.x % 32;
            before[i] = tool < w.step.tool_count ? received(w, tool) : 0.0;
        }
    }

    __device__ __forceinline__ void tell(const Work& w, const double* given, uint32_t stride, uint32_t count) const {
        if (number >= NUMBERS) return;
        const uint32_t lane = threadIdx.x % 32;
#pragma unroll 1
        for (uint32_t tool = 0; tool < w.step.tool_count; ++tool) {
            double sum = 0.0;
#pragma unroll 1
            for (uint32_t k = lane; k < count; k += 32) {
                if (__float_as_uint(w.points.at(NAMES, k).x) == tool) sum += given[number * stride + k];
            }
#pragma unroll 1
            for (int half = 16; half > 0; half /= 2) sum += __shfl_xor_sync(~0u, sum, half);
            if (lane == tool % 32) received(w, tool) = (tool < 32 ? before[0] : before[1]) + sum;
        }
    }
};

// The impulses of few points, by the first threads. What an iteration has changed is looked at in the next one, while impulses are read: nothing waits for it
// then. All threads of a warp find the same, and the compiler can see that; it need not provide for threads that have left.
__device__ __forceinline__ void iterate(const Work& w, const Points& all) {
    const uint32_t lane = threadIdx.x % TILE_LANES, first = threadIdx.x / TILE_LANES * TILE;
    // The row that is left to a thread when all have added up what they have of theirs; two have the same.
    const uint32_t row = first + lane / 2, k = min(row, w.active - 1);
    const bool is_even = lane % 2 == 0, is_low[2] = {lane < TILE_LANES / 2, lane % 4 < 2};
    float by[TILE][COLUMNS];
#pragma unroll
    for (int r = 0; r < TILE; ++r) {
        // Rows without a point repeat the last one's work.
        const float4* const from = reinterpret_cast<const float4*>(w.few.matrix + min(first + r, w.active - 1) * STRIDE);
#pragma unroll
        for (int half = 0; half < 2; ++half) {
            const float4 four = from[half * TILE_LANES + lane];
            by[r][4 * half] = four.x, by[r][4 * half + 1] = four.y, by[r][4 * half + 2] = four.z, by[r][4 * half + 3] = four.w;
        }
    }
    Known known = known_of(w, k, w.points.at(BEFORE, k).w);
    Search search = start_of(known);
    if (!known.is_movable()) {
        // Whatever comes, nothing follows from it.
        known.normal = {0, 0, 0};
        known.mass = 0.0f;
    }
    const float small = CONVERGED * __uint_as_float(*w.largest);
    // Where it writes: along x and z, or along y and how much has changed.
    float* const to = w.few.impulses[0][is_even ? 0 : 1] + row;
    constexpr int NEXT = sizeof(w.few.impulses[0]) / sizeof(float);
#pragma unroll 1
    for (int iteration = 0;; ++iteration) {
        const auto& from = w.few.impulses[iteration & 1];
        const bool goes_on = __any_sync(~0u, iteration == 0 || fmaxf(from[CHANGED][threadIdx.x % 32], from[CHANGED][threadIdx.x % 32 + 32]) > small);
        Vec changes[TILE] = {};
#pragma unroll
        for (int half = 0; half < 2; ++half) {
            float4 j[3];
#pragma unroll
            for (int axis = 0; axis < 3; ++axis) j[axis] = reinterpret_cast<const float4*>(from[axis])[half * TILE_LANES + lane];
#pragma unroll
            for (int r = 0; r < TILE; ++r) {
                const float* const b = by[r] + 4 * half;
                changes[r] = changes[r] + Vec{j[0].x, j[1].x, j[2].x} * b[0];
                changes[r] = changes[r] + Vec{j[0].y, j[1].y, j[2].y} * b[1];
                changes[r] = changes[r] + Vec{j[0].z, j[1].z, j[2].z} * b[2];
                changes[r] = changes[r] + Vec{j[0].w, j[1].w, j[2].w} * b[3];
            }
        }
        // Each adds what another has of half of its rows to its own, and gives away the rest.
        const Vec two[2] = {exchange(changes[0], changes[2], is_low[0], 4), exchange(changes[1], changes[3], is_low[0], 4)};
        Vec change = exchange(two[0], two[1], is_low[1], 2);
        change = exchange(change, change, true, 1);
        const float changed = improve(known, change, false, search);
        const Vec impulse = known.normal * search.now.push + search.now.drag;
        float* const next = to + (~iteration & 1) * NEXT;
        next[0] = is_even ? impulse.x : impulse.y;
        next[2 * GROUPS] = is_even ? impulse.z : changed;
        asm volatile("bar.sync 1, %0;" ::"n"(ITERATING) : "memory");
        if (!goes_on || iteration + 1 == ITERATIONS) break;
    }
    if (row >= w.active || !is_even) return;
    // What was found, without momentum.
    w.few.found[row] = with(known.normal * search.last.push + search.last.drag, 0.0f);
    const float4 impulse = with(search.last.drag, search.last.push);
    all.at(IMPULSE, row) = impulse;
    give(w, w.few.given, GROUPS, row, impulse);
}

// A node that impulses move: it and how it moved until now.
struct Moved {
    Carrier carrier;
    Vec v;
    float4 u, mobility;
    bool is_mine;
};

// Where all active sites are vertices, no more of them than there are groups, each with one point. A group of eight threads puts together what moves a site;
// then the first threads iterate, while groups of the others look up the nodes that sites hang on, a thread for each.
__device__ __forceinline__ void resolve_few(const Work& w, const Points& all) {
    const uint32_t lane = threadIdx.x % LANES, group = threadIdx.x / LANES;
    // Groups of a warp stay together; those without a site repeat another's work and keep it to themselves.
    if ((group & ~3u) < w.active) {
        const uint32_t a = min(group, w.active - 1), site = w.sites.site[a];
        const bool is_mine = group < w.active;
        Load couplings[HELD];
#pragma unroll
        for (int i = 0; i < HELD; ++i) couplings[i] = w.c.couplings[site * MAX_COUPLED + i * LANES + lane];
        float reach = 0.0f;
#pragma unroll
        for (int i = 0; i < HELD; ++i) {
            const uint32_t other = w.sites.of[couplings[i].site];
            const float by = other != NOT_ACTIVE ? couplings[i].weight : 0.0f;
            if (by != 0.0f && is_mine) w.few.matrix[a * STRIDE + other] = by;
            reach += fabsf(by);
        }
        const float mass = STRIDES / group_sum(reach);
        if (lane == 0 && is_mine) {
            w.points.at(BEFORE, a).w = mass;
            atomicMax(w.largest, __float_as_uint(fmaxf(mass * w.points.at(NORMAL, a).w, 0.0f)));
        }
    }
    __syncthreads();
    constexpr uint32_t BUSY = ITERATING / LANES, ROUNDS = (GROUPS + GROUPS - BUSY - 1) / (GROUPS - BUSY);
    Moved nodes[ROUNDS];
    const Telling telling(w);
    if (group < BUSY) {
        iterate(w, all);
    } else {
#pragma unroll
        for (int round = 0; round < ROUNDS; ++round) {
            Moved& node = nodes[round];
            const uint32_t a = group - BUSY + round * (GROUPS - BUSY);
            node.is_mine = a < w.active;
            if (!node.is_mine) break;
            node.carrier = w.c.site_carriers[lane * MAX_SITES + w.sites.site[a]];
            node.is_mine = node.carrier.name != ~0u;
            if (!node.is_mine) continue;
            node.v = velocity_of(w.pass, node.carrier.slot);
            node.u = w.pass.u_next[node.carrier.slot];
            node.mobility = w.c.mobility[node.carrier.name];
            // The first of its active sites writes it.
            uint32_t first = NOT_ACTIVE;
#pragma unroll 8
            for (uint32_t e = node.carrier.start; e < node.carrier.start + node.carrier.count; ++e) first = min(first, uint32_t(w.sites.of[w.c.loads[e].site]));
            node.is_mine = first == a;
        }
    }
    __syncthreads();
    if (group >= BUSY) {
#pragma unroll
        for (int round = 0; round < ROUNDS; ++round) {
            const Moved& node = nodes[round];
            if (group - BUSY + round * (GROUPS - BUSY) >= w.active) break;
            if (!node.is_mine) continue;
            kick(w, node.carrier.slot, node.v, node.u, scaled(node.mobility, load_of(w, node.carrier.start, node.carrier.start + node.carrier.count, w.few.found)));
        }
    }
    telling.tell(w, w.few.given, GROUPS, w.active);
}

// Sums over the eight threads of a group, whatever other groups of the warp do.
__device__ __forceinline__ Vec group_sum(Vec v, uint32_t mask) {
    for (int step = 1; step < LANES; step *= 2) v = v + Vec{__shfl_xor_sync(mask, v.x, step), __shfl_xor_sync(mask, v.y, step), __shfl_xor_sync(mask, v.z, step)};
    return v;
}

// Any number of points: impulses go to the nodes, and from the nodes to the sites. A group of eight threads adds up what moves a node or a site; then each of
// its threads cares for one of the sites.
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
            // Every point on a site adds its impulse: there may be one for each tool.
            reach += is_active ? fabsf(load.weight) * float(w.sites.first[other + 1] - w.sites.first[other]) : 0.0f;
        }
        for (int step = 1; step < LANES; step *= 2) reach += __shfl_xor_sync(mask, reach, step);
        if (lane > 0) continue;
        const float4 m = w.c.mobility[on];
        w.c.moved[n].y = count;
        w.c.changes[on] = make_float4(__uint_as_float(n), 0, 0, reach * fmaxf(m.x, fmaxf(m.y, m.z)));
    }
    __syncthreads();
    // Rows of active sites, by what their nodes are among those that move.
#pragma unroll 1
    for (uint32_t job = threadIdx.x; job < w.active * row; job += THREADS) {
        const uint32_t at = job % row * MAX_SITES + w.sites.site[job / row], on = w.c.site_carriers[at].name;
        const float weight = w.c.site_weights[at];
        w.c.active_rows[job] = on != ~0u && weight != 0.0f ? Load{__float_as_uint(w.c.changes[on].x), weight} : Load{0, 0.0f};
    }
#pragma unroll 1
    for (uint32_t a = threadIdx.x; a < w.active; a += THREADS) {
        const uint32_t site = w.sites.site[a];
        float reach = 0.0f;
#pragma unroll 4
        for (uint32_t i = 0; i < row; ++i) {
            const float weight = w.c.site_weights[i * MAX_SITES + site];
            if (weight == 0.0f) continue;
            reach += fabsf(weight) * w.c.changes[w.c.site_carriers[i * MAX_SITES + site].name].w;
        }
        for (uint32_t k = w.sites.first[a]; k < w.sites.first[a + 1]; ++k) {
            const Known known = known_of(w, k, STRIDES / reach);
            w.points.at(BEFORE, k).w = known.mass;
            save(w, k, start_of(known));
            atomicMax(w.largest, __float_as_uint(fmaxf(known.mass * known.target, 0.0f)));
        }
    }
    __syncthreads();
    // Impulses on active sites, and what they change of the nodes: in shared memory, where nothing else stands now, as far as they have room.
    constexpr uint32_t ROOM = CONTACT_SHARED_BYTES / sizeof(Vec);
    const bool fits = w.active + moved <= ROOM;
    Vec* const impulses = fits ? reinterpret_cast<Vec*>(&w.few) : reinterpret_cast<Vec*>(w.c.impulses);
    Vec* const changes = fits ? impulses + w.active : reinterpret_cast<Vec*>(w.c.changes);
    for (uint32_t a = threadIdx.x; a < w.active; a += THREADS) impulses[a] = {0, 0, 0};
    // Where each thread has one site at most, with one point, it keeps what it knows of it.
    const uint32_t own = lane * GROUPS + group;
    const bool keeps = w.active <= THREADS && w.sites.first[w.active] == w.active;
    Known known{};
    Search search{};
    if (keeps && own < w.active) {
        known = known_of(w, own, w.points.at(BEFORE, own).w);
        search = start_of(known);
    }
    const float small = CONVERGED * __uint_as_float(*w.largest);
    bool is_last = false, is_done = false;
    __syncthreads();
#pragma unroll 1
    for (int iteration = 0;; ++iteration) {
#pragma unroll 1
        for (uint32_t n = group; n < moved; n += GROUPS) {
            const uint2 loaded = w.c.moved[n];
            const uint32_t on = loaded.x;
            const Carrier carrier = w.c.carriers[on];
            const float4 mobility = w.c.mobility[on];
            Vec sum{0, 0, 0};
#pragma unroll 4
            for (uint32_t e = lane; e < loaded.y; e += LANES) {
                const Load load = w.c.active_loads[carrier.start + e];
                sum = sum + impulses[load.site] * load.weight;
            }
            const Vec change = scaled(mobility, group_sum(sum, mask));
            if (lane > 0) continue;
            changes[n] = change;
            if (is_done) kick(w, carrier.slot, velocity_of(w.pass, carrier.slot), w.pass.u_next[carrier.slot], change);
        }
        if (is_done) break;
        __syncthreads();
        float changed = 0.0f;
#pragma unroll 1
        for (uint32_t set = 0; set < w.active; set += THREADS) {
            Vec change{0, 0, 0};
#pragma unroll 4
            for (uint32_t round = 0; round < LANES; ++round) {
                const uint32_t a = set + round * GROUPS + group;
                if (a >= w.active) break;
                Vec sum{0, 0, 0};
#pragma unroll
                for (uint32_t first = 0; first < MAX_ROW; first += LANES) {
                    if (first >= row) break;
                    const Load load = w.c.active_rows[a * row + first + lane];
                    sum = sum + changes[load.site] * load.weight;
                }
                sum = group_sum(sum, mask);
                if (lane == round) change = sum;
            }
            const uint32_t a = set + own;
            if (a >= w.active) continue;
            Vec impulse{0, 0, 0};
            for (uint32_t k = w.sites.first[a]; k < w.sites.first[a + 1]; ++k) {
                if (!keeps) {
                    const float4 j = w.points.at(IMPULSE, k), l = w.points.at(LAST, k), way = w.points.at(WAY, k);
                    known = known_of(w, k, w.points.at(BEFORE, k).w);
                    search = {{j.w, vec(j)}, {l.w, vec(l)}, {way.w, vec(way)}, w.points.at(NAMES, k).w};
                }
                if (!known.is_movable()) continue;
                // The last one's impulses are what was found, without momentum.
                changed = fmaxf(changed, improve(known, change, is_last, search));
                if (!keeps) save(w, k, search);
                impulse = impulse + impulse_of(known, search.now);
            }
            impulses[a] = impulse;
        }
        const bool is_found = !__syncthreads_or(changed > small);
        is_done = is_last;
        is_last = is_found || iteration + 2 == ITERATIONS;
    }
    if (keeps && own < w.active) save(w, own, search);
}

}  // namespace contact_kernel
using namespace contact_kernel;

extern "C" __global__ void __launch_bounds__(THREADS)
    contact(const __grid_constant__ Contact c, const __grid_constant__ Pass pass, const __grid_constant__ Moment moment) {
    __shared__ Active actives;
    __shared__ ToolStep tools[MAX_TOOLS];
    __shared__ Part early_parts[EARLY_PARTS];
    __shared__ View now[MAX_TOOLS], before[MAX_TOOLS];
    __shared__ uint32_t largest, last_active;
    extern __shared__ float4 dynamic[];
    Few& shared = *reinterpret_cast<Few*>(dynamic);
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
    // No coupling, and no impulse, where nothing else is written.
    for (uint32_t i = thread; i < CONTACT_SHARED_BYTES / sizeof(float4); i += THREADS) dynamic[i] = make_float4(0, 0, 0, 0);
    const Points few{shared.points, GROUPS};
    const Points all{c.points, MAX_POINTS};
    uint32_t round;

    // Find the points inside tools, in the order of sites and tools. Warps that have none of them read nothing: many loads take their time even if nobody
    // waits for them.
    uint32_t count = 0, active = 0;
    bool is_held = true;
#pragma unroll 1
    for (uint32_t first = 0; first == 0 || first < sites; first += THREADS) {
        const uint32_t site = first + thread;
        const bool reads = (site & ~31u) < sites;
        uint32_t coupled = 0, row = 0;
        float4 rest{}, own{};
        uint2 names{};
        float edge = 0.0f;
        uint32_t slots[LANES] = {};
        float weights[LANES] = {};
        if (reads) {
            coupled = c.site_coupled[site];
            rest = c.site_rest[site], own = c.site_own[site];
            names = c.site_names[site];
            edge = c.site_edges[site];
            // A vertex hangs on eight nodes.
            row = names.x < c.first_triangle ? LANES : MAX_ROW;
#pragma unroll
            for (int i = 0; i < LANES; ++i) {
                slots[i] = c.site_slots[i * MAX_SITES + site];
                weights[i] = c.site_weights[i * MAX_SITES + site];
            }
        }
        // Up to here nothing was read that substeps change.
        if (first == 0) {
            __syncthreads();
            if (thread < 2 * count_of_tools) (thread % 2 ? before : now)[thread / 2] = view_of(tools[thread / 2], thread % 2 ? moment.from : moment.to);
            wait_for_previous();
            let_next_start();
            round = c.counts[ROUND] + 1;
        }
        const uint32_t diverged_at = *pass.diverged_at;
        Vec moved{0, 0, 0}, came{0, 0, 0}, velocity{0, 0, 0};
        if (reads) {
            // Velocities are wanted where there is a point: they shall be near then.
#pragma unroll
            for (int i = 0; i < LANES; ++i) {
                moved = moved + vec(pass.u_next[slots[i]]) * weights[i];
                for (int axis = 0; axis < 3; ++axis) asm volatile("prefetch.global.L1 [%0];" ::"l"(pass.v_next + velocity_at(slots[i]) + axis * BRICK_NODES));
            }
        }
#pragma unroll 4
        for (uint32_t i = LANES; i < row; ++i) {
            const uint32_t slot = c.site_slots[i * MAX_SITES + site];
            const float weight = c.site_weights[i * MAX_SITES + site];
            moved = moved + vec(pass.u_next[slot]) * weight;
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
                const Vec seen = velocity - velocity_of(tool, p.at, step.duration);
                const float4 across = with(seen - n * dot(seen, n), 0.0f);
                for (const Points& points : {all, few}) {
                    if (k >= points.stride) break;
                    points.at(NORMAL, k) = normal;
                    points.at(AT, k) = at;
                    points.at(NAMES, k) = named;
                    points.at(BEFORE, k) = across;
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
#pragma unroll
            for (int i = 0; i < LANES; ++i) velocity = velocity + velocity_of(pass, slots[i]) * weights[i];
#pragma unroll 4
            for (uint32_t i = LANES; i < row; ++i) velocity = velocity + velocity_of(pass, c.site_slots[i * MAX_SITES + site]) * c.site_weights[i * MAX_SITES + site];
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
    const Work work{c, pass, step, tools, actives, is_small ? few : all, round, active, &largest, shared};
    if (is_small) {
        resolve_few(work, all);
    } else {
        resolve_many(work);
        __syncthreads();
        const Telling telling(work);
#pragma unroll 1
        for (uint32_t k = thread; k < count; k += THREADS) give(work, c.given, MAX_POINTS, k, all.at(IMPULSE, k));
        __syncthreads();
        telling.tell(work, c.given, MAX_POINTS, count);
    }
}
