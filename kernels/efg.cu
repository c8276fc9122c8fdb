// One implicit step of the meshless model, as one kernel whose blocks are all at work at the same time; see src/cpu/efg/system.rs and conjugate.rs for what
// it means.
//
// A team of 128 threads cares for a brick at a time, a thread for each of its nodes. For a product with A it stages the brick and the one-node halo around it in
// shared memory, has each cell that touches the brick answer, and gathers the answers on the nodes: every sum has a fixed order. The last block cares for contact,
// and tells the host.
//
// Conjugate gradients in the form of Chronopoulos and Gear: A times the preconditioned residual gives all that an iteration needs to know at once, so that
// blocks meet twice in each, and sum up but once. No number leaves the device before the end of the step.
#include "clock.cuh"
#include "efg.cuh"
#include "grid.cuh"
#include "layout.cuh"
#include "outside.cuh"
#include "press.cuh"
#include "tile.cuh"
#include "touched.cuh"

namespace efg_kernel {

// Steps of Newton's method for a rotation in each step of time.
constexpr int TURNS = 3;
// The recursive residual is brought this much further down than the true one has to be.
constexpr double AHEAD = 0.7;
// A new start that leaves more than this share of the residual has met what rounding leaves.
constexpr double STALLED = 0.9;
// Most solutions of a step, each with contact as the one before answered.
constexpr int MAX_SOLUTIONS = 8;

// A component of a cell's answer, read at once.
template <class R>
struct alignas(16) Row {
    R x, y, z, mean;
};

// What a team shares.
template <class R>
struct Team {
    Row<R> answers[3][CELLS];
    R tile[3][TILE];
};

// What a block shares.
template <class R, int TEAMS>
struct Shared {
    union {
        Team<R> teams[TEAMS];
        PressShared press;
    };
    double scratch[GRID_NUMBERS * 33];
    Moduli<R> forces[16], changes[16];
};

// A team's threads meet.
__device__ __forceinline__ void meet_team(int team) { asm volatile("bar.sync %0, %1;" ::"r"(team + 1), "n"(BRICK_NODES) : "memory"); }

__device__ __forceinline__ float rounding(float) { return 1.1920929e-7f; }
__device__ __forceinline__ double rounding(double) { return 2.220446049250313e-16; }

// The work of one thread in one step.
template <class R, int TEAMS>
struct Worker {
    const Efg& e;
    const EfgStep& step;
    const Push& loads;
    const Drive& regions;
    Shared<R, TEAMS>& s;
    Team<R>& t;
    Grid grid;
    // Threads of a team meet by its number. Blocks that work on bricks, and whether this is one.
    const int team;
    const uint32_t node, lane, workers;
    const bool is_worker;
    const R h, inverse_4h;

    __device__ Worker(const Efg& e, const Push& loads, const Drive& regions, Shared<R, TEAMS>& s)
        : e(e), step(*e.step), loads(loads), regions(regions), s(s), t(s.teams[threadIdx.x / BRICK_NODES]),
          grid{&e.step->arrived, 0, e.partials, 0, s.scratch}, team(threadIdx.x / BRICK_NODES), node(threadIdx.x % BRICK_NODES), lane(threadIdx.x & 31),
          workers(gridDim.x - 1), is_worker(blockIdx.x < workers), h(R(e.cell)), inverse_4h(R(0.25 / e.cell)) {}

    // A brick's part of a field, at this thread's node.
    template <int NUMBERS>
    __device__ __forceinline__ R* of(const void* field, uint32_t brick) const {
        return static_cast<R*>(const_cast<void*>(field)) + size_t(brick) * (NUMBERS * BRICK_NODES) + node;
    }
    __device__ __forceinline__ V3<R> get(const void* field, uint32_t brick) const {
        const R* const at = of<VECTOR>(field, brick);
        return {at[0], at[BRICK_NODES], at[2 * BRICK_NODES]};
    }
    __device__ __forceinline__ void put(void* field, uint32_t brick, const V3<R>& v) const {
        R* const at = of<VECTOR>(field, brick);
        at[0] = v.x, at[BRICK_NODES] = v.y, at[2 * BRICK_NODES] = v.z;
    }
    __device__ __forceinline__ uint32_t slot(uint32_t brick) const { return brick * BRICK_NODES + node; }

