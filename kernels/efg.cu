// One implicit step of the meshless model, as one kernel whose blocks are all at work at the same time; see src/cpu/efg/system.rs and conjugate.rs for what
// it means, and worker.cuh for how bricks are divided. The last block cares for contact, and tells the host.
//
// Conjugate gradients in the form of Chronopoulos and Gear: A times the preconditioned residual gives all that an iteration needs to know at once, so that
// blocks meet twice in each, and sum up but once. No number leaves the device before the end of the step.
#include "clock.cuh"
#include "touched.cuh"
#include "worker.cuh"

namespace efg_kernel {

// The recursive residual is brought this much further down than the true one has to be.
constexpr double AHEAD = 0.7;
// A new start that leaves more than this share of the residual has met what rounding leaves.
constexpr double STALLED = 0.9;
// Most solutions of a step, each with contact as the one before answered.
constexpr int MAX_SOLUTIONS = 8;

// What an iteration sums up.
struct Sums {
    // r·r, r·z and z·A z.
    double numbers[3];
};

// How far a step came, the same in all threads.
struct Reached {
    uint32_t iterations;
    double residual, reference;
};

// Everything between the start of a step and its report.
template <class R>
struct Run {
    Worker<R>& w;
    Press<R>& press;
    const Edges<R>& edges;
    const Contact& c;
    // Whether points of a surface are near tools, and whether there are those or edges in tissue.
    bool has_contact = false, touches = false;
    double noise = 0.0;

    // What contact and edges add to A times a field. Gives the thread's part of its product with the field.
    __device__ double touch(const void* of, bool less_wanted) const {
        if (w.is_worker) return 0.0;
        const double of_edges = edges.touch(of, less_wanted);
        return has_contact ? of_edges + press.touch(of, less_wanted) : of_edges;
    }

    // The residual of x, and that preconditioned; r·r and r·z of this thread's nodes. A x is known, or is found.
    __device__ void renew(bool is_known, Sums& sums) const {
        const Efg& e = w.e;
        if (!is_known) {
            w.for_each_brick([&](uint32_t brick) {
                V3<R> own;
                w.put(e.ax, brick, w.product_of(e.x, brick, own));
            });
            // What rows give is still that of x where A x is known.
            w.give_of_rows(e.x, R(-1), false);
        }
        touch(e.x, true);
        meet(w.grid);
        w.for_each_brick([&](uint32_t brick) {
            const V3<R> more = w.added(c, has_contact, brick), b = w.get(e.b, brick), ax = w.get(e.ax, brick);
            const V3<R> r = w.free({b.x - ax.x - more.x, b.y - ax.y - more.y, b.z - ax.z - more.z}, brick), z = w.precondition(r, brick);
            w.put(e.r, brick, r);
            w.put(e.z, brick, z);
            sums.numbers[0] += double(dot(r, r));
            sums.numbers[1] += double(dot(r, z));
        });
    }

    // A z, and z·A z.
    __device__ void multiply(Sums& sums) const {
        w.for_each_brick([&](uint32_t brick) {
            V3<R> z;
            const V3<R> az = w.product_of(w.e.z, brick, z);
            w.put(w.e.w, brick, az);
            sums.numbers[2] += double(dot(z, az));
        });
        sums.numbers[2] += w.give_of_rows(w.e.z, R(-1), false);
        sums.numbers[2] += touch(w.e.z, false);
    }

    // p = z + β p and x += α p, and so r by A p; z, r·r and r·z from that.
    __device__ void relax(double along, double before, Sums& sums) const {
        const Efg& e = w.e;
        const R alpha = R(along), beta = R(before);
        w.for_each_brick([&](uint32_t brick) {
            const V3<R> more = w.added(c, has_contact, brick), az = w.get(e.w, brick);
            V3<R> p = w.get(e.z, brick), s{az.x + more.x, az.y + more.y, az.z + more.z};
            if (before != 0.0) {
                p = plus(p, w.get(e.p, brick), beta);
                s = plus(s, w.get(e.s, brick), beta);
            }
            w.put(e.p, brick, p);
            w.put(e.s, brick, s);
            w.put(e.x, brick, plus(w.get(e.x, brick), p, alpha));
            const V3<R> r = w.free(plus(w.get(e.r, brick), s, -alpha), brick), z = w.precondition(r, brick);
            w.put(e.r, brick, r);
            w.put(e.z, brick, z);
            sums.numbers[0] += double(dot(r, r));
            sums.numbers[1] += double(dot(r, z));
        });
    }

