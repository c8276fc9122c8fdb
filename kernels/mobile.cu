// Impulses after nodes have moved: sides of cuts are kept apart, and tissue sticks to the edges of blades. See src/cpu/facing.rs and hold.rs for what they are. One block, in double precision.
//
// Pairs follow each other as on the processor. They are in classes of cells that share no node: those of a class are side by side, eight threads for each cell, one for each
// corner.
#include "clock.cuh"
#include "field.cuh"
#include "grid.cuh"
#include "outside.cuh"
#include "points.cuh"

namespace mobile_kernel {

constexpr int THREADS = 512, GROUPS = THREADS / 8, CLASSES = 8;
// Length of the sum of both sides' normals below which they do not face each other.
constexpr double LEAST_AGREEMENT = 1.4142135623730951;

__device__ __forceinline__ Triple operator+(const Triple& a, const Triple& b) { return {a.x + b.x, a.y + b.y, a.z + b.z}; }
__device__ __forceinline__ Triple operator-(const Triple& a, const Triple& b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
__device__ __forceinline__ Triple operator*(const Triple& a, double s) { return {a.x * s, a.y * s, a.z * s}; }
__device__ __forceinline__ double dot(const Triple& a, const Triple& b) { return a.x * b.x + (a.y * b.y + a.z * b.z); }
__device__ __forceinline__ Triple cross(const Triple& a, const Triple& b) {
    return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}
__device__ __forceinline__ Triple triple(const double* v) { return {v[0], v[1], v[2]}; }
__device__ __forceinline__ Triple triple(const Vec& v) { return {v.x, v.y, v.z}; }
__device__ __forceinline__ Triple each(const Triple& a, const Triple& b) { return {a.x * b.x, a.y * b.y, a.z * b.z}; }

// The eight threads that this one is among.
__device__ __forceinline__ uint32_t group_mask() { return 0xffu << (threadIdx.x & 24); }
__device__ __forceinline__ double sum_of_eight(double x) {
    for (int across = 1; across < 8; across *= 2) x += __shfl_xor_sync(group_mask(), x, across);
    return x;
}
__device__ __forceinline__ Triple sum_of_eight(const Triple& v) { return {sum_of_eight(v.x), sum_of_eight(v.y), sum_of_eight(v.z)}; }

// Nodes of the lattice at the end of a substep.
struct LatticeNodes {
    const Pass& pass;
    __device__ Triple u(uint32_t slot) const {
        const float4 u = pass.u_next[slot];
        return {u.x, u.y, u.z};
    }
    __device__ Triple v(uint32_t slot) const {
        const float* const v = pass.v_next + velocity_at(slot);
        return {v[0], v[BRICK_NODES], v[2 * BRICK_NODES]};
    }
    __device__ uint32_t flags(uint32_t slot) const { return pass.flags[slot]; }
    __device__ void set_v(uint32_t slot, const Triple& v) const {
        float* const at = pass.v_next + velocity_at(slot);
        at[0] = float(v.x), at[BRICK_NODES] = float(v.y), at[2 * BRICK_NODES] = float(v.z);
    }
    __device__ void move(uint32_t slot, const Triple& u) const {
        pass.u_next[slot] = make_float4(float(u.x), float(u.y), float(u.z), pass.u_next[slot].w);
        pass.acted_on[slot / BRICK_NODES] = 1;
    }
};

// Those of the meshless model at the end of a step.
template <class R>
struct EfgNodes {
    const Efg& e;
    __device__ Triple u(uint32_t slot) const { return read(e.u, slot); }
    __device__ Triple v(uint32_t slot) const { return read(e.v, slot); }
    __device__ uint32_t flags(uint32_t slot) const { return e.flags[slot]; }
    __device__ void set_v(uint32_t slot, const Triple& v) const {
        efg_kernel::set_vector(e.v, slot, efg_kernel::V3<R>{R(v.x), R(v.y), R(v.z)});
    }
    __device__ void move(uint32_t slot, const Triple& u) const {
        efg_kernel::set_vector(e.u, slot, efg_kernel::V3<R>{R(u.x), R(u.y), R(u.z)});
        e.shown[slot] = make_float4(float(u.x), float(u.y), float(u.z), e.shown[slot].w);
    }
    __device__ static Triple read(const void* field, uint32_t slot) {
        const efg_kernel::V3<R> v = efg_kernel::vector_of<R>(field, slot);
        return {v.x, v.y, v.z};
    }
};

// 1 / mass along each axis that is free, else 0.
template <class Nodes>
__device__ __forceinline__ Triple mobility(const Nodes& nodes, uint32_t slot, double inverse_kg) {
    const uint32_t flags = nodes.flags(slot);
    const auto along = [&](uint32_t axis) { return flags & (axis | GRASPED) ? 0.0 : inverse_kg; };
    return {along(FIX_X), along(FIX_Y), along(FIX_Z)};
}

// The wall's normal as one of its sides has turned it; `u` is a corner's.
__device__ __forceinline__ Triple turned(const Triple& normal, const Triple& u, uint32_t corner, double h) {
    const double scale = 0.25 / h;
    const auto along = [&](uint32_t bit) { return sum_of_eight(u * (corner & bit ? scale : -scale)); };
    const Triple x = along(1), y = along(2), z = along(4);
    const auto deformed = [&](const Triple& v) { return v + x * v.x + y * v.y + z * v.z; };
    const Triple axis = fabs(normal.x) < 0.7 ? Triple{1, 0, 0} : Triple{0, 1, 0}, across = cross(normal, axis);
    const Triple found = cross(deformed(across), deformed(cross(normal, across)));
    const double length = sqrt(dot(found, found));
    return length > 0.0 ? found * (1.0 / length) : normal;
}

// Stops one pair that goes on through itself. Gives how far a node goes by that.
template <class Nodes>
__device__ double keep_apart(const Nodes& nodes, const Facing& facing, double h, double dt) {
    const uint32_t corner = threadIdx.x % 8;
    const double weight = facing.weights[corner];
    const uint32_t slots[2] = {facing.nodes[0][corner], facing.nodes[1][corner]};
    const Triple u[2] = {nodes.u(slots[0]), nodes.u(slots[1])}, rest = triple(facing.normal);
    const Triple apart = sum_of_eight((u[0] - u[1]) * weight), both = turned(rest, u[0], corner, h) + turned(rest, u[1], corner, h);
    const double agree = sqrt(dot(both, both));
    if (agree <= LEAST_AGREEMENT) return 0.0;
    const Triple normal = both * (1.0 / agree);
    const double gap = dot(apart, normal);
    const Triple aside = apart - normal * gap;
    if (gap >= 0.0 || sqrt(dot(aside, aside)) > h) return 0.0;
    // All nodes of a side alike, by their masses and momenta along axes that are free, whatever single nodes weigh.
    Triple free[2], goes[2];
    double yields[2];
    for (int side = 0; side < 2; ++side) {
        free[side] = mobility(nodes, slots[side], 1.0);
        const bool is_free = free[side].x + free[side].y + free[side].z > 0.0;
        const double kg = 1.0 / facing.inverse_kg[side][corner], mass = sum_of_eight(is_free ? kg : 0.0);
        const Triple v = nodes.v(slots[side]), momentum = sum_of_eight(each(v, free[side]) * kg), between = sum_of_eight(v * weight);
        yields[side] = mass > 0.0 ? 1.0 / mass : 0.0;
        goes[side] = mass > 0.0 ? momentum * (1.0 / mass) : between;
    }
    const double closing = dot(goes[0] - goes[1], normal), total = yields[0] + yields[1];
    if (closing >= 0.0 || !(total > 0.0)) return 0.0;
    const double blow = -closing / total;
    double most = 0.0;
    // One after the other: at the front of a cut both may be the same node.
    for (int side = 0; side < 2; ++side) {
        const Triple change = each(free[side], normal) * ((side == 0 ? blow : -blow) * yields[side]);
        nodes.set_v(slots[side], nodes.v(slots[side]) + change);
        nodes.move(slots[side], nodes.u(slots[side]) + change * dt);
        most = fmax(most, sqrt(dot(change, change)) * dt);
    }
    __syncwarp(group_mask());
    return most;
}

// All pairs. Gives how far a node of this thread's went at most.
template <class Nodes>
__device__ double keep_apart(const Nodes& nodes, const Sides& sides, double h, double dt) {
    double most = 0.0;
    for (int of = 0; of < CLASSES && sides.all; ++of) {
#pragma unroll 1
        for (uint32_t cell = sides.classes[of] + threadIdx.x / 8; cell < sides.classes[of + 1]; cell += GROUPS) {
#pragma unroll 1
            for (uint32_t i = sides.cells[cell]; i < sides.cells[cell + 1]; ++i) most = fmax(most, keep_apart(nodes, sides.all[i], h, dt));
        }
        __syncthreads();
    }
    return most;
}

__device__ __forceinline__ void put(double to[3], const Triple& v) { to[0] = v.x, to[1] = v.y, to[2] = v.z; }
__device__ __forceinline__ double squared(const Triple& v) { return dot(v, v); }

// What happens to points of edges begins: each by eight threads. `has_begun` says whether they have received something before.
template <class Nodes>
__device__ void begin_pulls(const Nodes& nodes, const Sticks& sticks, uint32_t count, const Step& step, float to, bool has_begun) {
    const uint32_t corner = threadIdx.x % 8;
#pragma unroll 1
    for (uint32_t i = threadIdx.x / 8; i < count; i += GROUPS) {
        const Stuck& stuck = sticks.all[i];
        Pull& pull = sticks.pulls[i];
        const uint32_t slot = stuck.nodes[corner];
        const double weight = stuck.weights[corner];
        const Triple by = mobility(nodes, slot, stuck.inverse_kg[corner]);
        put(pull.by[corner], by * weight);
        put(pull.u[corner], nodes.u(slot));
        put(pull.v[corner], nodes.v(slot));
        // By the most mobile axis of each node: no impulse overshoots.
        const double gives = sum_of_eight(fmax(by.x, fmax(by.y, by.z)) * weight * weight);
        if (corner > 0) continue;
        const ToolStep& tool = step.tools[stuck.tool];
        const View view = view_of(tool, to);
        const Vec arm = rotate(view.turn, vec(stuck.at));
        put(pull.arm, triple(arm));
        put(pull.along, triple(rotate(view.turn, vec(stuck.along))));
        put(pull.goes, triple(velocity_of(tool, arm, step.duration)));
        pull.gives = gives;
        if (!has_begun) put(pull.impulse, Triple{});
    }
}

// A point as a thread of its eight sees it.
struct Pulled {
    uint32_t slot;
    double weight, gives, limit2;
    Triple by, along, goes, impulse;
    __device__ static Pulled of(const Sticks& sticks, uint32_t i, double dt) {
        const Stuck& stuck = sticks.all[i];
        const Pull& pull = sticks.pulls[i];
        const uint32_t corner = threadIdx.x;
        const double limit = stuck.limit * dt;
        return {stuck.nodes[corner], stuck.weights[corner], pull.gives, limit * limit,
                triple(pull.by[corner]), triple(pull.along), triple(pull.goes), triple(pull.impulse)};
    }
};

// Velocities by impulses on points of edges, by the first eight threads: projected Gauss-Seidel, as on the processor.
template <class Nodes>
__device__ void solve_pulls(const Nodes& nodes, const Sticks& sticks, uint32_t count, double dt) {
    constexpr int SWEEPS = 32;
    constexpr double CONVERGED = 1e-3;
    for (int sweep = 0; sweep < SWEEPS; ++sweep) {
        double largest2 = 0.0, change2 = 0.0;
        Pulled next = Pulled::of(sticks, 0, dt);
#pragma unroll 1
        for (uint32_t i = 0; i < count; ++i) {
            const Pulled pull = next;
            // What the next one is does not depend on this one, but for its nodes' velocities.
            if (i + 1 < count) next = Pulled::of(sticks, i + 1, dt);
            if (!(pull.gives > 0.0)) continue;
            const Triple v = nodes.v(pull.slot);
            Triple slip = pull.goes - sum_of_eight(v * pull.weight);
            slip = slip - pull.along * dot(slip, pull.along);
            Triple wanted = pull.impulse + slip * (1.0 / pull.gives);
            const double size2 = squared(wanted);
            if (size2 > pull.limit2) wanted = wanted * sqrt(pull.limit2 / size2);
            const Triple impulse = wanted - pull.impulse;
            nodes.set_v(pull.slot, v + each(pull.by, impulse));
            largest2 = fmax(largest2, squared(wanted));
            change2 = fmax(change2, squared(impulse));
            if (threadIdx.x == 0) put(sticks.pulls[i].impulse, wanted);
            // What one has changed the next one sees.
            __syncwarp(0xff);
        }
        if (change2 <= CONVERGED * CONVERGED * largest2) break;
    }
}

// Tissue sticks to points of edges: all threads. give(tool, impulse on it, its moment and the work on the tissue) is the first one's. Gives how far a node of this thread's went at most.
template <class Nodes, class Give>
__device__ double stick(const Nodes& nodes, const Sticks& sticks, const Step& step, float to, double dt, bool has_begun, Give give) {
    const uint32_t count = sticks.all ? *sticks.count : 0;
    if (count == 0) return 0.0;
    begin_pulls(nodes, sticks, count, step, to, has_begun);
    __syncthreads();
    if (threadIdx.x < 8) solve_pulls(nodes, sticks, count, dt);
    __syncthreads();
    const uint32_t corner = threadIdx.x % 8;
    double most2 = 0.0;
    // Points that share a node say the same of it.
#pragma unroll 1
    for (uint32_t i = threadIdx.x / 8; i < count; i += GROUPS) {
        const uint32_t slot = sticks.all[i].nodes[corner];
        const Pull& pull = sticks.pulls[i];
        const Triple change = nodes.v(slot) - triple(pull.v[corner]);
        nodes.move(slot, triple(pull.u[corner]) + change * dt);
        most2 = fmax(most2, squared(change));
    }
    if (threadIdx.x == 0) {
#pragma unroll 1
        for (uint32_t i = 0; i < count; ++i) {
            const Pull& pull = sticks.pulls[i];
            const Triple impulse = triple(pull.impulse);
            give(sticks.all[i].tool, impulse * -1.0, cross(triple(pull.arm), impulse) * -1.0, dot(impulse, triple(pull.goes)));
        }
    }
    return sqrt(most2) * dt;
}

__device__ void add(ToolSum& sum, const Triple& impulse, const Triple& moment, double work) {
    sum.impulse[0] += impulse.x, sum.impulse[1] += impulse.y, sum.impulse[2] += impulse.z;
    sum.moment[0] += moment.x, sum.moment[1] += moment.y, sum.moment[2] += moment.z;
    sum.work += work;
}

// At the end of an implicit step, which has told all but its number.
template <class R>
__device__ void end_step(const Efg& e, const Sides& sides, const Sticks& sticks) {
    __shared__ double scratch[33];
    const EfgStep& step = *e.step;
    Report& report = *e.report;
    if (report.diverged_at == ~0u) {
        const EfgNodes<R> nodes{e};
        double most[1] = {keep_apart(nodes, sides, e.cell, step.dt)};
        __syncthreads();
        most[0] += stick(nodes, sticks, step.step, step.to, step.dt, true, [&](uint32_t tool, const Triple& impulse, const Triple& moment, double work) {
            add(report.sums[tool], impulse, moment, work);
        });
        const double way = block_all<Largest>(most, scratch);
        // So much faster a node may be, as far as anyone has to know.
        const float speed = sqrtf(report.speed2) + float(way / step.dt);
        if (threadIdx.x == 0) report.speed2 = speed * speed;
    }
    __threadfence_system();
    __syncthreads();
    if (threadIdx.x > 0) return;
    report.device_ns = clock_ns() - *e.started;
    __threadfence_system();
    *(volatile uint32_t*)&report.sequence = step.step.sequence;
}

}  // namespace mobile_kernel
using namespace mobile_kernel;

// At the end of a substep of the lattice, before contact. Where nothing did so before, it begins the tools' sums.
extern "C" __global__ void __launch_bounds__(THREADS) mobile(const __grid_constant__ Pass pass, const __grid_constant__ Sides sides, const __grid_constant__ Sticks sticks) {
    const Step& step = *pass.step;
    if (sticks.begins && pass.substep == 1 && threadIdx.x < step.tool_count) sticks.sums[threadIdx.x] = ToolSum{};
    if (*pass.diverged_at <= pass.substep) return;
    __syncthreads();
    const LatticeNodes nodes{pass};
    const float to = float(pass.substep) / float(sticks.substeps);
    stick(nodes, sticks, step, to, step.dt, false, [&](uint32_t tool, const Triple& impulse, const Triple& moment, double work) { add(sticks.sums[tool], impulse, moment, work); });
    __syncthreads();
    keep_apart(nodes, sides, pass.cell, step.dt);
}

extern "C" __global__ void __launch_bounds__(THREADS) mobile_single(const __grid_constant__ Efg e, const __grid_constant__ Sides sides, const __grid_constant__ Sticks sticks) {
    end_step<float>(e, sides, sticks);
}
extern "C" __global__ void __launch_bounds__(THREADS) mobile_double(const __grid_constant__ Efg e, const __grid_constant__ Sides sides, const __grid_constant__ Sticks sticks) {
    end_step<double>(e, sides, sticks);
}