    // The bricks of this thread's team.
    template <class Visit>
    __device__ __forceinline__ void for_each_brick(Visit visit) const {
        if (!is_worker) return;
#pragma unroll 1
        for (uint32_t brick = team * workers + blockIdx.x; brick < e.bricks; brick += TEAMS * workers) visit(brick);
    }

    // The 27 bricks around one, in the lanes of every warp.
    __device__ __forceinline__ uint32_t around(uint32_t brick) const { return e.neighbours[brick * 27 + (lane < 27 ? lane : 0)]; }

    // Nothing along axes that are held.
    __device__ __forceinline__ V3<R> free(const V3<R>& v, uint32_t brick) const {
        const uint32_t flags = e.flags[slot(brick)];
        return {flags & 1 ? R(0) : v.x, flags & 2 ? R(0) : v.y, flags & 4 ? R(0) : v.z};
    }

    // Stages a field around a brick, for when the team has met, and gives it at this thread's node.
    __device__ __forceinline__ V3<R> stage(const void* field, uint32_t brick, uint32_t around) const {
        const V3<R> own = get(field, brick);
        const int at = tile_at(1 + node % BRICK_X, 1 + node / BRICK_X % BRICK_Y, 1 + node / (BRICK_X * BRICK_Y));
        t.tile[0][at] = own.x, t.tile[1][at] = own.y, t.tile[2][at] = own.z;
        const R* const all = static_cast<const R*>(field);
#pragma unroll
        for (int round = 0; round < (HALO + BRICK_NODES - 1) / BRICK_NODES; ++round) {
            const int i = node + round * BRICK_NODES;
            const uint32_t entry = HALO_TABLE.entry[i < HALO ? i : HALO - 1];
            const uint32_t from = __shfl_sync(~0u, around, entry >> 9 & 31);
            if (i >= HALO) continue;
            const R* const there = all + size_t(from) * (VECTOR * BRICK_NODES) + (entry >> 14);
            for (int c = 0; c < 3; ++c) t.tile[c][entry & 511] = there[c * BRICK_NODES];
        }
        return own;
    }

    // How the corners of the cell have moved whose lowest one is staged there.
    __device__ __forceinline__ Gradient<R> see(int low) const {
        R u[3][8];
#pragma unroll
        for (int c = 0; c < 3; ++c) {
#pragma unroll
            for (int i = 0; i < 8; ++i) u[c][i] = t.tile[c][low + tile_at(i & 1, i >> 1 & 1, i >> 2)];
        }
        return gradient(u, inverse_4h);
    }

    __device__ __forceinline__ Matrix<R> frame(uint32_t brick, uint32_t cell) const {
        const R* const at = static_cast<const R*>(e.frames) + size_t(brick) * (FRAME * BRICK_NODES) + cell;
        Matrix<R> a;
#pragma unroll
        for (int n = 0; n < 9; ++n) a.m[n / 3][n % 3] = at[n * BRICK_NODES];
        return a;
    }

