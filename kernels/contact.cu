// Contact of tools with the tissue's surface, by projection; see src/cpu/contact/mod.rs for what it means.
//
// After every substep one block finds the sites inside tools and the impulses that put them back: a projected gradient with momentum that starts from
// the last substep's impulses. Every sum has a fixed order.
//
// The block is all latency: of loads that wait for each other, and of code, which has to be fetched while it runs for the first time. So loads come
// early and together, loops stay loops, and nothing is written twice. Where points are few, which is usual, a group of eight threads cares for a site, and
// what impulses do to each other's sites, worked out when sites were listed (near.cu), stays in registers.
#include "block.cuh"
#include "contact.cuh"
#include "layout.cuh"

namespace contact_kernel {

constexpr int THREADS = 512, WARPS = THREADS / 32;
// Threads that care for a site, and sites that are cared for at once.
constexpr int LANES = 8, GROUPS = THREADS / LANES;
// Couplings that a thread keeps in registers.
constexpr int HELD = MAX_COUPLED / LANES;
// Most iterations for the impulses. One is the last when it changes none by more than this share of the largest.
constexpr int ITERATIONS = 8;
constexpr float CONVERGED = 1e-4f;
// Of a point's mobility, how much must belong to free nodes for the point to count as movable.
constexpr float MOVABLE = 1e-3f;
// Most points of one site: more tools than that do not meet in one place.
constexpr uint32_t MOST_OF_SITE = 7;
constexpr uint16_t NOT_ACTIVE = 0xffff;

__device__ Vec vec(const float* v) { return {v[0], v[1], v[2]}; }
__device__ Vec vec(const float4& v) { return {v.x, v.y, v.z}; }
__device__ float4 with(const Vec& v, float w) { return make_float4(v.x, v.y, v.z, w); }

// Sums over the eight threads of a group.
__device__ float group_sum(float x) {
    for (int step = 1; step < LANES; step *= 2) x += __shfl_xor_sync(~0u, x, step);
    return x;
}
__device__ Vec group_sum(const Vec& v) { return {group_sum(v.x), group_sum(v.y), group_sum(v.z)}; }

// A tool at an instant of the step.
struct View {
    double at[3];
    Quat turn;
};

__device__ View view_of(const ToolStep& tool, float t) {
    View view;
    for (int a = 0; a < 3; ++a) view.at[a] = t >= 1.0f ? tool.to[a] : tool.from[a] + (tool.to[a] - tool.from[a]) * double(t);
    view.turn = turn_by(vec(tool.turn) * t) * Quat{tool.turn_from[0], tool.turn_from[1], tool.turn_from[2], tool.turn_from[3]};
    return view;
}

// A rest position seen from a tool's origin: large numbers subtract in double precision.
__device__ Vec from_tool(const Vec& rest, const View& view) {
    return {float(double(rest.x) - view.at[0]), float(double(rest.y) - view.at[1]), float(double(rest.z) - view.at[2])};
}

// How fast a tool moves at `at`, seen from its origin.
__device__ Vec velocity_of(const ToolStep& tool, const Vec& at, float duration) {
    const Vec linear{float(tool.to[0] - tool.from[0]), float(tool.to[1] - tool.from[1]), float(tool.to[2] - tool.from[2])};
    return (linear + cross(vec(tool.turn), at)) * (1.0f / duration);
}

// A site and a tool.
struct Probe {
    Vec at;
    // How far the site came in this move, seen from the tool.
    float travel;
    Distance met;
};

__device__ __forceinline__ Probe probe(const Contact& c, const ToolStep& tool, const View& now, const View& before, const Vec& rest, const Vec& moved,
                                       const Vec& came) {
    Probe p{from_tool(rest, now) + moved, 0.0f, {1.0f, {0, 0, 1}}};
    const Vec local = rotate(conjugate(now.turn), p.at);
    const Vec start = rotate(conjugate(before.turn), from_tool(rest, before) + came);
    p.travel = norm(local - start);
    const float strides = p.travel / tool.spacing;
    if (strides > 1.0f || dot(p.at, p.at) < tool.radius * tool.radius) p.met = meet(c.parts + tool.part, tool.part_count, start, local, strides);
    return p;
}

// Points of one time: in global memory, or as far as iterations need them in shared memory.
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

// One iteration of a point on a site whose velocity all impulses change by `change`. Carries the impulse on by momentum; `last` is what it was found to
// be. Gives how much that changed.
__device__ __forceinline__ float improve(const Known& k, const Vec& change, float momentum, Impulse& now, Impulse& last) {
    // Along the normal: the rest of the depth, by pushing alone.
    const float push = fmaxf(now.push + k.mass * (k.target - dot(change, k.normal)), 0.0f);
    // Across it: with the tool, inside Coulomb's cone.
    Vec slip = k.before + change;
    slip = slip - k.normal * dot(slip, k.normal);
    Vec drag = now.drag - slip * k.mass;
    const float cone = k.friction * push, size2 = dot(drag, drag);
    if (size2 > cone * cone) drag = drag * (cone * rsqrtf(size2));
    const float along = push - last.push;
    const Vec across = drag - last.drag;
    now = {push + along * momentum, drag + across * momentum};
    last = {push, drag};
    return fmaxf(fabsf(along), fmaxf(fabsf(across.x), fmaxf(fabsf(across.y), fabsf(across.z))));
}

// How far impulses are carried on in the direction of an iteration's change.
__device__ float momentum_of(int iteration) { return float(iteration) / float(iteration + 3); }

// The dynamic shared memory.
struct Room {
    // Impulses on active sites, of two iterations in turn.
    float4* impulse[2];
    // Which site an active one is, its first point; and which active one a site is.
    uint16_t *site, *first, *active;
    __device__ Room(float4* at, uint32_t points)
        : impulse{at, at + points}, site(reinterpret_cast<uint16_t*>(at + 2 * points)), first(site + points), active(first + points + 8) {}
};

// What a block works on.
struct Work {
    const Contact& c;
    const Pass& pass;
    const Step& step;
    const Room room;
    // Points of now, and of the last time.
    const Points points, old;
    uint32_t tag, active;
    // The largest impulse of the last time's, as bits; and the points that a site had then, for few.
    uint32_t* largest;
    const uint2* touched;
};

__device__ Vec velocity_of(const Work& w, uint32_t slot) {
    const size_t at = velocity_at(slot);
    return {w.pass.v_next[at], w.pass.v_next[at + BRICK_NODES], w.pass.v_next[at + 2 * BRICK_NODES]};
}

// The last time's impulse of a point's tool on its site.
__device__ __forceinline__ Impulse guess_of(const Work& w, const uint2& touch, uint32_t k) {
    const float4 normal = w.points.at(NORMAL, k);
    if (normal.w <= 0.0f) return {-normal.w, {0, 0, 0}};
    Impulse guess{0.0f, {0, 0, 0}};
#pragma unroll 1
    for (uint32_t was = touch.y & 0xffff, end = was + (touch.y >> 16); touch.x == w.tag - 1 && was < end; ++was) {
        const float4 impulse = w.old.at(IMPULSE, was);
        if (__float_as_uint(w.old.at(NAMES, was).x) != __float_as_uint(w.points.at(NAMES, k).x)) continue;
        guess = {fmaxf(impulse.w, 0.0f), vec(impulse) - vec(normal) * dot(vec(impulse), vec(normal))};
    }
    return guess;
}

// What is known of a point on a site that moves with `velocity` and that all points together move by 1 / `mass` at most.
__device__ Known known_of(const Work& w, uint32_t k, const Vec& velocity, float mass) {
    const float4 normal = w.points.at(NORMAL, k);
    const ToolStep& tool = w.step.tools[__float_as_uint(w.points.at(NAMES, k).x)];
    return {vec(normal), normal.w, velocity - velocity_of(tool, vec(w.points.at(AT, k)), w.step.duration), mass, tool.friction};
}

// The impulse on a site of one point.
__device__ Vec impulse_of(const Known& known, const Impulse& j) { return known.is_movable() ? known.normal * j.push + j.drag : Vec{0, 0, 0}; }

// Whether a carrier's first active site is `a`: who cares for that one cares for the carrier as well.
__device__ bool is_first(const Work& w, const Carrier& carrier, uint32_t a) {
    uint32_t first = NOT_ACTIVE;
#pragma unroll 4
    for (uint32_t e = carrier.start; e < carrier.start + carrier.count; ++e) {
        // Active sites are numbered in the order of the list.
        first = min(first, uint32_t(w.room.active[w.c.loads[e].site]));
    }
    return first == a;
}

// The sum of all impulses on a carrier.
__device__ __forceinline__ Vec load_of(const Work& w, const Carrier& carrier, const float4* impulses) {
    Vec sum{0, 0, 0};
#pragma unroll 4
    for (uint32_t e = carrier.start; e < carrier.start + carrier.count; ++e) {
        const Load load = w.c.loads[e];
        const uint32_t other = w.room.active[load.site];
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

// Vertices, no more of them active than there are groups, each with one point: a group keeps its site in registers, and each of its threads a node.
__device__ __forceinline__ void resolve_few(const Work& w, const Points& all) {
    const uint32_t lane = threadIdx.x % LANES, group = threadIdx.x / LANES;
    // Groups of a warp stay together; those without a site repeat another's work and keep it to themselves.
    const bool is_busy = (group & ~3u) < w.active, is_mine = group < w.active;
    const uint32_t a = min(group, w.active - 1), site = w.room.site[a], at = lane * MAX_SITES + site;
    uint32_t others[HELD], widest = 0;
    Vec by[HELD];
    Known known;
    Impulse now, last;
    Carrier carrier;
    Vec v;
    float4 u, mobility;
    bool is_carried = false;
    if (is_busy) {
        const uint32_t slot = w.c.site_slots[at], on = w.c.site_carriers[at];
        const float weight = w.c.site_weights[at];
        v = velocity_of(w, slot);
        u = w.pass.u_next[slot];
        is_carried = on != ~0u;
        carrier = w.c.carriers[is_carried ? on : 0];
        mobility = w.c.mobility[is_carried ? on : 0];
        float reach = 0.0f;
#pragma unroll
        for (int i = 0; i < HELD; ++i) {
            const float4 coupling = w.c.couplings[site * MAX_COUPLED + i * LANES + lane];
            const uint32_t other = w.room.active[__float_as_uint(coupling.w)];
            const bool is_there = other != NOT_ACTIVE && coupling.x + coupling.y + coupling.z != 0.0f;
            others[i] = is_there ? other : 0;
            by[i] = is_there ? vec(coupling) : Vec{0, 0, 0};
            reach += fmaxf(fabsf(by[i].x), fmaxf(fabsf(by[i].y), fabsf(by[i].z)));
            if (__any_sync(~0u, is_there)) widest = i + 1;
        }
        now = last = guess_of(w, w.touched[a], a);
        known = known_of(w, a, group_sum(v * weight), 1.0f / group_sum(reach));
        if (lane == 0 && is_mine) {
            w.room.impulse[0][a] = with(impulse_of(known, now), 0.0f);
            atomicMax(w.largest, __float_as_uint(now.push));
        }
        // Who writes which node: to be known when impulses are.
        is_carried = is_carried && is_mine && is_first(w, carrier, a);
    }
    __syncthreads();
    const float small = CONVERGED * __uint_as_float(*w.largest);
    int iteration = 0;
    bool is_done = false;
#pragma unroll 1
    for (; !is_done; ++iteration) {
        float changed = 0.0f;
        if (is_busy) {
            const float4* const from = w.room.impulse[iteration & 1];
            Vec change{0, 0, 0};
#pragma unroll
            for (int i = 0; i < HELD; ++i) {
                if (i >= widest) break;
                const float4 j = from[others[i]];
                change = change + Vec{by[i].x * j.x, by[i].y * j.y, by[i].z * j.z};
            }
            change = group_sum(change);
            if (known.is_movable()) changed = improve(known, change, momentum_of(iteration), now, last);
            if (lane == 0 && is_mine) w.room.impulse[~iteration & 1][a] = with(impulse_of(known, now), 0.0f);
        }
        is_done = !__syncthreads_or(changed > small) || iteration + 1 == ITERATIONS;
    }
    // What was found, without momentum.
    if (lane == 0 && is_mine) {
        w.room.impulse[iteration & 1][a] = with(impulse_of(known, last), 0.0f);
        w.points.at(IMPULSE, a) = all.at(IMPULSE, a) = with(last.drag, last.push);
    }
    __syncthreads();
    if (is_carried) kick(w, carrier.slot, v, u, scaled(mobility, load_of(w, carrier, w.room.impulse[iteration & 1])));
}

// Any number of points: impulses go to the nodes, and from the nodes to the sites.
template <int ROW>
__device__ __forceinline__ void resolve_many(const Work& w) {
    __shared__ uint32_t moved;
    if (threadIdx.x == 0) moved = 0;
    __syncthreads();
    // The carriers, each once; for now with how much unit impulses on all sites move them at most.
#pragma unroll 1
    for (uint32_t job = threadIdx.x; job < w.active * ROW; job += THREADS) {
        const uint32_t a = job / ROW, on = w.c.site_carriers[job % ROW * MAX_SITES + w.room.site[a]];
        if (on == ~0u) continue;
        const Carrier carrier = w.c.carriers[on];
        if (!is_first(w, carrier, a)) continue;
        w.c.moved[atomicAdd(&moved, 1)] = on;
        float reach = 0.0f;
#pragma unroll 4
        for (uint32_t e = carrier.start; e < carrier.start + carrier.count; ++e) {
            const Load load = w.c.loads[e];
            if (w.room.active[load.site] != NOT_ACTIVE) reach += fabsf(load.weight);
        }
        const float4 m = w.c.mobility[on];
        w.c.changes[on] = make_float4(0, 0, 0, reach * fmaxf(m.x, fmaxf(m.y, m.z)));
    }
    __syncthreads();
#pragma unroll 1
    for (uint32_t a = threadIdx.x; a < w.active; a += THREADS) {
        const uint32_t site = w.room.site[a];
        const uint2 touch = w.c.touches[(~w.tag & 1) * MAX_SITES + site];
        Vec velocity{0, 0, 0}, sum{0, 0, 0};
        float reach = 0.0f;
#pragma unroll 4
        for (int i = 0; i < ROW; ++i) {
            const float weight = w.c.site_weights[i * MAX_SITES + site];
            if (weight == 0.0f) continue;
            velocity = velocity + velocity_of(w, w.c.site_slots[i * MAX_SITES + site]) * weight;
            reach += fabsf(weight) * w.c.changes[w.c.site_carriers[i * MAX_SITES + site]].w;
        }
        for (uint32_t k = w.room.first[a]; k < w.room.first[a + 1]; ++k) {
            const Impulse guess = guess_of(w, touch, k);
            const Known known = known_of(w, k, velocity, 1.0f / reach);
            w.points.at(BEFORE, k) = with(known.before, known.mass);
            w.points.at(IMPULSE, k) = w.points.at(LAST, k) = with(guess.drag, guess.push);
            sum = sum + impulse_of(known, guess);
            atomicMax(w.largest, __float_as_uint(guess.push));
        }
        w.room.impulse[0][a] = with(sum, 0.0f);
    }
    __syncthreads();
    const float small = CONVERGED * __uint_as_float(*w.largest);
    bool is_last = false, is_done = false;
#pragma unroll 1
    for (int iteration = 0;; ++iteration) {
#pragma unroll 1
        for (uint32_t n = threadIdx.x; n < moved; n += THREADS) {
            const uint32_t on = w.c.moved[n];
            const Carrier carrier = w.c.carriers[on];
            const Vec change = scaled(w.c.mobility[on], load_of(w, carrier, w.room.impulse[0]));
            w.c.changes[on] = with(change, 0.0f);
            if (is_done) kick(w, carrier.slot, velocity_of(w, carrier.slot), w.pass.u_next[carrier.slot], change);
        }
        if (is_done) return;
        __syncthreads();
        float changed = 0.0f;
#pragma unroll 1
        for (uint32_t a = threadIdx.x; a < w.active; a += THREADS) {
            const uint32_t site = w.room.site[a];
            Vec change{0, 0, 0}, sum{0, 0, 0};
#pragma unroll 4
            for (int i = 0; i < ROW; ++i) {
                const uint32_t on = w.c.site_carriers[i * MAX_SITES + site];
                if (on != ~0u) change = change + vec(w.c.changes[on]) * w.c.site_weights[i * MAX_SITES + site];
            }
            for (uint32_t k = w.room.first[a]; k < w.room.first[a + 1]; ++k) {
                const float4 normal = w.points.at(NORMAL, k), seen = w.points.at(BEFORE, k), j = w.points.at(IMPULSE, k), l = w.points.at(LAST, k);
                const Known known{vec(normal), normal.w, vec(seen), seen.w, w.step.tools[__float_as_uint(w.points.at(NAMES, k).x)].friction};
                if (!known.is_movable()) continue;
                Impulse now{j.w, vec(j)}, last{l.w, vec(l)};
                // The last one's impulses are what was found, without momentum.
                changed = fmaxf(changed, improve(known, change, is_last ? 0.0f : momentum_of(iteration), now, last));
                w.points.at(IMPULSE, k) = with(now.drag, now.push);
                w.points.at(LAST, k) = with(last.drag, last.push);
                sum = sum + impulse_of(known, now);
            }
            w.room.impulse[0][a] = with(sum, 0.0f);
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
        const ToolStep& tool = w.step.tools[__float_as_uint(w.points.at(NAMES, k).x)];
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

template <int ROW>
__device__ __forceinline__ void resolve(const Contact& c, const Pass& pass, const Moment& moment) {
    extern __shared__ float4 shared[];
    const Room room(shared, c.max_points);
    __shared__ View now[MAX_TOOLS], before[MAX_TOOLS];
    __shared__ float4 mirror[(IMPULSE + 1) * GROUPS];
    __shared__ double given[7 * GROUPS];
    __shared__ uint2 touched[GROUPS];
    __shared__ uint32_t largest, last_active;
    const uint32_t thread = threadIdx.x;
    const Step& step = *pass.step;
    const uint32_t tools = step.tool_count, sites = c.counts[SITES], tag = c.counts[TAG] + 1, diverged_at = *pass.diverged_at;
    const bool follow = moment.tissue_moves && step.may_jump;
    const float dt = step.dt;
    if (moment.is_first && thread < tools) c.sums[thread] = ToolSum{};
    // By the last threads, for the first ones have most to do.
    if (THREADS - 1 - thread < 2 * tools) {
        const uint32_t i = THREADS - 1 - thread, t = i / 2;
        (i % 2 ? before : now)[t] = view_of(step.tools[t], i % 2 ? moment.from : moment.to);
    }
    if (thread == 0) largest = 0;
    const Points all{c.points + (tag & 1) * POINT_FIELDS * MAX_POINTS, MAX_POINTS};
    const Points old{c.points + (~tag & 1) * POINT_FIELDS * MAX_POINTS, MAX_POINTS};
    const Points few{mirror, GROUPS};

    // Find the points inside tools, in the order of sites and tools. What lies behind the last site is read as well: that is
    // quicker than to wait for their number.
    uint32_t count = 0, active = 0;
    bool is_held = ROW == LANES;
#pragma unroll 1
    for (uint32_t first = 0; first == 0 || first < sites; first += THREADS) {
        const uint32_t site = first + thread, coupled = c.site_coupled[site];
        const float4 rest = c.site_rest[site], own = c.site_own[site];
        const uint2 names = c.site_names[site], touch = c.touches[(~tag & 1) * MAX_SITES + site];
        Vec moved{0, 0, 0}, came{0, 0, 0};
#pragma unroll 8
        for (int i = 0; i < ROW; ++i) {
            moved = moved + vec(pass.u_next[c.site_slots[i * MAX_SITES + site]]) * c.site_weights[i * MAX_SITES + site];
        }
        if (follow) {
#pragma unroll 1
            for (int i = 0; i < ROW; ++i) came = came + vec(pass.u[c.site_slots[i * MAX_SITES + site]]) * c.site_weights[i * MAX_SITES + site];
        } else {
            came = moved;
        }
        if (diverged_at <= pass.substep) return;
        if (first == 0) __syncthreads();
        uint64_t met = 0;
        uint32_t mine = 0, k = 0, end = 0;
        // Which tools the site is inside first, then the points; most are inside one and were looked at last.
        Probe p;
        uint32_t looked_at = ~0u;
#pragma unroll 1
        for (int round = 0; round < 2; ++round) {
#pragma unroll 1
            for (uint32_t t = 0; t < tools && site < sites; ++t) {
                if (round == 1 && (k == end || !(met >> t & 1))) continue;
                const ToolStep& tool = step.tools[t];
                if (t != looked_at) p = probe(c, tool, now[t], before[t], vec(rest), moved, came);
                looked_at = t;
                const float depth = -p.met.distance;
                if (round == 0) {
                    met |= uint64_t(depth > 0.0f) << t;
                    continue;
                }
                const Vec n = rotate(now[t].turn, p.met.normal);
                const float free = own.x * n.x * n.x + (own.y * n.y * n.y + own.z * n.z * n.z);
                const bool is_movable = free > MOVABLE * own.w;
                const float mass = 1.0f / (is_movable ? free : own.w), lever = 1.0f / fmaxf(1.0f, rest.w * mass);
                // What cannot move stays inside the tool: of several moves in a substep the last alone counts.
                const float target = is_movable      ? fminf(depth, (step.push_limit + p.travel) * lever) / dt
                                     : moment.is_last ? -mass * depth / dt
                                                      : 0.0f;
                const float4 normal = with(n, target), at = with(p.at, depth);
                const float4 named = make_float4(__uint_as_float(t), __uint_as_float(names.x), __uint_as_float(names.y), 0.0f);
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
            if (round == 1) continue;
            mine = min(__popcll(met), MOST_OF_SITE);
            uint32_t total;
            const uint32_t sum = scan<WARPS>(mine | (mine ? 1u << 16 : 0), total), a = active + (sum >> 16);
            k = count + (sum & 0xffff);
            end = min(k + mine, c.max_points);
            if (mine && k + mine > c.max_points) atomicAdd(&c.counts[DROPPED], k + mine - max(k, end));
            count = min(count + (total & 0xffff), c.max_points);
            active += total >> 16;
            // What comes after the last point that found room is not active.
            const bool is_active = k < end;
            if (site < sites) room.active[site] = is_active ? a : NOT_ACTIVE;
            if (!is_active) {
                end = k;
                continue;
            }
            if (end == c.max_points) last_active = a + 1;
            room.site[a] = site;
            room.first[a] = k;
            c.touches[(tag & 1) * MAX_SITES + site] = make_uint2(tag, k | (end - k) << 16);
            if (a < GROUPS) touched[a] = touch;
            is_held = is_held && a < GROUPS && end - k == 1 && coupled <= MAX_COUPLED;
        }
    }
    const bool is_small = __syncthreads_and(is_held);
    if (count == c.max_points) active = last_active;
    if (thread == 0) {
        room.first[active] = count;
        c.counts[POINTS] = count;
        c.counts[TAG] = tag;
        c.counts[PUSHED] = 0;
    }
    if (count == 0) return;
    __syncthreads();
    const Work work{c, pass, step, room, is_small ? few : all, old, tag, active, &largest, touched};
    if (ROW == LANES && is_small) {
        resolve_few(work, all);
    } else {
        resolve_many<ROW>(work);
    }
    tell_tools(work, is_small ? given : c.given, is_small ? GROUPS : MAX_POINTS, count);
}

}  // namespace contact_kernel
using namespace contact_kernel;

// Where sites are vertices, and where they lie inside triangles.
extern "C" __global__ void __launch_bounds__(THREADS)
    contact_vertices(const __grid_constant__ Contact c, const __grid_constant__ Pass pass, const __grid_constant__ Moment moment) {
    resolve<8>(c, pass, moment);
}
extern "C" __global__ void __launch_bounds__(THREADS)
    contact_centres(const __grid_constant__ Contact c, const __grid_constant__ Pass pass, const __grid_constant__ Moment moment) {
    resolve<MAX_ROW>(c, pass, moment);
}
