// What the threads of a block do for bricks: a team of 128 threads cares for one at a time, a thread for each of its nodes.
//
// For a product with A a team stages the brick and the one-node halo around it in shared memory, has each cell that touches the brick answer, and gathers the answers
// on the nodes: every sum has a fixed order.
#pragma once
#include "edge.cuh"
#include "efg.cuh"
#include "field.cuh"
#include "grid.cuh"
#include "layout.cuh"
#include "outside.cuh"
#include "press.cuh"
#include "rows.cuh"
#include "tile.cuh"
#include "tool.cuh"

namespace efg_kernel {

// Steps of Newton's method for a rotation in each step of time.
constexpr int TURNS = 3;

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

// What a block shares, before what its teams or contact do.
template <class R>
struct alignas(16) Shared {
    double scratch[GRID_NUMBERS * 33];
    Moduli<R> forces[16], changes[16];
};

// A team's threads meet.
__device__ __forceinline__ void meet_team(int team) { asm volatile("bar.sync %0, %1;" ::"r"(team + 1), "n"(BRICK_NODES) : "memory"); }

__device__ __forceinline__ float rounding(float) { return 1.1920929e-7f; }
__device__ __forceinline__ double rounding(double) { return 2.220446049250313e-16; }

// The work of one thread in one step.
template <class R>
struct Worker {
    const Efg& e;
    const EfgStep& step;
    const Push& loads;
    const Drive& regions;
    const Hold& holds;
    const Sticks& edges;
    Shared<R>& s;
    Team<R>& t;
    Grid grid;
    // Threads of a team meet by its number. Blocks that work on bricks, and whether this is one.
    const int team, teams;
    const uint32_t node, lane, workers;
    const bool is_worker;
    const R h, inverse_4h;

    __device__ Worker(const Efg& e, const Push& loads, const Drive& regions, const Hold& holds, const Sticks& edges, Shared<R>& s, Team<R>* of_teams)
        : e(e), step(*e.step), loads(loads), regions(regions), holds(holds), edges(edges), s(s), t(of_teams[threadIdx.x / BRICK_NODES]),
          grid{e.arrived, *e.meetings, e.partials, s.scratch}, team(threadIdx.x / BRICK_NODES), teams(blockDim.x / BRICK_NODES), node(threadIdx.x % BRICK_NODES),
          lane(threadIdx.x & 31), workers(gridDim.x - 1), is_worker(blockIdx.x < workers), h(R(e.cell)), inverse_4h(R(0.25 / e.cell)) {}

    // A brick's part of a field, at this thread's node.
    template <int NUMBERS>
    __device__ __forceinline__ R* of(const void* field, uint32_t brick) const {
        return numbers_of<NUMBERS, R>(field, slot(brick));
    }
    __device__ __forceinline__ V3<R> get(const void* field, uint32_t brick) const { return vector_of<R>(field, slot(brick)); }
    __device__ __forceinline__ void put(void* field, uint32_t brick, const V3<R>& v) const { set_vector(field, slot(brick), v); }
    __device__ __forceinline__ uint32_t slot(uint32_t brick) const { return brick * BRICK_NODES + node; }

    // The bricks of this thread's team.
    template <class Visit>
    __device__ __forceinline__ void for_each_brick(Visit visit) const {
        if (!is_worker) return;
#pragma unroll 1
        for (uint32_t brick = team * workers + blockIdx.x; brick < e.bricks; brick += teams * workers) visit(brick);
    }

    // The 27 bricks around one, in the lanes of every warp.
    __device__ __forceinline__ uint32_t around(uint32_t brick) const { return e.neighbours[brick * 27 + (lane < 27 ? lane : 0)]; }

    __device__ __forceinline__ V3<R> free(const V3<R>& v, uint32_t brick) const { return free_part(v, e.flags[slot(brick)]); }

    // Where this thread's node lies in the tile.
    __device__ __forceinline__ int own_at() const { return tile_at(1 + node % BRICK_X, 1 + node / BRICK_X % BRICK_Y, 1 + node / (BRICK_X * BRICK_Y)); }