    // Has all cells that touch the staged brick answer by their moduli and stress(gradient, frame, moduli), and gives the sum on this thread's node.
    template <class Stress>
    __device__ __forceinline__ V3<R> gather(uint32_t around, const Moduli<R>* moduli, Stress stress) const {
#pragma unroll 1
        for (int round = 0; round < (CELLS + BRICK_NODES - 1) / BRICK_NODES; ++round) {
            const int cell = node + round * BRICK_NODES;
            const int x = cell % CELLS_X, y = cell / CELLS_X % CELLS_Y, z = cell / (CELLS_X * CELLS_Y);
            // Cells before the brick begin in another one.
            const uint32_t from = __shfl_sync(~0u, around, (x > 0 ? 1 : 0) + (y > 0 ? 3 : 0) + (z > 0 ? 9 : 0));
            const uint32_t there = ((z + BRICK_Z - 1) % BRICK_Z * BRICK_Y + (y + BRICK_Y - 1) % BRICK_Y) * BRICK_X + (x + BRICK_X - 1) % BRICK_X;
            // What is known of the cell comes while the tile does.
            uint32_t material = 0;
            Matrix<R> a;
            if (cell < CELLS) {
                material = e.cells[from * BRICK_NODES + there];
                a = frame(from, there);
            }
            if (round == 0) meet_team(team);
            Answer<R> given{};
            if (material) {
                const Moduli<R> by = moduli[material];
                const Gradient<R> seen = see(tile_at(x, y, z));
                given = cell_answer(seen, stress(seen.g, a, by), by.hourglass, h);
            }
            if (cell >= CELLS) continue;
#pragma unroll
            for (int c = 0; c < 3; ++c) t.answers[c][cell] = {given.q.m[c][0], given.q.m[c][1], given.q.m[c][2], given.mean[c]};
        }
        meet_team(team);
        const int first = (node / (BRICK_X * BRICK_Y) * CELLS_Y + node / BRICK_X % BRICK_Y) * CELLS_X + node % BRICK_X;
        V3<R> sum{0, 0, 0};
#pragma unroll
        for (int c = 0; c < 8; ++c) {
            // Cell c lies before the node along an axis where its bit is 0: the node is its upper corner there.
            const int cell = first + ((c & 4 ? 1 : 0) * CELLS_Y + (c & 2 ? 1 : 0)) * CELLS_X + (c & 1);
            const auto along = [&](int i) {
                const Row<R> row = t.answers[i][cell];
                return row.mean + ((c & 1 ? -row.x : row.x) + ((c & 2 ? -row.y : row.y) + (c & 4 ? -row.z : row.z)));
            };
            sum.x += along(0), sum.y += along(1), sum.z += along(2);
        }
        return sum;
    }

    // A times a field, without contact, at this thread's node of a brick; and the field itself there.
    __device__ __forceinline__ V3<R> product_of(const void* field, uint32_t brick, V3<R>& own) const {
        const uint32_t near = around(brick);
        own = stage(field, brick, near);
        const V3<R> sum = gather(near, s.changes, [](const Matrix<R>& g, const Matrix<R>& a, const Moduli<R>& by) {
            return stress_change(a, g, by.mu, by.lambda);
        });
        const R heavy = *of<1>(e.heavy, brick);
        return {heavy * own.x - sum.x, heavy * own.y - sum.y, heavy * own.z - sum.z};
    }

    // Finds the frames of a brick's cells. Sees how they are deformed: largest strain, J − 1 and 1 − J.
    __device__ __forceinline__ void look(uint32_t brick, float seen[3]) const {
        stage(e.u, brick, around(brick));
        meet_team(team);
        if (e.cells[slot(brick)]) {
            const Matrix<R> g = see(tile_at(1 + node % BRICK_X, 1 + node / BRICK_X % BRICK_Y, 1 + node / (BRICK_X * BRICK_Y))).g;
            const Matrix<R> f = deformation(g);
            Matrix<R> strain = g, turned = f;
            if (step.elasticity == COROTATED) {
                R* const at = of<ROTATION>(e.rotations, brick);
                Rotation<R> q{at[0], at[BRICK_NODES], at[2 * BRICK_NODES], at[3 * BRICK_NODES]};
#pragma unroll 1
                for (int turn = 0; turn < TURNS; ++turn) q = turn_towards(q, f);
                at[0] = q.x, at[BRICK_NODES] = q.y, at[2 * BRICK_NODES] = q.z, at[3 * BRICK_NODES] = q.w;
                turned = rotation_matrix(q);
                strain = corotated_strain(turned, g);
            } else if (step.elasticity == ST_VENANT_KIRCHHOFF) {
                strain = green_strain(g);
            }
            if (step.elasticity != LINEAR) {
                R* const at = of<FRAME>(e.frames, brick);
                for (int n = 0; n < 9; ++n) at[n * BRICK_NODES] = turned.m[n / 3][n % 3];
            }
            float single[9], cof[9];
            for (int n = 0; n < 9; ++n) single[n] = float(g.m[n / 3][n % 3]);
            const float dj = volume_change(single, cof);
            for (int i = 0; i < 3; ++i) seen[0] = fmaxf(seen[0], fabsf(float(strain.m[i][i])));
            seen[1] = fmaxf(seen[1], dj);
            seen[2] = fmaxf(seen[2], -dj);
        }
        meet_team(team);
    }

