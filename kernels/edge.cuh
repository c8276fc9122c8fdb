// Edges of blades inside the implicit step: what the block of contact does for points of edges in tissue. See src/cpu/efg/edge.rs for what it means.
//
// It answers, point by point, what they add to A times a vector; nodes gather that from the points that they carry.
#pragma once
#include "block.cuh"
#include "efg.cuh"
#include "field.cuh"
#include "grid.cuh"
#include "layout.cuh"
#include "points.cuh"
#include "press.cuh"
#include "tool.cuh"

namespace efg_kernel {

// How much stiffer a point that sticks is than the tissue.
constexpr double EDGE_STIFFNESS = 10.0;
// Change of an impulse, as a share of what the point takes at most, that asks for another solution; and how much more than that a point may have taken that sticks.
constexpr double EDGE_SETTLED = 0.1, EDGE_EXCESS = 0.01;
// Solutions after which only what has taken too much asks for another one.
constexpr int MOST_EDGE_SOLUTIONS = 2;

__device__ __forceinline__ V3<double> vector_at(const double* v) { return {v[0], v[1], v[2]}; }
__device__ __forceinline__ void put_at(double* to, const V3<double>& v) { to[0] = v.x, to[1] = v.y, to[2] = v.z; }

// What a node receives of the points that it carries, by the answers to a vector; nothing where it carries none.
template <class R>
__device__ __forceinline__ V3<R> given_by_edges(const Sticks& edges, uint32_t slot) {
    const uint32_t at = edges.carrier_at[slot];
    V3<double> sum{0, 0, 0};
    if (at == 0) return {R(0), R(0), R(0)};
    const EdgeCarrier carrier = edges.carriers[at - 1];
#pragma unroll 1
    for (uint32_t i = carrier.start; i < carrier.start + carrier.count; ++i) {
        const EdgeLoad load = edges.loads[i];
        sum = plus(sum, vector_at(edges.points[load.point].answer), load.weight);
    }
    return {R(sum.x), R(sum.y), R(sum.z)};
}

template <class R>
struct Edges {
    const Efg& e;
    const Sticks& sticks;
    const EfgStep& step;
    const uint32_t count, lane = threadIdx.x % LANES, group = threadIdx.x / LANES, groups = blockDim.x / LANES;

    __device__ Edges(const Efg& e, const Sticks& sticks) : e(e), sticks(sticks), step(*e.step), count(sticks.all ? *sticks.count : 0) {}

    // Says of the nodes that carry points where they are listed, or that none does. Others read it when blocks have met.
    __device__ void mark(bool is_there) const {
        for (uint32_t i = threadIdx.x; count && i < *sticks.carrier_count; i += blockDim.x) sticks.carrier_at[sticks.carriers[i].slot] = is_there ? i + 1 : 0;
    }

    // A vector at a point, in all of its threads.
    __device__ V3<double> at(const void* field, const Stuck& stuck) const {
        const V3<R> v = vector_of<R>(field, stuck.nodes[lane]);
        const double w = stuck.weights[lane];
        return {group_sum(double(v.x) * w), group_sum(double(v.y) * w), group_sum(double(v.z) * w)};
    }

    __device__ static V3<double> slip(const EdgePoint& p, const V3<double>& moving) { return across(plus(vector_at(p.velocity), moving, -1.0), vector_at(p.along)); }

    // What comes of an impulse that would make a point stick: whether it does, else the impulse that it gets.
    __device__ static bool sticks_by(const EdgePoint& p, V3<double>& impulse) {
        const double size = norm(impulse);
        if (size <= p.most) return true;
        impulse = plus(V3<double>{0, 0, 0}, impulse, p.most / size);
        return false;
    }

