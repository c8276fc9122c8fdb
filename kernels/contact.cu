// Contact of tools with the tissue's surface, by projection; see src/cpu/contact.rs for what it means.
//
// Once a step, the vertices that tools may meet are listed. After every substep one block finds those inside a tool and the impulses that put them
// back: a projected gradient with momentum that starts from the last substep's. Points give to nodes and nodes to points by gathering along fixed lists, and every
// sum has a fixed order.
#include "contact.cuh"
#include "layout.cuh"

namespace contact_kernel {

// Threads of the one block that lists, and of the one that resolves: contact is small, and fewer warps meet sooner.
constexpr int LIST_THREADS = 1024;
constexpr int THREADS = 256;
constexpr int WARPS = THREADS / 32;
// Iterations for the impulses.
constexpr int ITERATIONS = 8;
// Of a point's mobility, how much must belong to free nodes for the point to count as movable.
constexpr float MOVABLE = 1e-3f;
constexpr uint32_t NONE = ~0u;

// Places in Contact::counts.
enum Count { NEAR, NODES, DROPPED, POINTS, TAG, PUSHED };

__device__ Vec vec(const float* v) { return {v[0], v[1], v[2]}; }

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
__device__ Vec from_tool(const float* rest, const View& view) {
    return {float(double(rest[0]) - view.at[0]), float(double(rest[1]) - view.at[1]), float(double(rest[2]) - view.at[2])};
}

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

__device__ Vec displacement(const Contact& c, const float4* u, uint32_t vertex) {
    const NodeRow row = row_of(c, vertex);
    Vec sum{0, 0, 0};
    for (int i = 0; i < 8; ++i) {
        const float4 d = u[row.node[i]];
        sum = sum + Vec{d.x, d.y, d.z} * row.weight[i];
    }
    return sum;
}

// Place of a slot's velocity along x; y and z follow at distances of BRICK_NODES.
__device__ size_t velocity_at(uint32_t slot) { return size_t(slot / BRICK_NODES) * (3 * BRICK_NODES) + slot % BRICK_NODES; }

// Exclusive sum over the block; `total` is that of all. Every thread calls it.
template <int WARPS>
__device__ uint32_t scan(uint32_t mine, uint32_t& total) {
    __shared__ uint32_t of_warp[WARPS];
    const uint32_t lane = threadIdx.x & 31, warp = threadIdx.x / 32;
    uint32_t sum = mine;
    for (int step = 1; step < 32; step *= 2) {
        const uint32_t below = __shfl_up_sync(~0u, sum, step);
        if (lane >= step) sum += below;
    }
    __syncthreads();
    if (lane == 31) of_warp[warp] = sum;
    __syncthreads();
    uint32_t before = 0;
    total = 0;
    for (int w = 0; w < WARPS; ++w) {
        if (w < warp) before += of_warp[w];
        total += of_warp[w];
    }
    return before + sum - mine;
}

}  // namespace contact_kernel
using namespace contact_kernel;

// Marks the vertices that a tool may meet in the coming step.
extern "C" __global__ void contact_near(const __grid_constant__ Contact c, const __grid_constant__ Pass pass) {
    const uint32_t vertex = blockIdx.x * blockDim.x + threadIdx.x;
    bool near = false;
    if (vertex < c.vertices) {
        const Step& step = *pass.step;
        const float* rest = c.rest + 3 * vertex;
        const Vec d = displacement(c, pass.u, vertex);
        for (uint32_t t = 0; t < step.tool_count; ++t) {
            const ToolStep& tool = step.tools[t];
            // From the nearest point of the way.
            const Vec way{float(tool.to[0] - tool.from[0]), float(tool.to[1] - tool.from[1]), float(tool.to[2] - tool.from[2])};
            const Vec at = Vec{float(double(rest[0]) - tool.from[0]), float(double(rest[1]) - tool.from[1]), float(double(rest[2]) - tool.from[2])} + d;
            const float along = dot(way, way) > 0.0f ? clamp(dot(at, way) / dot(way, way), 0.0f, 1.0f) : 0.0f;
            near = near || norm(at - way * along) < tool.radius + step.margin;
        }
    }
    const uint32_t bits = __ballot_sync(~0u, near);
    if ((threadIdx.x & 31) == 0 && vertex < c.vertices) c.near_bits[vertex / 32] = bits;
}