    // Builds a brick's part of the system, but for loads, regions and contact. Gives what rounding of displacements makes of b, squared, in units of the
    // displacements' own rounding over dt.
    __device__ __forceinline__ double build(uint32_t brick) const {
        const uint32_t near = around(brick);
        const V3<R> u = stage(e.u, brick, near), v = get(e.v, brick);
        V3<R> force = gather(near, s.forces, [&](const Matrix<R>& g, const Matrix<R>& a, const Moduli<R>& by) {
            if (step.elasticity == COROTATED) return corotated_stress(a, g, by.mu, by.lambda);
            if (step.elasticity == LINEAR) return hooke(g, by.mu, by.lambda);
            return product(deformation(g), hooke(green_strain(g), by.mu, by.lambda));
        });

        // What the eight cells around the node make of its own motion.
        const uint32_t word = __float_as_uint(e.shown[slot(brick)].w);
        const int x = node % BRICK_X, y = node / BRICK_X % BRICK_Y, z = node / (BRICK_X * BRICK_Y);
        Block<R> block{};
        R held = 0, holds = 0;
#pragma unroll 1
        for (int c = 0; c < 8; ++c) {
            const int cx = x + (c & 1), cy = y + (c >> 1 & 1), cz = z + (c >> 2);
            const uint32_t from = __shfl_sync(~0u, near, (cx > 0 ? 1 : 0) + (cy > 0 ? 3 : 0) + (cz > 0 ? 9 : 0));
            const uint32_t material = word >> (4 * c) & 15;
            if (!material) continue;
            const uint32_t there = ((cz + BRICK_Z - 1) % BRICK_Z * BRICK_Y + (cy + BRICK_Y - 1) % BRICK_Y) * BRICK_X + (cx + BRICK_X - 1) % BRICK_X;
            const Moduli<R> by = s.changes[material];
            const Block<R> more = corner_block(frame(from, there), by, h, c & 1 ? R(-1) : R(1), c & 2 ? R(-1) : R(1), c & 4 ? R(-1) : R(1));
            block.xx += more.xx, block.xy += more.xy, block.xz += more.xz, block.yy += more.yy, block.yz += more.yz, block.zz += more.zz;
            held += s.forces[material].hourglass, holds += by.hourglass;
        }
        const V3<R> noise = free({block.xx * u.x, block.yy * u.y, block.zz * u.z}, brick);
        const R mass = *of<1>(e.mass, brick), inertia = mass * R(step.inertia), dt = R(step.dt);
        block.xx += inertia, block.yy += inertia, block.zz += inertia;
        const Block<R> inverse = mass > R(0) ? inverted(block) : Block<R>{};
        R* const at = of<BLOCK>(e.inverse, brick);
        at[0] = inverse.xx, at[BRICK_NODES] = inverse.xy, at[2 * BRICK_NODES] = inverse.xz;
        at[3 * BRICK_NODES] = inverse.yy, at[4 * BRICK_NODES] = inverse.yz, at[5 * BRICK_NODES] = inverse.zz;
        *of<1>(e.heavy, brick) = inertia + holds;

        force = plus(force, u, -held);
        force = plus(force, {R(step.gravity[0]), R(step.gravity[1]), R(step.gravity[2])}, mass);
        const V3<R> still{0, 0, 0};
        V3<R> b = plus(step.is_paper ? still : plus(still, v, mass), force, dt);
        if (step.is_paper) {
            V3<R> own;
            b = plus(b, product_of(e.v, brick, own), R(1));
        }
        put(e.b, brick, b);
        // What is held stays, unless it is told to move.
        put(e.x, brick, free(v, brick));
        return double(dot(noise, noise));
    }

    // Visits the entries of a list that are this thread's.
    template <class Visit>
    __device__ __forceinline__ void for_each(uint32_t count, Visit visit) const {
        if (!is_worker) return;
        for (uint32_t i = blockIdx.x * blockDim.x + threadIdx.x; i < count; i += workers * blockDim.x) visit(i);
    }

    // Loads act on b.
    __device__ void push() const {
        for_each(loads.count, [&](uint32_t i) {
            const Pushed known = loads.nodes[i];
            const Triple force = force_on(loads, known, [&](uint32_t slot) -> Triple {
                const R* const u = numbers_of<R>(e.u, slot);
                return {u[0], u[BRICK_NODES], u[2 * BRICK_NODES]};
            });
            R* const b = numbers_of<R>(e.b, known.slot);
            b[0] += R(force.x * step.dt), b[BRICK_NODES] += R(force.y * step.dt), b[2 * BRICK_NODES] += R(force.z * step.dt);
        });
    }