    // Stages a field around a brick, for when the team has met, and gives it at this thread's node.
    __device__ __forceinline__ V3<R> stage(const void* field, uint32_t brick, uint32_t around) const {
        const V3<R> own = get(field, brick);
        const int at = own_at();
        t.tile[0][at] = own.x, t.tile[1][at] = own.y, t.tile[2][at] = own.z;
        const R* const all = static_cast<const R*>(field);
#pragma unroll
        for (int round = 0; round < HALO_ROUNDS; ++round) {
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

    // Has all cells answer that touch a brick, around which a field is staged, and gives the sum on this thread's node.
    template <class Stress>
    __device__ __forceinline__ V3<R> gather(uint32_t around, const Moduli<R>* moduli, Stress stress) const {
#pragma unroll 1
        for (int round = 0; round < CELL_ROUNDS; ++round) {
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

    // How stress changes in a cell.
    struct Changes {
        __device__ __forceinline__ Matrix<R> operator()(const Matrix<R>& g, const Matrix<R>& a, const Moduli<R>& by) const {
            return stress_change(a, g, by.mu, by.lambda);
        }
    };
    // And what it is.
    struct Forces {
        uint32_t elasticity;
        __device__ __forceinline__ Matrix<R> operator()(const Matrix<R>& g, const Matrix<R>& a, const Moduli<R>& by) const {
            if (elasticity == COROTATED) return corotated_stress(a, g, by.mu, by.lambda);
            if (elasticity == LINEAR) return hooke(g, by.mu, by.lambda);
            return product(deformation(g), hooke(green_strain(g), by.mu, by.lambda));
        }
    };

    // A times a field, without contact and rows, at this thread's node of a brick; and the field itself there.
    __device__ __forceinline__ V3<R> product_of(const void* field, uint32_t brick, V3<R>& own) const {
        const uint32_t near = around(brick);
        own = stage(field, brick, near);
        const V3<R> sum = gather(near, s.changes, Changes{});
        const R heavy = *of<1>(e.heavy, brick);
        return {heavy * own.x - sum.x, heavy * own.y - sum.y, heavy * own.z - sum.z};
    }

    // Turns a cell's rotation towards how it is deformed, and gives its frame. Sees how it is deformed: largest strain, J − 1 and 1 − J.
    __device__ __forceinline__ Matrix<R> turn(Rotation<R>& q, const Matrix<R>& g, float seen[3]) const {
        const Matrix<R> f = deformation(g);
        Matrix<R> strain = g, turned = f;
        if (step.elasticity == COROTATED) {
#pragma unroll 1
            for (int turn = 0; turn < TURNS; ++turn) q = turn_towards(q, f);
            turned = rotation_matrix(q);
            strain = corotated_strain(turned, g);
        } else if (step.elasticity == ST_VENANT_KIRCHHOFF) {
            strain = green_strain(g);
        }
        float single[9], cof[9];
        for (int n = 0; n < 9; ++n) single[n] = float(g.m[n / 3][n % 3]);
        const float dj = volume_change(single, cof);
        for (int i = 0; i < 3; ++i) seen[0] = fmaxf(seen[0], fabsf(float(strain.m[i][i])));
        seen[1] = fmaxf(seen[1], dj);
        seen[2] = fmaxf(seen[2], -dj);
        return turned;
    }

    // Finds the frames of a brick's cells.
    __device__ __forceinline__ void look(uint32_t brick, float seen[3]) const {
        stage(e.u, brick, around(brick));
        meet_team(team);
        if (e.cells[slot(brick)]) {
            const Matrix<R> g = see(own_at()).g;
            R* const at = of<ROTATION>(e.rotations, brick);
            Rotation<R> q{at[0], at[BRICK_NODES], at[2 * BRICK_NODES], at[3 * BRICK_NODES]};
            const Matrix<R> turned = turn(q, g, seen);
            if (step.elasticity == COROTATED) at[0] = q.x, at[BRICK_NODES] = q.y, at[2 * BRICK_NODES] = q.z, at[3 * BRICK_NODES] = q.w;
            if (step.elasticity != LINEAR) {
                R* const at = of<FRAME>(e.frames, brick);
                for (int n = 0; n < 9; ++n) at[n * BRICK_NODES] = turned.m[n / 3][n % 3];
            }
        }
        meet_team(team);
    }

    // Visits rows, each by eight threads side by side: their number, and how many nodes they see. All threads of a warp visit as many; those without a row see none.
    template <class Visit>
    __device__ __forceinline__ void for_each_row(Visit visit) const {
        if (!is_worker) return;
        const uint32_t warps = blockDim.x / 32;
#pragma unroll 1
        for (uint32_t first = 4 * (threadIdx.x / 32 * workers + blockIdx.x); first < e.row_count; first += 4 * warps * workers) {
            const uint32_t row = first + lane / 8;
            const bool is_there = row < e.row_count;
            visit(is_there ? row : 0, is_there ? row_cell<R>(e, row).length : 0);
            // What any of them wrote all may read.
            __syncwarp();
        }
    }

    // Finds the frames of cells with rows of their own, and what these give at the start of a step.
    __device__ void look_at_rows(float seen[3]) const {
        for_each_row([&](uint32_t row, uint32_t length) {
            const RowMotion<R> motion = row_motion<R>(e, row, length, e.u);
            Rotation<R>& known = static_cast<Rotation<R>*>(e.row_rotations)[row];
            Rotation<R> q = known;
            float of_row[3] = {};
            const Matrix<R> turned = turn(q, motion.gradient, of_row);
            const RowCell<R> cell = row_cell<R>(e, row);
            const Moduli<R> by = s.forces[cell.material];
            const Matrix<R> stress = Forces{step.elasticity}(motion.gradient, turned, by);
            for (uint32_t n = lane % 8; n < length; n += 8) {
                row_given<R>(e, row, n) = row_force(e, cell, row_entry<R>(e, row, n), e.u, motion, stress, by.hourglass);
            }
            // All have read how it was turned before.
            __syncwarp();
            if (length == 0) return;
            for (int i = 0; i < 3; ++i) seen[i] = fmaxf(seen[i], of_row[i]);
            if (lane % 8 > 0) return;
            if (step.elasticity == COROTATED) known = q;
            if (step.elasticity != LINEAR) row_frame<R>(e, row) = turned;
        });
        if (step.is_paper) give_of_rows(e.v, R(-1) / R(step.dt), true);
    }

    // How what rows give changes with a field, times a factor; `adds` says whether to what they give already. Gives the product of that with the field.
    __device__ double give_of_rows(const void* field, R factor, bool adds) const {
        double work = 0.0;
        for_each_row([&](uint32_t row, uint32_t length) {
            const RowMotion<R> motion = row_motion<R>(e, row, length, field);
            const RowCell<R> cell = row_cell<R>(e, row);
            const Moduli<R> by = s.changes[cell.material];
            const Matrix<R> stress = stress_change(row_frame<R>(e, row), motion.gradient, by.mu, by.lambda);
            for (uint32_t n = lane % 8; n < length; n += 8) {
                const RowEntry<R>& entry = row_entry<R>(e, row, n);
                const V3<R> force = row_force(e, cell, entry, field, motion, stress, by.hourglass);
                V3<R>& given = row_given<R>(e, row, n);
                given = plus(adds ? given : V3<R>{0, 0, 0}, force, factor);
                work += double(factor) * double(dot(vector_of<R>(field, entry.slot), force));
            }
        });
        return work;
    }

    // Builds a brick's part of the system, but for loads, regions and contact. Gives what rounding of displacements makes of b, squared, in units of the
    // displacements' own rounding over dt.
    __device__ __forceinline__ double build(uint32_t brick) const {
        const uint32_t near = around(brick);
        const V3<R> u = stage(e.u, brick, near), v = get(e.v, brick);
        V3<R> force = gather(near, s.forces, Forces{step.elasticity});
        if (e.row_count) force = plus(force, given_by_rows<R>(e, slot(brick)), R(1));

        // What the eight cells around the node make of its own motion.
        const int x = node % BRICK_X, y = node / BRICK_X % BRICK_Y, z = node / (BRICK_X * BRICK_Y);
        Block<R> block = e.row_count ? block_of_rows(e, slot(brick), s.changes) : Block<R>{};
        R held = 0, holds = 0;
#pragma unroll 1
        for (int c = 0; c < 8; ++c) {
            const int cx = x + (c & 1), cy = y + (c >> 1 & 1), cz = z + (c >> 2);
            const uint32_t from = __shfl_sync(~0u, near, (cx > 0 ? 1 : 0) + (cy > 0 ? 3 : 0) + (cz > 0 ? 9 : 0));
            const uint32_t there = ((cz + BRICK_Z - 1) % BRICK_Z * BRICK_Y + (cy + BRICK_Y - 1) % BRICK_Y) * BRICK_X + (cx + BRICK_X - 1) % BRICK_X;
            const uint32_t material = e.cells[from * BRICK_NODES + there];
            if (!material) continue;
            const Moduli<R> by = s.changes[material];
            const Block<R> more = corner_block(frame(from, there), by, h, c & 1 ? R(-1) : R(1), c & 2 ? R(-1) : R(1), c & 4 ? R(-1) : R(1));
            block.xx += more.xx, block.xy += more.xy, block.xz += more.xz, block.yy += more.yy, block.yz += more.yz, block.zz += more.zz;
            held += s.forces[material].hourglass, holds += by.hourglass;
        }
        const V3<R> noise = free({block.xx * u.x, block.yy * u.y, block.zz * u.z}, brick);
        const R mass = *of<1>(e.mass, brick), inertia = mass * R(step.inertia), dt = R(step.dt);
        block.xx += inertia, block.yy += inertia, block.zz += inertia;
        const Block<R> inverse = mass > R(0) ? inverted(block) : Block<R>{};
        set_block(e.inverse, slot(brick), inverse);
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
                const V3<R> u = vector_of<R>(e.u, slot);
                return {u.x, u.y, u.z};
            });
            const V3<R> more{R(force.x), R(force.y), R(force.z)};
            set_vector(e.b, known.slot, plus(vector_of<R>(e.b, known.slot), more, R(step.dt)));
        });
    }