// Lists the marked vertices in their order, and the nodes that carry them.
extern "C" __global__ void __launch_bounds__(LIST_THREADS) contact_list(const __grid_constant__ Contact c, const __grid_constant__ Pass pass) {
    __shared__ uint32_t nodes;
    if (threadIdx.x == 0) nodes = 0;
    const uint32_t words = (c.vertices + 31) / 32;
    uint32_t count = 0;
    for (uint32_t first = 0; first < words; first += LIST_THREADS) {
        const uint32_t word = first + threadIdx.x;
        uint32_t bits = word < words ? c.near_bits[word] : 0, total;
        uint32_t at = count + scan<LIST_THREADS / 32>(__popc(bits), total);
        for (; bits; bits &= bits - 1, ++at) {
            if (at < MAX_NEAR) c.near[at] = word * 32 + __ffs(bits) - 1;
        }
        count += total;
    }
    const uint32_t stamp = pass.step->sequence;
    if (threadIdx.x == 0) {
        if (count > MAX_NEAR) c.counts[DROPPED] += count - MAX_NEAR;
        c.counts[NEAR] = count = min(count, uint32_t(MAX_NEAR));
    }
    __syncthreads();
    count = c.counts[NEAR];
    for (uint32_t i = threadIdx.x; i < 8 * count; i += LIST_THREADS) {
        const uint32_t slot = reinterpret_cast<const uint32_t*>(c.row_nodes)[8 * c.near[i / 8] + i % 8];
        if (atomicExch(&c.node_stamp[slot], stamp) == stamp) continue;
        const uint32_t node = atomicAdd(&nodes, 1);
        c.node_of[slot] = node;
        c.nodes[node] = slot;
        c.node_tag[node] = 0;
        const uint32_t word = __float_as_uint(pass.u[slot].w);
        float mass = 0.0f;
        for (int corner = 0; corner < 8; ++corner) mass += pass.laws[word >> (4 * corner) & 15].corner;
        const float inverse = mass > 0.0f ? 1.0f / mass : 0.0f;
        const uint32_t flags = pass.flags[slot];
        c.mobility[node] = make_float4(flags & 1 ? 0.0f : inverse, flags & 2 ? 0.0f : inverse, flags & 4 ? 0.0f : inverse, inverse);
    }
    __syncthreads();
    if (threadIdx.x == 0) c.counts[NODES] = nodes;
    // Tools start the step with nothing.
    for (uint32_t i = threadIdx.x; i < pass.step->tool_count; i += LIST_THREADS) c.sums[i] = ToolSum{};
}

// Where and when a projection takes place.
struct Moment {
    // The fraction of the step at its start and end.
    float from, to;
    // Whether the tissue moved here, or only the tools; and whether this is the last move of the substep.
    uint32_t tissue_moves, is_last;
};