    __device__ Triple place_of_driven(uint32_t i) const {
        const Driven known = regions.nodes[i];
        return place_of(known, regions.motions[step.substep * regions.regions + known.region]);
    }

    // What is driven has the velocity that takes it where it has to be at the end of the step.
    __device__ void drive() const {
        for_each(regions.count, [&](uint32_t i) {
            const Triple to = place_of_driven(i);
            const uint32_t slot = regions.nodes[i].slot;
            const R* const u = numbers_of<R>(e.u, slot);
            R* const x = numbers_of<R>(e.x, slot);
            x[0] = R((to.x - u[0]) / step.dt), x[BRICK_NODES] = R((to.y - u[BRICK_NODES]) / step.dt), x[2 * BRICK_NODES] = R((to.z - u[2 * BRICK_NODES]) / step.dt);
        });
    }

    // And it is there to the last digit.
    __device__ void arrive() const {
        for_each(regions.count, [&](uint32_t i) {
            const Triple to = place_of_driven(i);
            const uint32_t slot = regions.nodes[i].slot;
            R* const u = numbers_of<R>(e.u, slot);
            u[0] = R(to.x), u[BRICK_NODES] = R(to.y), u[2 * BRICK_NODES] = R(to.z);
            e.shown[slot] = make_float4(float(to.x), float(to.y), float(to.z), e.shown[slot].w);
        });
    }

    // What contact adds to A times a vector at this thread's node.
    __device__ __forceinline__ V3<R> touched(const Contact& c, bool has_contact, uint32_t brick) const {
        if (!has_contact || !e.near_tools[brick]) return {0, 0, 0};
        const uint32_t carrier = c.carrier_at[slot(brick)];
        if (carrier == ~0u) return {0, 0, 0};
        const R* const at = static_cast<const R*>(e.touched) + 3 * carrier;
        return {at[0], at[1], at[2]};
    }

    __device__ __forceinline__ V3<R> precondition(const V3<R>& r, uint32_t brick) const {
        const R* const m = of<BLOCK>(e.inverse, brick);
        const R xx = m[0], xy = m[BRICK_NODES], xz = m[2 * BRICK_NODES], yy = m[3 * BRICK_NODES], yz = m[4 * BRICK_NODES], zz = m[5 * BRICK_NODES];
        return free({xx * r.x + (xy * r.y + xz * r.z), xy * r.x + (yy * r.y + yz * r.z), xz * r.x + (yz * r.y + zz * r.z)}, brick);
    }
};

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
template <class R, int TEAMS>
struct Run {
    Worker<R, TEAMS>& w;
    Press<R, TEAMS * BRICK_NODES>& press;
    const Contact& c;
    bool has_contact = false;
    double noise = 0.0;