    // Visits all nodes that are taken along, and where they have to be at the end of the step: by driven regions, and by tools that hold them.
    template <class Visit>
    __device__ void for_each_taken(Visit visit) const {
        for_each(regions.count, [&](uint32_t i) {
            const Driven known = regions.nodes[i];
            visit(known.slot, place_of(known, regions.motions[step.substep * regions.regions + known.region]));
        });
        for_each(holds.count, [&](uint32_t i) {
            const Held known = holds.nodes[i];
            uint32_t tool = 0;
            while (holds.starts[tool + 1] <= i) ++tool;
            const View view = view_of(step.step.tools[tool], step.to);
            const Vec arm = rotate(view.turn, vec(known.place));
            visit(known.slot, Triple{view.at[0] - known.rest[0] + arm.x, view.at[1] - known.rest[1] + arm.y, view.at[2] - known.rest[2] + arm.z});
        });
    }
    __device__ bool takes_any() const { return regions.count > 0 || holds.count > 0; }

    // What is taken along has the velocity that takes it there.
    __device__ void take_along() const {
        for_each_taken([&](uint32_t slot, const Triple& to) {
            const V3<R> u = vector_of<R>(e.u, slot);
            set_vector(e.x, slot, V3<R>{R((to.x - u.x) / step.dt), R((to.y - u.y) / step.dt), R((to.z - u.z) / step.dt)});
        });
    }