namespace contact_kernel {

// What iterations exchange: a point's impulse, and what it makes of the velocity of the nodes.
struct Exchange {
    float4* impulse;  // [max_points]
    float4* change;   // [max_touched]
    // Before the first change is known: how many points a node carries, and where the next one is put.
    __device__ uint32_t* length(uint32_t j) const { return reinterpret_cast<uint32_t*>(&change[j].x); }
    __device__ uint32_t* place(uint32_t j) const { return reinterpret_cast<uint32_t*>(&change[j].y); }
};

// The points of one time.
struct Points {
    float* field;
    __device__ float& at(int f, uint32_t k) const { return field[f * MAX_POINTS + k]; }
    __device__ uint32_t& word(int f, uint32_t k) const { return reinterpret_cast<uint32_t*>(field)[f * MAX_POINTS + k]; }
    __device__ Vec vec(int f, uint32_t k) const { return {at(f, k), at(f + 1, k), at(f + 2, k)}; }
    __device__ void put(int f, uint32_t k, Vec v) const { at(f, k) = v.x, at(f + 1, k) = v.y, at(f + 2, k) = v.z; }
};

// The point of a tool on a vertex at a time that `tag` names, if there is one.
__device__ uint32_t find_point(const Contact& c, Points points, uint32_t vertex, uint32_t tag, uint32_t tool) {
    if (c.head_tag[vertex] != tag) return NONE;
    uint32_t at = c.head[vertex];
    while (at != NONE && points.word(TOOL, at) != tool) at = points.word(NEXT, at);
    return at;
}

// Appends a point to its vertex's list. One thread cares for a vertex, tool after tool.
__device__ void link(const Contact& c, Points points, uint32_t vertex, uint32_t tag, uint32_t point) {
    if (c.head_tag[vertex] != tag) {
        c.head_tag[vertex] = tag;
        c.head[vertex] = point;
        return;
    }
    uint32_t at = c.head[vertex];
    while (points.word(NEXT, at) != NONE) at = points.word(NEXT, at);
    points.word(NEXT, at) = point;
}

// Changes of the nodes' velocities by the points' impulses.
__device__ void give_to_nodes(const Contact& c, const Exchange& s, uint32_t nodes) {
    for (uint32_t j = threadIdx.x; j < nodes; j += THREADS) {
        const float4 mobility = c.touched_mobility[j];
        Vec sum{0, 0, 0};
        const uint32_t end = c.entry_start[j + 1];
        // Four at a time, so that their loads do not wait for each other; what is not there weighs nothing.
        for (uint32_t e = c.entry_start[j]; e < end; e += 4) {
            uint2 entry[4];
            float4 impulse[4];
#pragma unroll
            for (int i = 0; i < 4; ++i) entry[i] = e + i < end ? c.entries[e + i] : make_uint2(0, 0);
#pragma unroll
            for (int i = 0; i < 4; ++i) impulse[i] = s.impulse[entry[i].x];
#pragma unroll
            for (int i = 0; i < 4; ++i) sum = sum + Vec{impulse[i].x, impulse[i].y, impulse[i].z} * __uint_as_float(entry[i].y);
        }
        s.change[j] = make_float4(sum.x * mobility.x, sum.y * mobility.y, sum.z * mobility.z, 0.0f);
    }
}

}  // namespace contact_kernel