    // The residual of x, and that preconditioned; r·r and r·z of this thread's nodes. A x is known, or is found.
    __device__ void renew(bool is_known, Sums& sums) const {
        const Efg& e = w.e;
        if (!is_known) {
            w.for_each_brick([&](uint32_t brick) {
                V3<R> own;
                w.put(e.ax, brick, w.product_of(e.x, brick, own));
            });
        }
        if (has_contact && !w.is_worker) press.touch(e.x, true);
        meet(w.grid);
        w.for_each_brick([&](uint32_t brick) {
            const V3<R> more = w.touched(c, has_contact, brick), b = w.get(e.b, brick), ax = w.get(e.ax, brick);
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
        if (has_contact && !w.is_worker) sums.numbers[2] += press.touch(w.e.z, false);
    }

    // p = z + β p and x += α p, and so r by A p; z, r·r and r·z from that.
    __device__ void relax(double along, double before, Sums& sums) const {
        const Efg& e = w.e;
        const R alpha = R(along), beta = R(before);
        w.for_each_brick([&](uint32_t brick) {
            const V3<R> more = w.touched(c, has_contact, brick), az = w.get(e.w, brick);
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
            if (!has_contact) return;
            if (!w.is_worker) {
                const bool is_settled = press.judge(w.s.scratch);
                if (threadIdx.x == 0) *w.e.is_settled = is_settled;
                if (!is_settled && !is_last(solution, reached)) press.mend();
            }
            meet(w.grid);
            if (*(volatile uint32_t*)w.e.is_settled || is_last(solution, reached)) return;
        }
    }
    __device__ bool is_last(int solution, const Reached& reached) const {
        return solution == MAX_SOLUTIONS || reached.iterations >= w.step.max_iterations;
    }
};

// What the host is told.
template <class R, int TEAMS>
__device__ void tell(const Worker<R, TEAMS>& w, const Press<R, TEAMS * BRICK_NODES>& press, const Contact& c, const Reached& reached, double noise, double speed2,
                     bool is_sound) {
    Report& report = *w.e.report;
    press.tell(report.sums);
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
    *(volatile uint32_t*)&report.sequence = w.step.step.sequence;
}

template <class R, int TEAMS>
__device__ void take_step(const Efg& e, const Contact& c, const Push& loads, const Drive& regions, unsigned char* memory) {
    static_assert(sizeof(Shared<R, TEAMS>) == EFG_SHARED_BYTES<R, TEAMS>);
    Shared<R, TEAMS>& s = *reinterpret_cast<Shared<R, TEAMS>*>(memory);
    constexpr int THREADS = TEAMS * BRICK_NODES;
    Worker<R, TEAMS> w(e, loads, regions, s);
    const EfgStep& step = w.step;
    if (threadIdx.x < 16) {
        const EfgLaw law = e.laws[threadIdx.x];
        s.forces[threadIdx.x] = {R(law.forces.mu), R(law.forces.lambda), R(law.forces.hourglass)};
        s.changes[threadIdx.x] = {R(law.changes.mu), R(law.changes.lambda), R(law.changes.hourglass)};
    }
    // Where sites were listed, that began the step.
    if (!w.is_worker && threadIdx.x == 0 && e.starts) *e.started = clock_ns();
    __syncthreads();

    Press<R, THREADS> press(e, c, s.press);
    Run<R, TEAMS> run{w, press, c};
    float seen[3] = {};
    w.for_each_brick([&](uint32_t brick) { w.look(brick, seen); });
    double strains[3] = {seen[0], seen[1], seen[2]};
    if (w.is_worker) {
        const double most = block_all<Largest>(strains, s.scratch);
        if (threadIdx.x % 32 == 0 && threadIdx.x / 32 < 3) reinterpret_cast<float*>(&e.seen[blockIdx.x])[threadIdx.x / 32] = float(most);
    } else {
        press.find();
    }
    meet(w.grid);

    w.for_each_brick([&](uint32_t brick) { run.noise += w.build(brick); });
    const double unit = double(rounding(R(0))) / step.dt;
    run.noise *= unit * unit;
    meet(w.grid);
    if (step.only_forces) {
        if (!w.is_worker) tell(w, press, c, Reached{}, 0.0, 0.0, true);
        return;
    }
    w.push();
    w.drive();
    run.has_contact = c.counts[POINTS] > 0;
    if (run.has_contact && !w.is_worker) press.begin();
    if (regions.count > 0) meet(w.grid);

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
    if (!w.is_worker) tell(w, press, c, reached, run.noise_of_all, most[0], is_sound);
}

}  // namespace efg_kernel
using namespace efg_kernel;

#define PLP_EFG(NAME, R, TEAMS)                                                                                                  \
    extern "C" __global__ void __launch_bounds__(TEAMS* BRICK_NODES, 1)                                                          \
        NAME(const __grid_constant__ Efg e, const __grid_constant__ Contact c, const __grid_constant__ Push loads,               \
             const __grid_constant__ Drive regions) {                                                                            \
        extern __shared__ float4 memory[];                                                                                       \
        take_step<R, TEAMS>(e, c, loads, regions, reinterpret_cast<unsigned char*>(memory));                                     \
    }
// With as many teams as registers allow, and as fit into 61 KiB of shared memory.
PLP_EFG(efg_single, float, 6)
PLP_EFG(efg_single_small, float, 4)
PLP_EFG(efg_double, double, 4)
PLP_EFG(efg_double_small, double, 2)