    // And it is there to the last digit.
    __device__ void arrive() const {
        for_each_taken([&](uint32_t slot, const Triple& to) {
            set_vector(e.u, slot, V3<R>{R(to.x), R(to.y), R(to.z)});
            e.shown[slot] = make_float4(float(to.x), float(to.y), float(to.z), e.shown[slot].w);
        });
    }

    // What contact and edges add on the node in a slot to A times a vector.
    __device__ __forceinline__ V3<R> touched(const Contact& c, bool has_contact, uint32_t slot) const {
        V3<R> sum{0, 0, 0};
        const uint32_t carrier = has_contact && e.near_tools[slot / BRICK_NODES] ? c.carrier_at[slot] : ~0u;
        if (carrier != ~0u) {
            const R* const at = static_cast<const R*>(e.touched) + 3 * carrier;
            sum = {at[0], at[1], at[2]};
        }
        return edges.all ? plus(sum, given_by_edges<R>(edges, slot), R(1)) : sum;
    }

    // And what these and rows add at this thread's node.
    __device__ __forceinline__ V3<R> added(const Contact& c, bool has_contact, uint32_t brick) const {
        const V3<R> sum = touched(c, has_contact, slot(brick));
        return e.row_count ? plus(sum, given_by_rows<R>(e, slot(brick)), R(1)) : sum;
    }

    __device__ __forceinline__ V3<R> precondition(const V3<R>& r, uint32_t brick) const {
        return free(product(block_of<R>(e.inverse, slot(brick)), r), brick);
    }
};

}  // namespace efg_kernel
