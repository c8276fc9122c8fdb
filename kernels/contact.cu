// Contact of tools with the tissue's surface, by projection; see src/cpu/contact.rs for what it means.
//
// Once a step, the vertices that tools may meet are listed. After every substep one block finds those inside a tool and the impulses that put them
// back: a projected gradient with momentum that starts from the last substep's. Points give to nodes and nodes to points by gathering along fixed lists, and every
// sum has a fixed order.
#include "contact.cuh"
#include "layout.cuh"

namespace {

constexpr int THREADS = 512;
constexpr int WARPS = THREADS / 32;
// Iterations for the impulses.
constexpr int ITERATIONS = 12;
// Of a point's mobility, how much must belong to free nodes for the point to count as movable.
constexpr float MOVABLE = 1e-3f;
constexpr uint32_t NONE = ~0u;

// Places in Contact::counts.
enum Count { NEAR, NODES, DROPPED, POINTS, TAG, TOUCHED };

__device__ Vec vec(const float* v) { return {v[0], v[1], v[2]}; }
__device__ void put(float* to, Vec v) { to[0] = v.x, to[1] = v.y, to[2] = v.z; }

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

__device__ Vec displacement(const Contact& c, const float4* u, uint32_t vertex) {
    Vec sum{0, 0, 0};
    for (int i = 0; i < 8; ++i) {
        const float w = c.row_weights[8 * vertex + i];
        const float4 d = u[c.row_nodes[8 * vertex + i]];
        sum = sum + Vec{d.x, d.y, d.z} * w;
    }
    return sum;
}

// Place of a slot's velocity along x; y and z follow at distances of BRICK_NODES.
__device__ size_t velocity_at(uint32_t slot) { return size_t(slot / BRICK_NODES) * (3 * BRICK_NODES) + slot % BRICK_NODES; }

// Exclusive sum over the block; `total` is that of all. Every thread calls it.
__device__ uint32_t scan(uint32_t mine, uint32_t& total) {
    __shared__ uint32_t of_warp[WARPS + 1];
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

}  // namespace

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
extern "C" __global__ void __launch_bounds__(THREADS) contact_list(const __grid_constant__ Contact c, const __grid_constant__ Pass pass) {
    const uint32_t words = (c.vertices + 31) / 32;
    uint32_t count = 0;
    for (uint32_t first = 0; first < words; first += THREADS) {
        const uint32_t word = first + threadIdx.x;
        uint32_t bits = word < words ? c.near_bits[word] : 0, total;
        uint32_t at = count + scan(__popc(bits), total);
        for (; bits; bits &= bits - 1, ++at) {
            if (at < MAX_NEAR) c.near[at] = word * 32 + __ffs(bits) - 1;
        }
        count += total;
    }
    __shared__ uint32_t nodes;
    const uint32_t stamp = pass.step->sequence;
    if (threadIdx.x == 0) {
        nodes = 0;
        if (count > MAX_NEAR) c.counts[DROPPED] += count - MAX_NEAR;
        c.counts[NEAR] = count = min(count, uint32_t(MAX_NEAR));
    }
    __syncthreads();
    count = c.counts[NEAR];
    for (uint32_t i = threadIdx.x; i < 8 * count; i += THREADS) {
        const uint32_t slot = c.row_nodes[8 * c.near[i / 8] + i % 8];
        if (atomicExch(&c.node_stamp[slot], stamp) == stamp) continue;
        const uint32_t node = atomicAdd(&nodes, 1);
        if (node >= MAX_NODES) {
            c.node_of[slot] = MAX_NODES - 1;
            continue;
        }
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
    if (threadIdx.x == 0) c.counts[NODES] = min(nodes, uint32_t(MAX_NODES));
    // Tools start the step with nothing.
    for (uint32_t i = threadIdx.x; i < pass.step->tool_count; i += THREADS) c.sums[i] = ToolSum{};
}

// Where and when a projection takes place.
struct Moment {
    // The fraction of the step at its start and end.
    float from, to;
    uint32_t substep;
    // Whether the tissue moved here, or only the tools; and whether this is the last move of the substep.
    uint32_t tissue_moves, is_last;
};

namespace {

// Impulses of all points on a vertex, in the order of the tools.
__device__ void sum_impulse(const Contact& c, const Point* points, uint32_t tools, uint32_t near) {
    float4 sum = make_float4(0, 0, 0, 0);
    for (uint32_t t = 0; t < tools; ++t) {
        const uint32_t point = c.point_of[t * MAX_NEAR + near];
        if (point == NONE) continue;
        const Point& p = points[point];
        const Vec j = vec(p.normal) * p.push + vec(p.drag);
        if (p.movable) sum = make_float4(sum.x + j.x, sum.y + j.y, sum.z + j.z, sum.w + 1.0f);
    }
    c.impulse[c.near[near]] = sum;
}

// Changes of the nodes' velocities by the points' impulses; with `counting`, how much a unit impulse on every point would move them at
// most.
__device__ void give_to_nodes(const Contact& c, uint32_t nodes, bool counting) {
    for (uint32_t i = threadIdx.x; i < nodes; i += THREADS) {
        const uint32_t node = c.touched[i], slot = c.nodes[node];
        const float4 mobility = c.mobility[node];
        float4 sum = make_float4(0, 0, 0, 0);
        const uint32_t end = c.carried_start[slot + 1];
        for (uint32_t at = c.carried_start[slot]; at < end; ++at) {
            const float4 j = c.impulse[c.carried_vertex[at]];
            const float w = c.carried_weight[at];
            sum = make_float4(sum.x + w * j.x, sum.y + w * j.y, sum.z + w * j.z, sum.w + fabsf(w) * j.w);
        }
        const float most = fmaxf(mobility.x, fmaxf(mobility.y, mobility.z));
        const float reach = counting ? sum.w * most : c.change[node].w;
        c.change[node] = make_float4(sum.x * mobility.x, sum.y * mobility.y, sum.z * mobility.z, reach);
    }
}

__device__ Vec change_at(const Contact& c, const Point& p) {
    Vec sum{0, 0, 0};
    for (int i = 0; i < 8; ++i) {
        const float4 d = c.change[p.nodes[i]];
        sum = sum + Vec{d.x, d.y, d.z} * p.weights[i];
    }
    return sum;
}

}  // namespace

extern "C" __global__ void __launch_bounds__(THREADS)
    contact_resolve(const __grid_constant__ Contact c, const __grid_constant__ Pass pass, const __grid_constant__ Moment moment) {
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
    Point* const points = c.points + (tag & 1) * MAX_POINTS;
    const Point* const last_points = c.points + (~tag & 1) * MAX_POINTS;

    // Find the points inside tools, in the order of tools and vertices.
    uint32_t count = 0, dropped = 0;
    for (uint32_t t = 0; t < tools; ++t) {
        const ToolStep& tool = step.tools[t];
        for (uint32_t first = 0; first < near_count; first += THREADS) {
            const uint32_t near = first + threadIdx.x;
            Point p;
            Distance met{1.0f, {0, 0, 1}};
            uint32_t vertex = 0, was = NONE;
            if (near < near_count) {
                vertex = c.near[near];
                const float* rest = c.rest + 3 * vertex;
                const Vec at = from_tool(rest, now[t]) + displacement(c, pass.u_next, vertex);
                const Vec local = rotate(conjugate(now[t].turn), at);
                // Where it came from, as the tool sees it.
                const Vec start = from_tool(rest, before[t]) + displacement(c, moment.tissue_moves ? pass.u : pass.u_next, vertex);
                const Vec local_start = rotate(conjugate(before[t].turn), start);
                p.travel = norm(local - local_start);
                if (p.travel > tool.spacing) {
                    met = meet(c.parts + tool.part, tool.part_count, local_start, local, p.travel / tool.spacing);
                } else if (dot(at, at) < tool.radius * tool.radius) {
                    met = tool_distance(c.parts + tool.part, tool.part_count, local);
                }
                put(p.at, at);
                p.depth = -met.distance;
                put(p.normal, rotate(now[t].turn, met.normal));
            }
            const bool inside = met.distance < 0.0f;
            uint32_t total;
            uint32_t place = count + scan(inside, total);
            if (inside && place >= MAX_POINTS) dropped = 1;
            if (near < near_count) {
                was = c.point_of[t * MAX_NEAR + near];
                c.point_of[t * MAX_NEAR + near] = inside && place < MAX_POINTS ? place : NONE;
            }
            if (inside && place < MAX_POINTS) {
                p.near = near;
                p.tool = t;
                const Vec linear{float(tool.to[0] - tool.from[0]), float(tool.to[1] - tool.from[1]), float(tool.to[2] - tool.from[2])};
                put(p.tool_velocity, (linear + cross(vec(tool.turn), vec(p.at))) * (1.0f / step.duration));
                Vec velocity{0, 0, 0};
                const Vec n = vec(p.normal);
                float free = 0.0f, all = 0.0f, fastest = 0.0f;
                for (int i = 0; i < 8; ++i) {
                    const uint32_t slot = c.row_nodes[8 * vertex + i], node = c.node_of[slot];
                    const float w = c.row_weights[8 * vertex + i];
                    p.nodes[i] = node;
                    p.weights[i] = w;
                    const size_t v = velocity_at(slot);
                    velocity = velocity + Vec{pass.v_next[v], pass.v_next[v + BRICK_NODES], pass.v_next[v + 2 * BRICK_NODES]} * w;
                    const float4 m = c.mobility[node];
                    free += w * w * (m.x * n.x * n.x + m.y * n.y * n.y + m.z * n.z * n.z);
                    all += w * w * m.w;
                    fastest = fmaxf(fastest, fabsf(w) * fmaxf(m.x, fmaxf(m.y, m.z)));
                }
                p.movable = free > MOVABLE * all;
                p.mass = 1.0f / (p.movable ? free : all);
                const float lever = 1.0f / fmaxf(1.0f, fastest * p.mass);
                p.target = fminf(p.depth, (step.push_limit + p.travel) * lever) / step.dt;
                put(p.before, velocity);
                // It stays inside the tool: of several moves in a substep the last alone counts.
                p.push = p.movable || !moment.is_last ? 0.0f : p.mass * p.depth / step.dt;
                put(p.drag, {0, 0, 0});
                // The last substep's impulses are a good guess, if this list is still the same.
                if (p.movable && moment.substep > 1 && was != NONE) {
                    const Point& last = last_points[was];
                    const Vec drag = vec(last.drag);
                    p.push = last.push;
                    put(p.drag, drag - n * dot(drag, n));
                }
                p.last_push = p.push;
                put(p.last_drag, vec(p.drag));
                points[place] = p;
            }
            count = min(count + total, uint32_t(MAX_POINTS));
        }
    }
    if (dropped) atomicAdd(&c.counts[DROPPED], 1);
    if (threadIdx.x == 0) {
        c.counts[POINTS] = count;
        c.counts[TAG] = tag;
    }
    if (count == 0) return;
    __syncthreads();

    // The nodes that carry them, each once.
    for (uint32_t i = threadIdx.x; i < 8 * count; i += THREADS) {
        const uint32_t node = points[i / 8].nodes[i % 8];
        if (atomicExch(&c.node_tag[node], tag) != tag) c.touched[atomicAdd(&touched, 1)] = node;
    }
    for (uint32_t k = threadIdx.x; k < count; k += THREADS) sum_impulse(c, points, tools, points[k].near);
    __syncthreads();
    const uint32_t nodes = touched;
    give_to_nodes(c, nodes, true);
    __syncthreads();
    for (uint32_t k = threadIdx.x; k < count; k += THREADS) {
        Point& p = points[k];
        if (!p.movable) continue;
        float reach = 0.0f;
        for (int i = 0; i < 8; ++i) reach += fabsf(p.weights[i]) * c.change[p.nodes[i]].w;
        p.mass = 1.0f / reach;
    }

    // Impulses that put every point on its tool.
    for (int iteration = 0; iteration < ITERATIONS; ++iteration) {
        const float momentum = iteration == 0 ? 0.0f : float(iteration - 1) / float(iteration + 2);
        // Where momentum carries the impulses.
        for (uint32_t k = threadIdx.x; k < count; k += THREADS) {
            Point& p = points[k];
            const float push = p.push;
            const Vec drag = vec(p.drag);
            p.push = push + (push - p.last_push) * momentum;
            put(p.drag, drag + (drag - vec(p.last_drag)) * momentum);
            p.last_push = push;
            put(p.last_drag, drag);
        }
        __syncthreads();
        for (uint32_t k = threadIdx.x; k < count; k += THREADS) sum_impulse(c, points, tools, points[k].near);
        __syncthreads();
        give_to_nodes(c, nodes, false);
        __syncthreads();
        for (uint32_t k = threadIdx.x; k < count; k += THREADS) {
            Point& p = points[k];
            if (!p.movable) continue;
            const Vec n = vec(p.normal), change = change_at(c, p);
            // Along the normal: the rest of the depth, by pushing alone.
            p.push = fmaxf(p.push + p.mass * (p.target - dot(change, n)), 0.0f);
            // Across it: with the tool, inside Coulomb's cone.
            Vec slip = vec(p.before) + change - vec(p.tool_velocity);
            slip = slip - n * dot(slip, n);
            Vec drag = vec(p.drag) - slip * p.mass;
            drag = drag - n * dot(drag, n);
            const float cone = step.tools[p.tool].friction * p.push, size = norm(drag);
            if (size > cone) drag = drag * (cone / size);
            put(p.drag, drag);
        }
        __syncthreads();
    }
    for (uint32_t k = threadIdx.x; k < count; k += THREADS) sum_impulse(c, points, tools, points[k].near);
    __syncthreads();
    give_to_nodes(c, nodes, false);
    __syncthreads();

    // What the nodes receive.
    for (uint32_t i = threadIdx.x; i < nodes; i += THREADS) {
        const uint32_t node = c.touched[i], slot = c.nodes[node];
        const float4 change = c.change[node];
        const size_t v = velocity_at(slot);
        pass.v_next[v] += change.x;
        pass.v_next[v + BRICK_NODES] += change.y;
        pass.v_next[v + 2 * BRICK_NODES] += change.z;
        float4& u = pass.u_next[slot];
        u.x += change.x * step.dt;
        u.y += change.y * step.dt;
        u.z += change.z * step.dt;
    }

    // What the tools receive: every thread its points, then the threads as a tree.
    __shared__ double parts[7][THREADS];
    for (uint32_t t = 0; t < tools; ++t) {
        double mine[7] = {};
        for (uint32_t k = threadIdx.x; k < count; k += THREADS) {
            const Point& p = points[k];
            if (p.tool != t || p.push <= 0.0f) continue;
            const Vec j = vec(p.normal) * p.push + vec(p.drag), m = cross(vec(p.at), j);
            mine[0] -= j.x, mine[1] -= j.y, mine[2] -= j.z;
            mine[3] -= m.x, mine[4] -= m.y, mine[5] -= m.z;
            mine[6] += dot(j, vec(p.tool_velocity));
        }
        __syncthreads();
        for (int i = 0; i < 7; ++i) parts[i][threadIdx.x] = mine[i];
        for (int half = THREADS / 2; half > 0; half /= 2) {
            __syncthreads();
            if (threadIdx.x < half) {
                for (int i = 0; i < 7; ++i) parts[i][threadIdx.x] += parts[i][threadIdx.x + half];
            }
        }
        if (threadIdx.x == 0) {
            ToolSum& sum = c.sums[t];
            for (int a = 0; a < 3; ++a) {
                sum.impulse[a] += parts[a][0];
                sum.moment[a] += parts[3 + a][0];
            }
            sum.work += parts[6][0];
        }
    }
    // Vertices that are no points any more must give nothing.
    for (uint32_t k = threadIdx.x; k < count; k += THREADS) c.impulse[c.near[points[k].near]] = make_float4(0, 0, 0, 0);
}