    // Takes the points, velocities at the start of the step being in x, and adds what sticks to the blocks on A's diagonal.
    __device__ void begin() const {
#pragma unroll 1
        for (uint32_t first = 0; first < count; first += groups) {
            const uint32_t i = min(first + group, count - 1);
            const Stuck& stuck = sticks.all[i];
            const uint32_t slot = stuck.nodes[lane];
            const Block<R> inverse = block_of<R>(e.inverse, slot);
            const V3<R> free = free_part(V3<R>{inverse.xx, inverse.yy, inverse.zz}, e.flags[slot]);
            const double gives = group_sum(stuck.weights[lane] * stuck.weights[lane] * double(free.x + (free.y + free.z)) * (1.0 / 3.0));
            const V3<double> moving = at(e.x, stuck);
            if (lane > 0 || first + group >= count) continue;
            EdgePoint& p = sticks.points[i];
            const ToolStep& tool = step.step.tools[stuck.tool];
            const Vec arm = rotate(view_of(tool, step.to).turn, vec(stuck.at)), along = rotate(view_of(tool, step.to).turn, vec(stuck.along));
            const Vec velocity = velocity_of(tool, arm, step.step.duration);
            put_at(p.along, {along.x, along.y, along.z});
            put_at(p.velocity, {velocity.x, velocity.y, velocity.z});
            // What cannot move does not stick.
            p.stiffness = gives > 0.0 ? EDGE_STIFFNESS / gives : 0.0;
            p.most = stuck.limit * step.dt;
            // Tissue that went along goes on to stick; what it would take is guessed without the spring's stiffness.
            V3<double> impulse = plus(V3<double>{0, 0, 0}, slip(p, moving), p.stiffness / EDGE_STIFFNESS);
            p.sticks = sticks_by(p, impulse);
            put_at(p.impulse, impulse);
        }
        __syncthreads();
#pragma unroll 1
        for (uint32_t i = threadIdx.x; count && i < *sticks.carrier_count; i += blockDim.x) {
            const EdgeCarrier carrier = sticks.carriers[i];
            Block<double> sum{};
            for (uint32_t k = carrier.start; k < carrier.start + carrier.count; ++k) {
                const EdgeLoad load = sticks.loads[k];
                const EdgePoint& p = sticks.points[load.point];
                if (!p.sticks) continue;
                const V3<double> a = vector_at(p.along);
                const double s = p.stiffness * load.weight * load.weight;
                sum.xx += s * (1.0 - a.x * a.x), sum.xy -= s * a.x * a.y, sum.xz -= s * a.x * a.z;
                sum.yy += s * (1.0 - a.y * a.y), sum.yz -= s * a.y * a.z, sum.zz += s * (1.0 - a.z * a.z);
            }
            stiffen<R>(e, carrier.slot, sum);
        }
        __syncthreads();
    }

    // What points add to A times a field, less what they add to b where that is wanted. Gives the thread's part of its product with the field.
    __device__ double touch(const void* of, bool less_wanted) const {
        double work = 0.0;
#pragma unroll 1
        for (uint32_t first = 0; first < count; first += groups) {
            const uint32_t i = min(first + group, count - 1);
            const V3<double> moving = at(of, sticks.all[i]);
            if (lane > 0 || first + group >= count) continue;
            EdgePoint& p = sticks.points[i];
            V3<double> answer{0, 0, 0};
            if (p.sticks) {
                answer = less_wanted ? plus(V3<double>{0, 0, 0}, slip(p, moving), -p.stiffness)
                                     : plus(V3<double>{0, 0, 0}, across(moving, vector_at(p.along)), p.stiffness);
            } else if (less_wanted) {
                answer = plus(answer, vector_at(p.impulse), -1.0);
            }
            work += dot(moving, answer);
            put_at(p.moving, moving);
            put_at(p.answer, answer);
        }
        return work;
    }

    // Reads impulses from how points move in the step's `solution`th solution, and the answers that it asks for: of the thread's points the largest impulse, and by how much one is wrong, as far as that asks for another one.
    __device__ void judge(int solution, double (&most)[2]) const {
        for (uint32_t i = threadIdx.x; i < count; i += blockDim.x) {
            EdgePoint& p = sticks.points[i];
            const V3<double> slipped = slip(p, vector_at(p.moving)), before = vector_at(p.impulse);
            V3<double> next{0, 0, 0}, now = before;
            double change = 0.0;
            bool asks = solution < MOST_EDGE_SOLUTIONS;
            if (p.sticks) {
                now = plus(next, slipped, p.stiffness), next = now;
                p.next_sticks = sticks_by(p, next);
                if (!p.next_sticks) change = norm(plus(next, now, -1.0)), asks = change > EDGE_EXCESS * p.most;
            } else if (!asks) {
                // What has slipped goes on to, so that this comes to an end.
                p.next_sticks = 0, next = before;
            } else if (dot(slipped, before) < 0.0) {
                // It has gone ahead of the edge: that would have taken less.
                p.next_sticks = 1;
                change = p.most;
            } else {
                next = plus(before, slipped, p.stiffness / EDGE_STIFFNESS);
                p.next_sticks = sticks_by(p, next);
                change = p.next_sticks ? p.most : norm(plus(next, before, -1.0));
                asks = change > EDGE_SETTLED * p.most;
            }
            put_at(p.impulse, now);
            put_at(p.next, next);
            most[0] = fmax(most[0], norm(now));
            if (asks) most[1] = fmax(most[1], change);
        }
    }

    // Takes the answers that the last solution asks for.
    __device__ void mend() const {
        for (uint32_t i = threadIdx.x; i < count; i += blockDim.x) {
            EdgePoint& p = sticks.points[i];
            p.sticks = p.next_sticks;
            if (!p.sticks) put_at(p.impulse, vector_at(p.next));
        }
        __syncthreads();
    }

    // What the tissue received at each point, for what follows the step.
    __device__ void tell() const {
        for (uint32_t i = threadIdx.x; i < count; i += blockDim.x) put_at(sticks.pulls[i].impulse, vector_at(sticks.points[i].impulse));
    }
};

}  // namespace efg_kernel