    // Improves x by conjugate gradients until the recursive residual is small enough. `sums` are those of a renewed residual.
    __device__ void descend(double enough, uint32_t most, Sums sums, Reached& reached) const {
        double alpha = 0.0, rz = 0.0;
        while (reached.iterations < most) {
            sums.numbers[2] = 0.0;
            multiply(sums);
            Sums all = sums;
            meet_with<Sum>(w.grid, all.numbers);
            if (!(sqrt(all.numbers[0]) > enough)) return;
            const double beta = alpha == 0.0 ? 0.0 : all.numbers[1] / rz;
            const double curvature = alpha == 0.0 ? all.numbers[2] : all.numbers[2] - beta * all.numbers[1] / alpha;
            // Not a number, or no descent: what was found so far stands.
            if (!(curvature > 0.0)) return;
            rz = all.numbers[1];
            alpha = rz / curvature;
            sums = {};
            relax(alpha, beta, sums);
            meet(w.grid);
            ++reached.iterations;
        }
    }

    // One solution with contact as it answers now.
    __device__ void solve(bool is_first, Reached& reached) const {
        double left = 0.0;
        for (bool starts = true;; starts = false) {
            Sums sums{};
            renew(starts && !is_first, sums);
            double seen[3] = {sums.numbers[0], sums.numbers[1], is_first && starts ? noise : 0.0};
            meet_with<Sum>(w.grid, seen);
            const double before = left;
            left = sqrt(seen[0]);
            if (is_first && starts) {
                reached.reference = left;
                noise_of_all = sqrt(seen[2]);
            }
            reached.residual = left;
            const double target = fmax(w.step.tolerance * reached.reference, noise_of_all);
            // A new start that found little has met what rounding leaves, or what is not finite.
            const bool stalls = !starts && !(left < STALLED * before);
            if (!(left > target) || stalls || reached.iterations >= w.step.max_iterations) return;
            descend(AHEAD * target, w.step.max_iterations, sums, reached);
        }
    }
    mutable double noise_of_all = 0.0;