extern "C" __global__ void __launch_bounds__(THREADS)
    contact_resolve(const __grid_constant__ Contact c, const __grid_constant__ Pass pass, const __grid_constant__ Moment moment) {
    extern __shared__ float4 exchanged[];
    const Exchange s{exchanged, exchanged + c.max_points};
    if (*pass.diverged_at <= pass.substep) return;
    const uint32_t near_count = c.counts[NEAR];
    const Step& step = *pass.step;
    const uint32_t tools = step.tool_count;
    __shared__ View now[MAX_TOOLS], before[MAX_TOOLS];
    __shared__ uint32_t touched;
    if (threadIdx.x < tools) {
        now[threadIdx.x] = view_of(step.tools[threadIdx.x], moment.to);
        before[threadIdx.x] = view_of(step.tools[threadIdx.x], moment.from);
    }
    if (threadIdx.x == 0) touched = 0;
    __syncthreads();
    const uint32_t tag = c.counts[TAG] + 1;
    // Points live twice: those of now, and those of the last time.
    const Points points{c.points + (tag & 1) * POINT_FIELDS * MAX_POINTS};
    const Points last_points{c.points + (~tag & 1) * POINT_FIELDS * MAX_POINTS};

    // Find the points inside tools, in the order of tools and vertices.
    uint32_t count = 0;
    for (uint32_t t = 0; t < tools; ++t) {
        const ToolStep& tool = step.tools[t];
        for (uint32_t first = 0; first < near_count; first += THREADS) {
            const uint32_t near = first + threadIdx.x;
            Distance met{1.0f, {0, 0, 1}};
            Vec at{0, 0, 0}, normal{0, 0, 1};
            float travel = 0.0f;
            uint32_t vertex = 0;
            if (near < near_count) {
                vertex = c.near[near];
                const float* rest = c.rest + 3 * vertex;
                const Vec moved = displacement(c, pass.u_next, vertex);
                at = from_tool(rest, now[t]) + moved;
                const Vec local = rotate(conjugate(now[t].turn), at);
                // Where it came from, as the tool sees it; that matters only if it may have come far.
                const Vec came = moment.tissue_moves && step.may_jump ? displacement(c, pass.u, vertex) : moved;
                const Vec start = rotate(conjugate(before[t].turn), from_tool(rest, before[t]) + came);
                travel = norm(local - start);
                if (travel > tool.spacing) {
                    met = meet(c.parts + tool.part, tool.part_count, start, local, travel / tool.spacing);
                } else if (dot(at, at) < tool.radius * tool.radius) {
                    met = tool_distance(c.parts + tool.part, tool.part_count, local);
                }
                normal = rotate(now[t].turn, met.normal);
            }
            const bool inside = met.distance < 0.0f;
            uint32_t total;
            const uint32_t place = count + scan<WARPS>(inside, total);
            count = min(count + total, c.max_points);
            if (inside && place >= c.max_points) atomicAdd(&c.counts[DROPPED], 1);
            if (!inside || place >= c.max_points) continue;

            points.word(VERTEX, place) = vertex;
            points.word(TOOL, place) = t;
            points.word(NEXT, place) = NONE;
            points.put(AT, place, at);
            points.put(NORMAL, place, normal);
            points.at(DEPTH, place) = -met.distance;
            const Vec linear{float(tool.to[0] - tool.from[0]), float(tool.to[1] - tool.from[1]), float(tool.to[2] - tool.from[2])};
            const Vec tool_velocity = (linear + cross(vec(tool.turn), at)) * (1.0f / step.duration);
            points.put(TOOL_VELOCITY, place, tool_velocity);
            const NodeRow row = row_of(c, vertex);
            Vec velocity{0, 0, 0};
            float free = 0.0f, all = 0.0f, fastest = 0.0f;
            uint32_t node_at[8], old_tag[8];
#pragma unroll
            for (int i = 0; i < 8; ++i) {
                const uint32_t node = c.node_of[row.node[i]];
                const float w = row.weight[i];
                const size_t v = velocity_at(row.node[i]);
                velocity = velocity + Vec{pass.v_next[v], pass.v_next[v + BRICK_NODES], pass.v_next[v + 2 * BRICK_NODES]} * w;
                const float4 m = c.mobility[node];
                free += w * w * (m.x * normal.x * normal.x + m.y * normal.y * normal.y + m.z * normal.z * normal.z);
                all += w * w * m.w;
                fastest = fmaxf(fastest, fabsf(w) * fmaxf(m.x, fmaxf(m.y, m.z)));
                points.at(WEIGHTS + i, place) = w;
                points.word(NODE + i, place) = node;
                node_at[i] = node;
                old_tag[i] = w != 0.0f ? atomicExch(&c.node_tag[node], tag) : tag;
            }
            // The nodes that carry points, each once.
            for (int i = 0; i < 8; ++i) {
                if (old_tag[i] == tag) continue;
                const uint32_t j = atomicAdd(&touched, 1);
                if (j < c.max_touched) c.touched[j] = node_at[i];
                c.touched_at[node_at[i]] = j < c.max_touched ? j : NONE;
            }
            const bool movable = free > MOVABLE * all;
            const float mass = 1.0f / (movable ? free : all);
            const float lever = 1.0f / fmaxf(1.0f, fastest * mass);
            points.word(IS_MOVABLE, place) = movable;
            points.at(TARGET, place) = fminf(-met.distance, (step.push_limit + travel) * lever) / step.dt;
            points.put(BEFORE, place, velocity - tool_velocity);
            // What cannot move stays inside the tool: of several moves in a substep the last alone counts.
            float push = movable || !moment.is_last ? 0.0f : mass * -met.distance / step.dt;
            Vec drag{0, 0, 0};
            // The last substep's impulses are a good guess.
            const uint32_t was = find_point(c, last_points, vertex, tag - 1, t);
            if (movable && was != NONE) {
                push = last_points.at(PUSH, was);
                drag = last_points.vec(DRAG, was);
                drag = drag - normal * dot(drag, normal);
            }
            points.at(PUSH, place) = push;
            points.put(DRAG, place, drag);
            link(c, points, vertex, tag, place);
        }
    }
    if (threadIdx.x == 0) {
        c.counts[POINTS] = count;
        c.counts[TAG] = tag;
        c.counts[PUSHED] = 0;
    }
    if (count == 0) return;
    __syncthreads();
    const uint32_t nodes = min(touched, c.max_touched);

    // The points that each of these nodes carries: counted, placed, and then brought into their order.
    for (uint32_t j = threadIdx.x; j < nodes; j += THREADS) {
        s.change[j] = make_float4(0, 0, 0, 0);
        c.touched_mobility[j] = c.mobility[c.touched[j]];
    }
    __syncthreads();
    for (uint32_t k = threadIdx.x; k < count; k += THREADS) {
        uint32_t at[8];
        bool has_room = true;
#pragma unroll
        for (int i = 0; i < 8; ++i) {
            // A node without weight may be none of these.
            at[i] = points.at(WEIGHTS + i, k) != 0.0f ? c.touched_at[points.word(NODE + i, k)] : 0;
            has_room = has_room && at[i] != NONE;
        }
        if (!has_room) {
            points.word(IS_MOVABLE, k) = 0;
            points.at(PUSH, k) = 0.0f;
            points.put(DRAG, k, {0, 0, 0});
            atomicAdd(&c.counts[DROPPED], 1);
        }
        const bool movable = points.word(IS_MOVABLE, k);
#pragma unroll
        for (int i = 0; i < 8; ++i) {
            points.word(NODE + i, k) = has_room ? at[i] : 0;
            if (movable && points.at(WEIGHTS + i, k) != 0.0f) atomicAdd(s.length(at[i]), 1);
        }
    }
    __syncthreads();
    uint32_t entries = 0;
    for (uint32_t first = 0; first < nodes; first += THREADS) {
        const uint32_t j = first + threadIdx.x, mine = j < nodes ? *s.length(j) : 0;
        uint32_t total;
        const uint32_t start = entries + scan<WARPS>(mine, total);
        entries += total;
        if (j < nodes) {
            c.entry_start[j] = start;
            *s.place(j) = start;
        }
        if (j + 1 == nodes) c.entry_start[nodes] = start + mine;
    }
    __syncthreads();
    for (uint32_t k = threadIdx.x; k < count; k += THREADS) {
        if (!points.word(IS_MOVABLE, k)) continue;
        for (int i = 0; i < 8; ++i) {
            const float w = points.at(WEIGHTS + i, k);
            if (w != 0.0f) c.entries[atomicAdd(s.place(points.word(NODE + i, k)), 1)] = make_uint2(k, __float_as_uint(w));
        }
    }
    __syncthreads();
    for (uint32_t j = threadIdx.x; j < nodes; j += THREADS) {
        const uint32_t start = c.entry_start[j], end = start + *s.length(j);
        for (uint32_t e = start; e < end; ++e) {
            const uint2 entry = c.entries[e];
            uint32_t to = e;
            for (; to > start && c.entries[to - 1].x > entry.x; --to) c.entries[to] = c.entries[to - 1];
            c.entries[to] = entry;
        }
        float reach = 0.0f;
        for (uint32_t e = start; e < end; ++e) reach += fabsf(__uint_as_float(c.entries[e].y));
        const float4 m = c.touched_mobility[j];
        s.change[j].w = reach * fmaxf(m.x, fmaxf(m.y, m.z));
    }
    __syncthreads();
    // How much all points together move each one at most: an impulse scaled by that never overshoots.
    for (uint32_t k = threadIdx.x; k < count; k += THREADS) {
        float reach = 0.0f;
        for (int i = 0; i < 8; ++i) reach += fabsf(points.at(WEIGHTS + i, k)) * s.change[points.word(NODE + i, k)].w;
        const bool movable = points.word(IS_MOVABLE, k);
        const float push = points.at(PUSH, k);
        const Vec drag = points.vec(DRAG, k);
        points.at(MASS, k) = movable ? 1.0f / reach : 0.0f;
        points.at(LAST_PUSH, k) = push;
        points.put(LAST_DRAG, k, drag);
        const Vec j = movable ? points.vec(NORMAL, k) * push + drag : Vec{0, 0, 0};
        s.impulse[k] = make_float4(j.x, j.y, j.z, 0.0f);
    }
    __syncthreads();

    // Impulses that put every point on its tool.
    for (int iteration = 0; iteration < ITERATIONS; ++iteration) {
        give_to_nodes(c, s, nodes);
        __syncthreads();
        const float momentum = iteration + 1 == ITERATIONS ? 0.0f : float(iteration) / float(iteration + 3);
        for (uint32_t k = threadIdx.x; k < count; k += THREADS) {
            if (!points.word(IS_MOVABLE, k)) continue;
            const Vec n = points.vec(NORMAL, k);
            Vec change{0, 0, 0};
            for (int i = 0; i < 8; ++i) {
                const float4 d = s.change[points.word(NODE + i, k)];
                change = change + Vec{d.x, d.y, d.z} * points.at(WEIGHTS + i, k);
            }
            // Along the normal: the rest of the depth, by pushing alone.
            const float mass = points.at(MASS, k);
            const float push = fmaxf(points.at(PUSH, k) + mass * (points.at(TARGET, k) - dot(change, n)), 0.0f);
            // Across it: with the tool, inside Coulomb's cone.
            Vec slip = points.vec(BEFORE, k) + change;
            slip = slip - n * dot(slip, n);
            Vec drag = points.vec(DRAG, k) - slip * mass;
            const float cone = step.tools[points.word(TOOL, k)].friction * push, size = norm(drag);
            if (size > cone) drag = drag * (cone / size);
            // Where momentum carries the impulses.
            const float next_push = push + (push - points.at(LAST_PUSH, k)) * momentum;
            const Vec next_drag = drag + (drag - points.vec(LAST_DRAG, k)) * momentum;
            points.at(LAST_PUSH, k) = push;
            points.put(LAST_DRAG, k, drag);
            points.at(PUSH, k) = next_push;
            points.put(DRAG, k, next_drag);
            const Vec j = n * next_push + next_drag;
            s.impulse[k] = make_float4(j.x, j.y, j.z, 0.0f);
        }
        __syncthreads();
    }
    give_to_nodes(c, s, nodes);
    __syncthreads();

    // What the nodes receive.
    for (uint32_t j = threadIdx.x; j < nodes; j += THREADS) {
        const uint32_t slot = c.nodes[c.touched[j]];
        const float4 change = s.change[j];
        const size_t v = velocity_at(slot);
        pass.v_next[v] += change.x;
        pass.v_next[v + BRICK_NODES] += change.y;
        pass.v_next[v + 2 * BRICK_NODES] += change.z;
        float4& u = pass.u_next[slot];
        u.x += change.x * step.dt;
        u.y += change.y * step.dt;
        u.z += change.z * step.dt;
    }

    for (uint32_t k = threadIdx.x; k < count; k += THREADS) {
        if (points.at(PUSH, k) > 0.0f) atomicAdd(&c.counts[PUSHED], 1);
    }
    // What the tools receive: every thread its points, a warp as a tree, then the warps in order.
    __shared__ double parts[7][WARPS];
    for (uint32_t t = 0; t < tools; ++t) {
        double mine[7] = {};
        for (uint32_t k = threadIdx.x; k < count; k += THREADS) {
            const float push = points.at(PUSH, k);
            if (points.word(TOOL, k) != t || push <= 0.0f) continue;
            const Vec j = points.vec(NORMAL, k) * push + points.vec(DRAG, k), m = cross(points.vec(AT, k), j);
            mine[0] -= j.x, mine[1] -= j.y, mine[2] -= j.z;
            mine[3] -= m.x, mine[4] -= m.y, mine[5] -= m.z;
            mine[6] += dot(j, points.vec(TOOL_VELOCITY, k));
        }
        __syncthreads();
        for (int i = 0; i < 7; ++i) {
            for (int half = 16; half > 0; half /= 2) mine[i] += __shfl_down_sync(~0u, mine[i], half);
            if ((threadIdx.x & 31) == 0) parts[i][threadIdx.x / 32] = mine[i];
        }
        __syncthreads();
        if (threadIdx.x < 7) {
            double sum = 0.0;
            for (int w = 0; w < WARPS; ++w) sum += parts[threadIdx.x][w];
            ToolSum& told = c.sums[t];
            double* const to = threadIdx.x < 3 ? told.impulse + threadIdx.x : threadIdx.x < 6 ? told.moment + (threadIdx.x - 3) : &told.work;
            *to += sum;
        }
    }
}