    // Solutions until contact answers as it was asked.
    __device__ void solve_with_contact(Reached& reached) const {
        for (int solution = 1;; ++solution) {
            solve(solution == 1, reached);
            if (!touches) return;
            if (!w.is_worker) {
                double most[2] = {0.0, 0.0};
                edges.judge(solution, most);
                const bool is_settled = press.judge(most, w.s.scratch);
                if (threadIdx.x == 0) *w.e.is_settled = is_settled;
                if (!is_settled && !is_last(solution, reached)) press.mend(), edges.mend();
            }
            meet(w.grid);
            if (*(volatile uint32_t*)w.e.is_settled || is_last(solution, reached)) return;
        }
    }
    __device__ bool is_last(int solution, const Reached& reached) const {
        return solution == MAX_SOLUTIONS || reached.iterations >= w.step.max_iterations;
    }
};

// What it takes to carry what tools hold: A x − b there, what was missing to move so. One block.
template <class R>
__device__ void carry(const Worker<R>& w, const Contact& c, bool has_contact) {
    const Efg& e = w.e;
    const EfgStep& step = w.step;
    for (uint32_t t = 0; t < step.step.tool_count; ++t) {
        const View view = view_of(step.step.tools[t], step.to);
        double force[3] = {}, rest[4] = {};
        for (uint32_t i = w.holds.starts[t] + threadIdx.x; i < w.holds.starts[t + 1]; i += blockDim.x) {
            const Held node = w.holds.nodes[i];
            V3<R> j = plus(vector_of<R>(e.ax, node.slot), vector_of<R>(e.b, node.slot), R(-1));
            j = plus(j, w.touched(c, has_contact, node.slot), R(1));
            if (e.row_count) j = plus(j, given_by_rows<R>(e, node.slot), R(1));
            const Vec arm = rotate(view.turn, vec(node.place)), impulse{float(j.x), float(j.y), float(j.z)}, moment = cross(arm, impulse);
            force[0] -= j.x, force[1] -= j.y, force[2] -= j.z;
            rest[0] -= moment.x, rest[1] -= moment.y, rest[2] -= moment.z;
            rest[3] += dot(j, vector_of<R>(e.x, node.slot));
        }
        const uint32_t warp = threadIdx.x / 32;
        double* const sums = reinterpret_cast<double*>(&w.holds.sums[t]);
        const double of_force = block_all<Sum>(force, w.s.scratch);
        if (warp < 3) sums[warp] = of_force;
        __syncthreads();
        const double of_rest = block_all<Sum>(rest, w.s.scratch);
        if (warp < 4) sums[3 + warp] = of_rest;
        __syncthreads();
    }
}

// What the host is told.
template <class R>
__device__ void tell(const Worker<R>& w, const Press<R>& press, const Contact& c, const Reached& reached, bool has_contact, double noise, double speed2, bool is_sound) {
    Report& report = *w.e.report;
    if (w.holds.count > 0) carry(w, c, has_contact);
    press.tell(report.sums, w.holds.count > 0 ? w.holds.sums : nullptr);
    const uint32_t touching = w.step.step.tool_count ? c.counts[POINTS] : 0;
    tell_points(c.points, touching, c.touched);
    // The strains that blocks saw, by one warp.
    float seen[3] = {};
    if (threadIdx.x < 32) {
        for (uint32_t block = threadIdx.x; block < w.workers; block += 32) {
            const float4 of_block = w.e.seen[block];
            seen[0] = fmaxf(seen[0], of_block.x), seen[1] = fmaxf(seen[1], of_block.y), seen[2] = fmaxf(seen[2], of_block.z);
        }
        for (float& most : seen) most = float(warp_all<Largest>(most));
    }
    if (threadIdx.x == 0) *w.e.meetings = w.grid.meeting;
    // All sums and points are in the host's memory before the number is.
    __threadfence_system();
    __syncthreads();
    if (threadIdx.x > 0) return;
    report.diverged_at = is_sound ? ~0u : 1;
    report.speed2 = float(speed2);
    report.strain = seen[0], report.swelling = seen[1], report.shrinking = seen[2];
    for (uint32_t& awake : report.awake) awake = 0;
    report.vis_viva = 0.0;
    report.contact_points = c.counts[PUSHED];
    report.dropped_points = c.counts[DROPPED];
    report.points = touching;
    report.iterations = reached.iterations;
    // Less than what rounding makes is as good as can be.
    const double left = reached.residual / fmax(reached.reference, 1e-300);
    report.residual = float(reached.residual <= noise ? fmin(left, w.step.tolerance) : left);
    report.device_ns = clock_ns() - *w.e.started;
    __threadfence_system();
    if (!w.e.is_followed) *(volatile uint32_t*)&report.sequence = w.step.step.sequence;
}

template <class R, int FEWEST_TEAMS>
__device__ __forceinline__ void take_step(const Efg& e, const Contact& c, const Push& loads, const Drive& regions, const Hold& holds, const Sticks& sticks, unsigned char* memory) {
    static_assert(sizeof(Shared<R>) == EFG_BLOCK_BYTES<R> && sizeof(Team<R>) == EFG_TEAM_BYTES<R>);
    static_assert(sizeof(PressShared) <= FEWEST_TEAMS * sizeof(Team<R>));
    Shared<R>& s = *reinterpret_cast<Shared<R>*>(memory);
    unsigned char* const others = memory + sizeof(Shared<R>);
    Worker<R> w(e, loads, regions, holds, sticks, s, reinterpret_cast<Team<R>*>(others));
    const EfgStep& step = w.step;
    if (threadIdx.x < 16) {
        const EfgLaw law = e.laws[threadIdx.x];
        s.forces[threadIdx.x] = {R(law.forces.mu), R(law.forces.lambda), R(law.forces.hourglass)};
        s.changes[threadIdx.x] = {R(law.changes.mu), R(law.changes.lambda), R(law.changes.hourglass)};
    }
    // Where sites were listed, that began the step.
    if (!w.is_worker && threadIdx.x == 0 && e.starts) *e.started = clock_ns();
    __syncthreads();

    Press<R> press(e, c, *reinterpret_cast<PressShared*>(others));
    const Edges<R> edges(e, sticks);
    Run<R> run{w, press, edges, c};
    float seen[3] = {};
    w.for_each_brick([&](uint32_t brick) { w.look(brick, seen); });
    w.look_at_rows(seen);
    double strains[3] = {seen[0], seen[1], seen[2]};
    if (w.is_worker) {
        const double most = block_all<Largest>(strains, s.scratch);
        if (threadIdx.x % 32 == 0 && threadIdx.x / 32 < 3) reinterpret_cast<float*>(&e.seen[blockIdx.x])[threadIdx.x / 32] = float(most);
    } else {
        press.find();
        edges.mark(true);
    }
    meet(w.grid);

    run.has_contact = c.counts[POINTS] > 0;
    run.touches = run.has_contact || edges.count > 0;
    if (run.has_contact && !w.is_worker) press.list();
    w.for_each_brick([&](uint32_t brick) { run.noise += w.build(brick); });
    const double unit = double(rounding(R(0))) / step.dt;
    run.noise *= unit * unit;
    meet(w.grid);
    if (step.only_forces) {
        if (!w.is_worker) tell(w, press, c, Reached{}, false, 0.0, 0.0, true);
        return;
    }
    w.push();
    w.take_along();
    if (run.has_contact && !w.is_worker) press.begin();
    if (!w.is_worker) edges.begin();
    if (w.takes_any()) meet(w.grid);

    Reached reached{};
    run.solve_with_contact(reached);

    // Whether a node is lost: further than it can be, or nowhere.
    double most[1] = {0.0};
    w.for_each_brick([&](uint32_t brick) {
        const V3<R> x = w.get(e.x, brick);
        const double speed2 = double(dot(x, x));
        most[0] = fmax(most[0], speed2 < INFINITY ? speed2 : double(INFINITY));
    });
    meet_with<Largest>(w.grid, most);
    const bool is_sound = reached.residual < INFINITY && reached.reference < INFINITY && sqrt(most[0]) * step.dt < step.furthest;
    if (is_sound) {
        w.for_each_brick([&](uint32_t brick) {
            const V3<R> x = w.get(e.x, brick), u = plus(w.get(e.u, brick), x, R(step.dt));
            w.put(e.u, brick, u);
            w.put(e.v, brick, x);
            float4& shown = e.shown[w.slot(brick)];
            shown = make_float4(float(u.x), float(u.y), float(u.z), shown.w);
        });
    }
    meet(w.grid);
    if (is_sound) w.arrive();
    if (w.is_worker) return;
    edges.tell();
    edges.mark(false);
    tell(w, press, c, reached, run.has_contact, run.noise_of_all, most[0], is_sound);
}

}  // namespace efg_kernel
using namespace efg_kernel;

#define PLP_EFG(NAME, R, FEWEST_TEAMS, MOST_TEAMS)                                                                               \
    extern "C" __global__ void __launch_bounds__(MOST_TEAMS* BRICK_NODES, 1)                                                     \
        NAME(const __grid_constant__ Efg e, const __grid_constant__ Contact c, const __grid_constant__ Push loads,               \
             const __grid_constant__ Drive regions, const __grid_constant__ Hold holds, const __grid_constant__ Sticks sticks) {  \
        extern __shared__ float4 memory[];                                                                                       \
        take_step<R, FEWEST_TEAMS>(e, c, loads, regions, holds, sticks, reinterpret_cast<unsigned char*>(memory));               \
    }
// With as many teams as fit into 64 KiB of shared memory at least, and as registers allow at most.
PLP_EFG(efg_single, float, 4, 6)
PLP_EFG(efg_double, double, 2, 4)
